"""Small worlds with parts at known poses."""

import numpy as np
from itree_cad.part import Part
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detection
from itree_jax.world import BinWalls, PlacedPart, Prism, World
from itree_jax.world.dodecagon import around

DOWN = np.diag([1.0, -1.0, -1.0])  # the upright frame of a camera that looks straight down
FLOOR = -900.0


def pose(x: float, y: float, z: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """T_cam_obj of a part at a place in the upright frame, `z` [mm] above the floor, turned by Euler angles [deg]."""
    T = np.eye(4)
    T[:3, :3] = DOWN @ Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    T[:3, 3] = DOWN @ np.array([x, y, FLOOR + z])
    return T


def placed(index: int, part: Part, T_cam_obj: np.ndarray, **more) -> PlacedPart:
    score, R, t = more.pop("score", 1.0), T_cam_obj[:3, :3], T_cam_obj[:3, 3]
    detection = Detection(0, 0, 1, score, R, t, offer_rank=index, **more)
    return PlacedPart(index, detection, part)


def prism(x: float, y: float, height: float, radius: float = 10.0, region: int = 7) -> Prism:
    a = np.arange(24) * 2 * np.pi / 24
    outline = around(np.array([x, y]) + radius * np.stack([np.cos(a), np.sin(a)], axis=-1), 0.0)
    return Prism(region, outline, FLOOR + height, FLOOR, "not recognised")


def world(parts, prisms=(), bin_: BinWalls | None = None) -> World:
    return World(tuple(parts), tuple(prisms), bin_, DOWN, FLOOR)


def moved(one: World, T: np.ndarray) -> World:
    """The same world in the frame of a camera that was moved: T takes the old frame to the new one."""
    R, t = T[:3, :3], T[:3, 3]
    R_cam_up = R @ one.R_cam_up
    shift = R_cam_up.T @ t  # of the upright frame's contents
    parts = tuple(placed(p.index, p.part, T @ p.T_cam_obj, score=p.detection.score) for p in one.parts)
    prisms = tuple(
        Prism(p.region, p.outline_up + shift[:2], p.top + float(shift[2]), p.bottom + float(shift[2]), p.reason)
        for p in one.prisms
    )
    bin_ = one.bin
    if bin_ is not None:
        bin_ = BinWalls(bin_.inner_size, bin_.wall_height, bin_.wall_thickness, T @ bin_.T_cam_bin)
    return World(parts, prisms, bin_, R_cam_up, one.floor + float(shift[2]))
