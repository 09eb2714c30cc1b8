"""Figure 6b: the original face shape recovered by T, and d(theta) beside the model's under both rotations."""

import numpy as np
from jaxtyping import Float

from cases.recognised import Recognised
from cases.region_figures import colour_of
from cases.two_rotations import Rotation
from itree_jax.report.markup import figure, number, swatches, text
from itree_jax.report.palette import VERMILLION, css

SIDE, WIDE, HIGH = 300.0, 500.0, 250.0  # [px] of the shape, of the plot
LEFT, LOW = 42.0, 34.0  # [px] of the plot's axes
INK = 'fill="currentColor" font-size="12"'
MEASURED = VERMILLION


def shape_figure(r: Recognised, rotations: tuple[Rotation, Rotation]) -> str:
    outline = np.asarray(r.features.outline, float)
    # wide and pale under thin and broken, so that both are seen where they coincide
    styles = 'stroke-width="4.5" opacity="0.6"', 'stroke-width="1.8" stroke-dasharray="5 3"'
    curves = [(k.outline, css(colour_of(k.name)), style) for k, style in zip(rotations, styles, strict=True)]
    curves.append((outline, css(MEASURED), 'stroke-width="2.2"'))
    most = 1.08 * max(float(c.max()) for c, _, _ in curves)
    svg = (
        f'<svg role="img" viewBox="0 0 {SIDE + WIDE + 20:.0f} {SIDE:.0f}" width="100%" style="max-width:1000px">'
        f"<title>recovered face and d(theta)</title>{star(outline, curves, most)}{plot(curves, most)}</svg>"
    )
    legend = swatches([
        (css(MEASURED), "recovered from the target region"),
        *((css(colour_of(k.name)), f"model, rotation {k.name} (region of faces {k.model.faces})") for k in rotations),
    ])  # fmt: skip
    distance = " and ".join(
        f"{number(100.0 * relative_distance(outline, k.outline))} % (rotation {text(k.name)})" for k in rotations
    )
    caption = (
        "Left: the face after T with its mass centre; the maximum inertia direction points right. Right: d(θ) from "
        f"that direction. Root mean square distance from the representative attitude's: {distance} of the mean radius."
    )
    return figure(svg, "6b · Original face shape d(θ)", caption, legend)


def relative_distance(outline: Float[np.ndarray, "n"], model: Float[np.ndarray, "n"]) -> float:
    """As rule A5 measures it."""
    return float(np.sqrt(np.mean((outline - model) ** 2)) / model.mean())


def star(outline: Float[np.ndarray, "n"], curves: list, most: float) -> str:
    """The measured shape as rays from the mass centre, the models' around it."""
    theta = np.arange(len(outline)) * (2.0 * np.pi / len(outline))
    scale, middle = 0.5 * SIDE / most, 0.5 * SIDE

    def points(d: Float[np.ndarray, "n"]) -> np.ndarray:
        return np.stack([middle + scale * d * np.cos(theta), middle + scale * d * np.sin(theta)], axis=1)

    rays = "".join(f"M{middle:.0f} {middle:.0f}L{x:.1f} {y:.1f}" for x, y in points(outline))
    lines = "".join(
        f'<polygon fill="none" stroke="{colour}" {style} points="{joined(points(d))}"/>' for d, colour, style in curves
    )
    return (
        f'<path d="{rays}" stroke="currentColor" stroke-width="0.5" opacity="0.45"/>{lines}'
        f'<circle cx="{middle:.0f}" cy="{middle:.0f}" r="3.5" fill="currentColor"/>'
    )


def plot(curves: list, most: float) -> str:
    """d over theta."""
    x0, y0 = SIDE + 20.0 + LEFT, HIGH
    wide, high = WIDE - LEFT - 24.0, HIGH - 16.0

    def at(theta: float, d: float) -> tuple[float, float]:
        return x0 + theta / 360.0 * wide, y0 - d / most * high

    parts = []
    for degrees in range(0, 361, 90):
        x, _ = at(degrees, 0.0)
        parts.append(f'<path d="M{x:.1f} {y0:.0f}v-{high:.0f}" stroke="currentColor" opacity="0.15"/>')
        parts.append(f'<text x="{x:.1f}" y="{y0 + 17:.0f}" text-anchor="middle" {INK}>{degrees}°</text>')
    for d in range(0, int(most) + 1, 10):
        _, y = at(0.0, d)
        parts.append(f'<path d="M{x0:.0f} {y:.1f}h{wide:.0f}" stroke="currentColor" opacity="0.15"/>')
        parts.append(f'<text x="{x0 - 6:.0f}" y="{y + 4:.1f}" text-anchor="end" {INK}>{d}</text>')
    parts.append(f'<text x="{x0 + wide / 2:.0f}" y="{y0 + LOW:.0f}" text-anchor="middle" {INK}>θ</text>')
    parts.append(f'<text x="{x0 - 34:.0f}" y="12" {INK}>d [mm]</text>')
    for d, colour, style in curves:
        theta = np.arange(len(d) + 1) * (360.0 / len(d))
        line = np.array([at(t, v) for t, v in zip(theta, np.append(d, d[0]), strict=True)])
        parts.append(f'<polyline fill="none" stroke="{colour}" {style} points="{joined(line)}"/>')
    return "".join(parts)


def joined(points: Float[np.ndarray, "n 2"]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
