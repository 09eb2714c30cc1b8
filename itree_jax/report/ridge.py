"""Histograms of one quantity, one row above the other on a common axis."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import NOT_KNOWN, count_of, number, text
from itree_jax.report.palette import css, cycle

WIDTH, ROW, TOP, BOTTOM, LEFT = 280.0, 30.0, 20.0, 20.0, 16.0  # [px]
BINS = 40
TAIL = 0.5  # [%] of the draws that may lie outside on either end


def ridge(columns: Sequence[Float[np.ndarray, "_"]], names: Sequence[str], title: str) -> str:
    """One row per column in the colours of `palette.cycle`, its median marked; every row has its own height."""
    everything = np.concatenate([*columns, np.zeros(0)])
    low, high = (float(v) for v in np.percentile(everything, (TAIL, 100.0 - TAIL))) if len(everything) else (0.0, 1.0)
    pad = 0.03 * (high - low) + 1e-6
    low, high = low - pad, high + pad
    height = TOP + ROW * len(columns) + BOTTOM
    rows = "".join(
        row(values, name, TOP + ROW * (k + 1), low, high, css(cycle(k)))
        for k, (values, name) in enumerate(zip(columns, names, strict=True))
    )
    floor = height - BOTTOM + 3.0
    ticks = "".join(
        f'<path class="axis" d="M{place(v, low, high):.1f} {floor:.1f}v3"/><text class="small {side}" '
        f'x="{place(v, low, high):.1f}" y="{height - 4:.1f}">{number(v, digits(high - low))}</text>'
        for v, side in ((low + pad, ""), (0.5 * (low + high), "middle"), (high - pad, "end"))
    )
    medians = ", ".join(
        f"{name} {number(np.median(values), 3) if len(values) else NOT_KNOWN}"
        for name, values in zip(names, columns, strict=True)
    )
    said = f"{title}: {count_of(len(everything), 'draw')}; medians: {medians}"
    return (
        f'<svg class="panel" role="img" viewBox="0 0 {WIDTH:.0f} {height:.0f}"><title>{text(said)}</title>'
        f'<text x="0" y="12">{text(title)}</text>{rows}'
        f'<path class="axis" d="M{LEFT:.0f} {floor:.1f}H{WIDTH:.0f}"/>{ticks}</svg>'
    )


def row(values: Float[np.ndarray, "_"], name: str, base: float, low: float, high: float, colour: str) -> str:
    """A histogram on its base line."""
    bars = ""
    if len(values):
        share = np.histogram(np.clip(values, low, high), np.linspace(low, high, BINS + 1))[0]
        tall = share / max(float(share.max()), 1.0) * (ROW - 6.0)
        step = (WIDTH - LEFT) / BINS
        outline = "".join(f"V{base - h:.1f}h{step:.2f}" for h in tall)
        middle = place(float(np.median(values)), low, high)
        bars = (
            f'<path class="histogram" fill="{colour}" d="M{LEFT:.0f} {base:.1f}{outline}V{base:.1f}z"/>'
            f'<path class="median" d="M{middle:.1f} {base:.1f}v-{ROW - 6:.0f}"/>'
        )
    return (
        f'<path class="base" d="M{LEFT:.0f} {base:.1f}H{WIDTH:.0f}"/>{bars}'
        f'<text x="0" y="{base - 4:.1f}">{text(name)}</text>'
    )


def place(value: float, low: float, high: float) -> float:
    """[px] from the left."""
    return LEFT + (WIDTH - LEFT) * min(max((value - low) / (high - low), 0.0), 1.0)


def digits(span: float) -> int:
    """Decimals that tell the ends of an axis apart."""
    return 1 if span > 10.0 else 2 if span > 0.2 else 3
