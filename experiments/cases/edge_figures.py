"""Figures 7c and 8c: edges of the region, the areas searched, and the edges found, under both rotations."""

import numpy as np

from cases.canvas import Canvas
from cases.recognised import Recognised
from cases.region_figures import target_canvas
from cases.two_rotations import Rotation, edges_found, mean_support, right_one
from itree_jax.features.prominent_edges import on_image, search_areas
from itree_jax.features.straight_edges import LEAST_STRENGTH
from itree_jax.report.markup import figure, image, number, swatches
from itree_jax.report.palette import GREY, VERMILLION, WHITE, YELLOW, css

FIGURE = {1: "As 7c", 2: "7c", 3: "8c"}
FOUND = 0.5  # of an edge's length: it exists
DOTS, AREAS, EDGES, NOT_THERE = WHITE, YELLOW, VERMILLION, GREY


def edge_figures(r: Recognised, rotations: tuple[Rotation, Rotation]) -> str:
    return "".join(edge_figure(r, rotation, right_one(rotations) is rotation) for rotation in rotations)


def edge_figure(r: Recognised, rotation: Rotation, right: bool) -> str:
    """Edges under one supposed rotation."""
    canvas = target_canvas(r, 0.7)
    draw_edge_map(canvas, r)
    support = edges_found(r, rotation)
    f, edges = r.frame, rotation.model.edges
    placed = on_image(
        edges, f.T.astype(np.float32), f.centroid.astype(np.float32), f.alpha + rotation.turn, f.pitch, f.size
    )
    for area in search_areas(placed, f.centre_px.astype(np.float32)):
        canvas.outline(in_image(r, area), AREAS, 2, dashed=True, rim=False)
    for edge, s in zip(placed.reshape(-1, 2, 2), support, strict=True):
        there = s >= FOUND
        canvas.line(in_image(r, edge), EDGES if there else NOT_THERE, 4 if there else 2)
    for edge, s in zip(placed.reshape(-1, 2, 2), support, strict=True):
        canvas.label(in_image(r, edge).mean(axis=0), f"{s:.2f}", EDGES if s >= FOUND else NOT_THERE)
    legend = swatches([
        (css(DOTS), "edge map (dots)"), (css(AREAS), "search area (broken)"), (css(EDGES), "edge found (solid)"),
        (css(NOT_THERE), "edge not found (thin)"),
    ])  # fmt: skip
    together = number(mean_support(rotation, support), 2)
    title = f"{FIGURE[r.case.number]} · Edges under rotation {rotation.name}"
    caption = (
        f"Model: region of faces {rotation.model.faces}, {len(edges)} edges. Numbers: share of an edge along which "
        f"the map has an edge of its direction; together, by length, <b>{together}</b>. This rotation is the "
        f"{'right' if right else 'wrong'} one in truth."
    )
    return figure(image(canvas.picture, f"edges under rotation {rotation.name}"), title, caption, legend)


def draw_edge_map(canvas: Canvas, r: Recognised) -> None:
    """A short stroke at each pixel of the window that has an edge, in its direction."""
    strength = np.linalg.norm(r.edges, axis=-1)
    for v, u in np.argwhere(strength >= LEAST_STRENGTH):
        half = 0.5 * np.arctan2(r.edges[v, u, 1], r.edges[v, u, 0])
        along = 0.3 * np.array([np.cos(half), np.sin(half)])
        canvas.stroke(in_image(r, np.array([u, v]) + np.outer([-1.0, 1.0], along)), DOTS, 2)


def in_image(r: Recognised, ij: np.ndarray) -> np.ndarray:
    """Window pixels to image points."""
    return r.frame.window_to_image(r.frame.pixels_to_window(ij))


