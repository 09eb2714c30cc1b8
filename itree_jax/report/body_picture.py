"""Bodies drawn once, for a page that is printed or cannot turn them: faces from far to near, then edges."""

import cv2
import numpy as np
from jaxtyping import Float

from itree_jax.report.body import NEARER, Body, Stage
from itree_jax.report.mesh_packing import DrawnSolid
from itree_jax.report.palette import WHITE, Rgb
from itree_jax.report.scene_pictures import NOTHING, SUBPIXEL_BITS, Picture, badge

FIELD = 0.6  # [rad], as in world3d.js
AMBIENT = 0.38  # likewise: share of the colour on a face seen edge on
SIZE = (640, 420)  # [px] width and height


def body_picture(bodies: list[Body], solids: list[DrawnSolid], stage: Stage) -> Picture:
    """The bodies as the page's 3-D view first shows them; `solids` are theirs, one each."""
    picture = np.full((SIZE[1], SIZE[0], 3), NOTHING, np.uint8)
    eye = stage.centre + stage.radius / np.sin(FIELD / 2) / NEARER * stage.toward
    placed = [s.vertices @ b.T_cam_body[:3, :3].T + b.T_cam_body[:3, 3] for b, s in zip(bodies, solids, strict=True)]
    faces: list[tuple[float, np.ndarray, Rgb]] = []
    for body, solid, X_cam in zip(bodies, solids, placed, strict=True):
        if body.opacity == 1.0:
            faces += shaded_faces(X_cam[solid.triangles], body.colour, eye, stage)
    for _, corners, colour in sorted(faces, key=lambda face: -face[0]):
        cv2.fillConvexPoly(picture, corners, colour, cv2.LINE_AA, SUBPIXEL_BITS)
    for body, solid, X_cam in zip(bodies, solids, placed, strict=True):
        if body.opacity < 1.0:  # what is transparent hides nothing: its edges are enough
            colour = WHITE if body.kind == "camera" else body.colour
            lines = list(fixed(projected(X_cam[solid.edges], eye, stage)))
            cv2.polylines(picture, lines, False, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    for body in bodies:
        if body.label:
            middle = projected(body.corners_cam.mean(axis=0), eye, stage)
            badge(picture, middle, body.label, body.colour, 0.45)
    return picture


def shaded_faces(
    triangles_cam: Float[np.ndarray, "n 3 3"], colour: Rgb, eye: Float[np.ndarray, "3"], stage: Stage
) -> list[tuple[float, np.ndarray, Rgb]]:
    """Distance [mm], corners and colour of the triangles that face the eye."""
    normal = np.cross(triangles_cam[:, 1] - triangles_cam[:, 0], triangles_cam[:, 2] - triangles_cam[:, 0])
    sight = eye - triangles_cam.mean(axis=1)
    away = np.linalg.norm(sight, axis=1)
    cosine = (normal * sight).sum(axis=1) / np.maximum(np.linalg.norm(normal, axis=1) * away, 1e-12)
    shown = cosine > 0
    corners = fixed(projected(triangles_cam[shown], eye, stage))
    shade = (AMBIENT + (1.0 - AMBIENT) * cosine[shown])[:, None] * np.array(colour, float)
    return [
        (float(z), c, (int(r), int(g), int(b)))
        for z, c, (r, g, b) in zip(away[shown], corners, np.round(shade), strict=True)
    ]


def projected(X_cam: Float[np.ndarray, "*n 3"], eye: Float[np.ndarray, "3"], stage: Stage) -> Float[np.ndarray, "*n 2"]:
    """Image points [px] of points [mm] of the camera frame, seen from `eye`."""
    right = np.cross(stage.up, stage.toward)
    right /= np.linalg.norm(right)
    top = np.cross(stage.toward, right)
    seen = (X_cam - eye) @ np.stack([right, top, -stage.toward], axis=1)
    focal = SIZE[1] / (2.0 * np.tan(FIELD / 2))
    return np.stack([SIZE[0], SIZE[1]]) / 2 + focal * seen[..., :2] * np.array([1.0, -1.0]) / seen[..., 2:]


def fixed(uv: Float[np.ndarray, "*n 2"]) -> np.ndarray:
    """As OpenCV's drawing functions take points with `SUBPIXEL_BITS`."""
    return np.round(uv * 2**SUBPIXEL_BITS).astype(np.int32)
