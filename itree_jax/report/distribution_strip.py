"""A small picture of one decision: where the measured value lies among what noisy draws of both sides gave."""

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import number, text

WIDTH, HEIGHT = 168, 26  # [px]
BINS = 28
TAIL = 0.5  # [%] of the draws that may lie outside of the strip on either end


def distribution_strip(
    visible: Float[np.ndarray, "n"], hidden: Float[np.ndarray, "m"], measured: float, name: str
) -> str:
    """Histograms of both sides (visible upward, hidden downward) with the measured value as a line."""
    both = np.concatenate([visible, hidden])
    low, high = (float(v) for v in np.percentile(both, (TAIL, 100.0 - TAIL)))
    if np.isfinite(measured):
        low, high = min(low, measured), max(high, measured)
    pad = 0.04 * (high - low) + 1e-9
    low, high = low - pad, high + pad
    edges = np.linspace(low, high, BINS + 1)
    heights = [np.histogram(side, edges)[0] / max(len(side), 1) for side in (visible, hidden)]
    most = max(float(h.max()) for h in heights) or 1.0
    middle = HEIGHT / 2
    areas = "".join(
        f'<path class="{kind}" d="{steps(h / most * sign * (middle - 2), middle)}"/>'
        for h, sign, kind in zip(heights, (-1.0, 1.0), ("visible", "hidden"), strict=True)
    )
    mark = ""
    if np.isfinite(measured):
        x = WIDTH * (measured - low) / (high - low)
        mark = f'<path class="measured" d="M{x:.1f} 0V{HEIGHT}"/>'
    hint = f"{name}: measured {number(measured, 3)}; shown from {number(low, 3)} to {number(high, 3)}"
    return (
        f'<svg class="strip" role="img" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
        f'<title>{text(hint)}</title><path class="axis" d="M0 {middle:.0f}H{WIDTH}"/>{areas}{mark}</svg>'
    )


def steps(height: Float[np.ndarray, "bins"], base: float) -> str:
    """A histogram as a closed path, its bars `height` [px] from the base line (negative is up)."""
    width = WIDTH / len(height)
    bars = "".join(f"V{base + h:.1f}h{width:.1f}" for h in height)
    return f"M0 {base:.0f}{bars}V{base:.0f}z"
