"""The edges of a scene by their labels: what counts as the parts' shape, and what is a cast shadow."""

import cv2
import numpy as np

from itree_jax.report.markup import figure, image, number, swatches
from itree_jax.report.palette import GREEN, GREY, PURPLE, SKY, YELLOW, Rgb, css
from itree_jax.report.pose_pictures import magnification
from itree_jax.report.scene_pictures import SUBPIXEL_BITS, Picture, scaled, scaled_uv, subpixel
from itree_jax.report.scene_view import SceneView
from itree_jax.sensing.edges import EdgeLabel, SceneEdges, scene_edges

EDGE_WIDTH = 640  # [px] of the picture: pixel for pixel, edges are thin anyway
COLOURS: dict[EdgeLabel, tuple[Rgb, str]] = {
    EdgeLabel.OUTLINE: (YELLOW, "outline"),
    EdgeLabel.CREASE: (SKY, "crease"),
    EdgeLabel.GEOMETRIC: (GREEN, "outline or crease"),
    EdgeLabel.SHADOW: (PURPLE, "cast shadow"),
    EdgeLabel.UNKNOWN: (GREY, "not told"),
}


def edge_figure(view: SceneView) -> str:
    """Edges of the images; of a depth camera, which has none, nothing."""
    scene = view.scene
    if not len(scene.images):
        return ""
    edges = scene_edges(scene.images, scene.sensor, view.needle, scene.depth)
    picture = edge_picture(view.background, edges, magnification(view.background.shape[1], EDGE_WIDTH))
    there = [label for label in COLOURS if (edges.label == label).any()]
    legend = swatches([(css(COLOURS[label][0]), COLOURS[label][1]) for label in there])
    share = 100.0 * float(np.mean(edges.label == EdgeLabel.SHADOW)) if len(edges.label) else 0.0
    caption = (
        "Edge points of all lights together. A cast shadow belongs to one light and its dark side lies toward it "
        f"({number(share, 0)} % of the points): it is no shape of a part."
    )
    return figure(image(picture, "edges of the image by their labels"), "Edges", caption, legend)


def edge_picture(background: Picture, edges: SceneEdges, scale: float) -> Picture:
    """Each point as a short line along its edge, on a dim background."""
    picture = (scaled(background, scale) * 0.45).astype(np.uint8)
    width = max(1, round(0.75 * scale))
    along = np.stack([-edges.direction[:, 1], edges.direction[:, 0]], axis=-1)
    ends = zip(scaled_uv(edges.uv - 0.5 * along, scale), scaled_uv(edges.uv + 0.5 * along, scale), strict=True)
    for label, (a, b) in zip(edges.label.tolist(), ends, strict=True):
        colour = COLOURS[EdgeLabel(label)][0]
        cv2.line(picture, subpixel(a), subpixel(b), colour, width, cv2.LINE_AA, SUBPIXEL_BITS)
    return picture
