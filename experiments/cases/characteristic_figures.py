"""Figures 8d and 8e: which surface characteristics lie where two models would have them."""

from dataclasses import dataclass

import jax
import numpy as np
from itree_kernels.mesh import RayMesh
from jaxtyping import Float, Int

from cases.canvas import Canvas, box_around
from cases.case import attitude_name, group_labelled
from cases.edge_figures import in_image
from cases.highest_region import HIGHEST
from cases.recognised import Recognised
from cases.two_rotations import Rotation, edges_found, mean_support
from cases.work_models import RegionModel, region_models
from itree_jax.features.characteristic_areas import area_support, areas_on_image
from itree_jax.features.characteristics import CHARACTERISTICS
from itree_jax.report.markup import figure, image, number, swatches
from itree_jax.report.palette import GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, css

COLOURS = (SKY, ORANGE, GREEN, PURPLE, VERMILLION)  # of CHARACTERISTICS
WIDTH = 520  # [px]: three pictures stand side by side
AGREES = 0.5  # of a rectangle
PAPER = (250, 250, 250)

_support = jax.jit(area_support)


@dataclass(frozen=True)
class Laid:
    """A model's rectangles laid on the region under one rotation."""

    model: RegionModel
    turn: float
    polygons: Float[np.ndarray, "n 4 2"]  # window pixels
    support: Float[np.ndarray, "n"]

    @property
    def together(self) -> float:
        """Supports weighted with the surface of the pieces."""
        surface = np.array([area.area for area in self.model.areas])
        return float(self.support @ surface / surface.sum()) if len(surface) else 0.0


def characteristic_figures(r: Recognised, mesh: RayMesh) -> str:
    """The region's own distribution, then the models that the case's last node tells apart."""
    labels = (r.case.against, r.case.label)
    models = [(label, best_laid(r, region_models(mesh, r.tree, group_labelled(r.tree, label)))) for label in labels]
    return distribution_figure(r) + "".join(model_figure(r, label, laid) for label, laid in models)


def best_laid(r: Recognised, models: tuple[RegionModel, ...]) -> Laid:
    """Region and half turn at which edges and characteristics agree best together, as rule L7 compares them."""
    laid = [lay(r, model, turn) for model in models for turn in (0.0, np.pi)]

    def joint(one: Laid) -> float:
        rotation = Rotation("", one.model, one.turn, np.eye(3), 0.0)
        return one.together + mean_support(rotation, edges_found(r, rotation))

    return max(laid, key=joint)


def lay(r: Recognised, model: RegionModel, turn: float) -> Laid:
    f = r.frame
    polygons = areas_on_image(model.areas, f.T, f.centroid, f.alpha + turn, f.pitch, f.size)
    pairs = zip(polygons, model.areas, strict=True)
    support = [float(_support(r.memberships, p, area.characteristic)) for p, area in pairs]
    return Laid(model, turn, polygons, np.array(support))


def likeliest(r: Recognised) -> Int[np.ndarray, "s s"]:
    """Characteristic of every pixel of the window; -1 off the region, -2 on it but not known."""
    known = r.memberships.sum(axis=-1) > 0
    on_region = np.asarray(r.window.mask)
    return np.where(known, r.memberships.argmax(axis=-1), np.where(on_region, -2, -1))


def distribution_figure(r: Recognised) -> str:
    canvas = plain_canvas(r)
    kind = likeliest(r)
    paint(canvas, r, kind >= 0, kind)
    paint(canvas, r, kind == -2, kind)
    shares = ", ".join(
        f"{name} {number(100.0 * share, 0)} %" for name, share in zip(CHARACTERISTICS, r.features.shares, strict=True)
        if share > 0.005
    )
    caption = f"Share of the surface: {shares}; the rest lies at a crease or at the rim."
    used = [k for k in range(len(CHARACTERISTICS)) if (kind == k).any()]
    legend = swatches([*((css(COLOURS[k]), CHARACTERISTICS[k]) for k in used), (css(GREY), "not known")])
    title = "Surface characteristics measured"
    return figure(image(canvas.picture, "surface characteristics of the target region"), title, caption, legend)


def model_figure(r: Recognised, label: str, laid: Laid) -> str:
    """Only pixels that agree with a rectangle are painted: white space is what the model does not explain."""
    canvas = plain_canvas(r)
    kind = likeliest(r)
    for polygon, area in zip(laid.polygons, laid.model.areas, strict=True):
        paint(canvas, r, inside(polygon, len(kind)) & (kind == area.characteristic), kind)
    for polygon, area, s in zip(laid.polygons, laid.model.areas, laid.support, strict=True):
        canvas.outline(in_image(r, polygon), COLOURS[area.characteristic], 3 if s >= AGREES else 2, dashed=s < AGREES)
    for polygon, area, s in zip(laid.polygons, laid.model.areas, laid.support, strict=True):
        words = f"{CHARACTERISTICS[area.characteristic].split()[-1]} {s:.2f}"
        canvas.label(in_image(r, polygon).mean(axis=0), words, COLOURS[area.characteristic])
    name = "8e" if label == r.case.label else "8d"
    title = f"{name if r.case.number == 3 else 'As ' + name} · Where {attitude_name(label)} would have them"
    caption = (
        "Rectangles of the representative attitude, at the rotation at which edges and characteristics agree best; "
        "painted is what has the supposed characteristic, the number is its share of the rectangle (broken line: under "
        "a half). "
        f"Together, by surface, <b>{number(laid.together, 2)}</b>."
    )
    return figure(image(canvas.picture, f"surface characteristics against {label}"), title, caption)


def plain_canvas(r: Recognised) -> Canvas:
    """The region white on grey."""
    mask = r.measured.found.mask(HIGHEST)
    picture = np.where(mask[..., None], np.uint8(PAPER[0]), (0.35 * r.view.background).astype(np.uint8))
    return Canvas(picture, box_around(mask), WIDTH)


def paint(canvas: Canvas, r: Recognised, where: np.ndarray, kind: Int[np.ndarray, "s s"]) -> None:
    """Window pixels in the colour of their characteristic."""
    square = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    pixels = np.argwhere(where)
    polygons = [in_image(r, np.array([u, v]) + square) for v, u in pixels]
    canvas.fill(polygons, [COLOURS[kind[v, u]] if kind[v, u] >= 0 else GREY for v, u in pixels], 0.8)


def inside(polygon: Float[np.ndarray, "4 2"], size: int) -> np.ndarray:
    """Pixels of the window whose centres lie in a parallelogram."""
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    edge = np.roll(polygon, -1, axis=0) - polygon
    side = [e[0] * (y - p[1]) - e[1] * (x - p[0]) for e, p in zip(edge, polygon, strict=True)]
    return np.all(np.array(side) >= 0, axis=0) | np.all(np.array(side) <= 0, axis=0)
