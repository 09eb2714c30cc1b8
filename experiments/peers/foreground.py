"""Which points can belong to parts: what lies above the bin's floor, without planes larger than a part (rim, walls)."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from peers.scenes import DepthScene

FLOOR_MARGIN = 2.0  # [mm] above the floor: six deviations of a depth camera with 0.3 mm noise
SUPPORT = 7  # [px] of the window in which a pixel needs neighbours
NEIGHBOUR = 3.0  # [mm] in depth
FEWEST = 12  # neighbours of 49: a corner of a face has 16, a wall seen under 80 degrees has 7 to 10
BLUR = 13  # [px] across: normals next to a plane's edge are mixed with the next face's over 3 mm to each side
PLANE_MARGIN = 1.5  # [mm], five deviations
PLANE_ANGLE = np.cos(np.radians(15.0))  # normals fitted to 3 mm of noisy depth are good to a few degrees
LARGER = 1.5  # diameters: no face of a part is as long, and a row of touching coplanar faces seldom
TRIES = 100  # plane pieces looked at, each new one at a point that no piece has had yet


def foreground(
    scene: DepthScene, points: Float[np.ndarray, "h w 3"], normals: Float[np.ndarray, "h w 3"], diameter: float
) -> Bool[np.ndarray, "h w"]:
    """The pixels that are left for parts; `normals` are unit vectors toward the camera, 0 where there is none."""
    mask = (scene.depth > 0) & (np.abs(normals).sum(axis=-1) > 0)
    mask &= (neighbours(scene.depth) >= FEWEST) & (height_above_floor(scene, points) > FLOOR_MARGIN)
    return without_large_planes(mask, points, normals, LARGER * diameter)


def height_above_floor(scene: DepthScene, points: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Height [mm] above the world's z = 0, or above the farthest pixels' plane if the scene does not tell its place."""
    if scene.R_w2c is not None and scene.t_w2c is not None:
        return (points - scene.t_w2c) @ scene.R_w2c[:, 2]
    seen = scene.depth > 0
    far = seen & (scene.depth > np.percentile(scene.depth[seen], 70))
    normal, offset = fitted_plane(points[far][:: max(1, int(far.sum()) // 5000)])
    return points @ normal - offset


def without_large_planes(
    mask: Bool[np.ndarray, "h w"],
    points: Float[np.ndarray, "h w 3"],
    normals: Float[np.ndarray, "h w 3"],
    extent: float,
    seed: int = 0,
) -> Bool[np.ndarray, "h w"]:
    """`mask` less the connected plane pieces that are longer than `extent` [mm]."""
    mask, tried = mask.copy(), np.zeros_like(mask)
    rng = np.random.default_rng(seed)
    for _ in range(TRIES):
        rows, columns = np.nonzero(mask & ~tried)
        if not len(rows):
            break
        k = rng.integers(len(rows))
        piece = plane_piece(mask, points, normals, (int(rows[k]), int(columns[k])))
        tried |= piece
        if np.linalg.norm(np.ptp(points[piece], axis=0)) > extent:
            normal, offset = fitted_plane(points[piece])
            around = cv2.dilate(piece.astype(np.uint8), np.ones((BLUR, BLUR), np.uint8)) > 0
            mask &= ~(around & (np.abs(points @ normal - offset) < PLANE_MARGIN))
    return mask


def neighbours(depth: Float[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """How many pixels around each, itself included, have nearly its depth: few on steep walls and stray pixels."""
    half = SUPPORT // 2
    padded = np.pad(depth, half, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (SUPPORT, SUPPORT))
    near = (np.abs(windows[..., i, j] - depth) < NEIGHBOUR for i in range(SUPPORT) for j in range(SUPPORT))
    return np.sum(np.fromiter(near, dtype=np.dtype((bool, depth.shape))), axis=0)


def plane_piece(
    mask: Bool[np.ndarray, "h w"],
    points: Float[np.ndarray, "h w 3"],
    normals: Float[np.ndarray, "h w 3"],
    pixel: tuple[int, int],
) -> Bool[np.ndarray, "h w"]:
    """The connected pixels around `pixel` that lie in its plane, which is fitted again to the piece as it grows."""
    normal, offset = normals[pixel], float(points[pixel] @ normals[pixel])
    piece = np.zeros_like(mask)
    for _ in range(3):  # one normal is good for some ten mm, a piece of that size for the whole plane
        near = mask & (np.abs(points @ normal - offset) < PLANE_MARGIN) & (normals @ normal > PLANE_ANGLE)
        near[pixel] = True
        labels = cv2.connectedComponents(near.astype(np.uint8))[1]
        piece = labels == labels[pixel]
        if piece.sum() < 10:
            break
        normal, offset = fitted_plane(points[piece])
    return piece


def fitted_plane(x: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Unit normal toward the camera and offset [mm] of the least squares plane."""
    centre = x.mean(axis=0)
    normal = np.linalg.eigh((x - centre).T @ (x - centre))[1][:, 0]
    normal = -normal if normal @ centre > 0 else normal
    return normal, float(normal @ centre)
