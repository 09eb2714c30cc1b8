"""The work models of a representative attitude, drawn in the face frame of its target region (Ikeuchi 1987, sec. 2.1.3
and 3.4): x along the maximum inertia direction, [mm] on the face from the mass centre."""

import numpy as np
from jaxtyping import Float

from itree_jax.report.markup import MINUS, number, text
from itree_jax.report.palette import GREEN, ORANGE, PURPLE, SKY, VERMILLION, css
from itree_jax.tree.leaf_model import LeafModel

SIDE = 220.0  # [px] of a picture
RIM = 14.0  # [px] around what is drawn
BAR_H = 14.0  # [px] more for the scale bar
BAR_LENGTHS = (1, 2, 5, 10, 20, 50, 100, 200, 500)  # [mm]
COLOURS = (SKY, ORANGE, GREEN, PURPLE, VERMILLION)  # of CHARACTERISTICS
SHORT = ("P", "C", "E+", f"E{MINUS}", "H")  # colour is not their only sign


def shape_figure(model: LeafModel) -> str:
    """d(theta) as a polar outline, the rectangle with the face's moments, and the vectors to the brother regions."""
    to_px = Scale(model)
    a, b = half_sides(model)
    corners = to_px(np.array([[-a, -b], [a, -b], [a, b], [-a, b]]))
    arms = to_px(np.array([[-a, 0.0], [a, 0.0], [0.0, -b], [0.0, b]]))
    arrows = "".join(brother_arrow(to_px, brother) for brother in model.brothers if brother[5] > 0)
    return panel(
        f'<path class="outline" d="{closed(to_px(outline_points(model)))}"/>'
        f'<path class="moments" d="{closed(corners)}"/>'
        f'<path class="moments" d="M{xy(arms[0])}L{xy(arms[1])}M{xy(arms[2])}L{xy(arms[3])}"/>{arrows}{to_px.bar()}',
        f"region of {number(model.area, 0)} mm²: d(theta), the rectangle of the same moments, brother regions",
        to_px.half_height,
    )


def surface_figure(model: LeafModel) -> str:
    """Prominent edges as lines, and the existence rectangles of the surface characteristics."""
    to_px = Scale(model)
    areas = "".join(
        area(to_px(vertices), int(c)) for vertices, c in zip(model.areas, model.area_characteristic, strict=True)
    )
    lines = ""
    for ends, strength in zip(model.edges, model.edge_strength, strict=True):
        start, end = to_px(ends.reshape(2, 2))
        lines += f'<path class="line" stroke-width="{1.0 + 2.5 * float(strength):.1f}" d="M{xy(start)}L{xy(end)}"/>'
    outline = f'<path class="faint" d="{closed(to_px(outline_points(model)))}"/>'
    return panel(
        outline + areas + lines + to_px.bar(),
        f"{len(model.edges)} prominent edges and {len(model.areas)} rectangles of one surface characteristic",
        to_px.half_height,
    )


def area(vertices: Float[np.ndarray, "4 2"], characteristic: int) -> str:
    colour = css(COLOURS[characteristic])
    x, y = vertices.mean(axis=0)
    return (
        f'<path class="area" fill="{colour}" stroke="{colour}" d="{closed(vertices)}"/>'
        f'<text class="middle" x="{x:.1f}" y="{y + 4:.1f}">{SHORT[characteristic]}</text>'
    )


def brother_arrow(to_px: "Scale", brother: Float[np.ndarray, "fields"]) -> str:
    """From the mass centre toward a brother, as far as the picture goes, with the distance in space."""
    distance = float(np.linalg.norm(brother[:3]))
    in_face = np.asarray(brother[:2], float)
    length = max(float(np.linalg.norm(in_face)), 1e-6)
    start, end = to_px(np.stack([np.zeros(2), in_face * min(1.0, 0.9 * to_px.reach / length)]))
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-6)
    across = np.array([-along[1], along[0]])
    head = [end - 8.0 * along + 4.0 * across, end, end - 8.0 * along - 4.0 * across]
    place = "end" if end[0] > SIDE / 2 else ""
    return (
        f'<path class="arrow" d="M{xy(start)}L{xy(end)}M{xy(head[0])}L{xy(head[1])}L{xy(head[2])}"/>'
        f'<text class="{place}" x="{end[0]:.1f}" y="{end[1] - 8 if end[1] > 24 else end[1] + 16:.1f}">'
        f"{number(distance, 0)} mm</text>"
    )


def outline_points(model: LeafModel) -> Float[np.ndarray, "n 2"]:
    theta = 2.0 * np.pi / len(model.outline) * np.arange(len(model.outline))
    return model.outline[:, None] * np.stack([np.cos(theta), np.sin(theta)], axis=1)


def half_sides(model: LeafModel) -> tuple[float, float]:
    """[mm] of the rectangle with the face's moments: I_max = (4/3) a^3 b, I_min = (4/3) a b^3."""
    I_max, I_min = (max(float(moment), 1e-6) for moment in model.inertia[:2])
    ratio = np.sqrt(I_max / I_min)
    a = float((0.75 * I_max * ratio) ** 0.25)
    return a, float(a / ratio)


class Scale:
    """Face frame [mm] to picture [px]; both pictures of a face have one scale and one height."""

    def __init__(self, model: LeafModel) -> None:
        ends = np.concatenate([
            outline_points(model), model.edges.reshape(-1, 2), model.areas.reshape(-1, 2), [half_sides(model)]
        ])  # fmt: skip
        self.reach = max(float(np.abs(ends).max()), 1.0)
        self.px_per_mm = (SIDE / 2 - RIM) / self.reach
        alone = not (model.brothers[:, 5] > 0).any()  # else an arrow may point anywhere
        tall = RIM + BAR_H + self.px_per_mm * float(np.abs(ends[:, 1]).max())
        self.half_height = tall if alone else SIDE / 2 + BAR_H

    def __call__(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return SIDE / 2 + self.px_per_mm * np.asarray(points, float)

    def bar(self) -> str:
        """A scale bar in the lower left corner, as long as a third of the picture at most."""
        longest = SIDE / 3 / self.px_per_mm
        length = max((b for b in BAR_LENGTHS if b <= longest), default=BAR_LENGTHS[0])
        bottom = SIDE / 2 + self.half_height
        return (
            f'<path class="axis" d="M4 {bottom - 8:.0f}v4h{length * self.px_per_mm:.1f}v-4"/>'
            f'<text class="small" x="6" y="{bottom - 9:.0f}">{length} mm</text>'
        )


def panel(inside: str, title: str, half_height: float = SIDE / 2) -> str:
    """A picture of the given height about the middle of a square."""
    box = f"0 {SIDE / 2 - half_height:.1f} {SIDE:.0f} {2.0 * half_height:.1f}"
    return f'<svg class="panel" role="img" viewBox="{box}"><title>{text(title)}</title>{inside}</svg>'


def closed(points: Float[np.ndarray, "n 2"]) -> str:
    return "M" + "L".join(xy(p) for p in points) + "z"


def xy(point: Float[np.ndarray, "2"]) -> str:
    return f"{point[0]:.1f} {point[1]:.1f}"
