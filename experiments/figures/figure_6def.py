"""Figures 6d to 6f of Ikeuchi 1987, of the reconstructed part in the demo's bin.

    python experiments/figures/figure_6def.py --out FOLDER [--tree TREE] [--gripper GRIPPER] [--seed N]

Writes figure_6d.png (one part's position and attitude, and its neighbouring regions as dodecagonal prisms),
figure_6e.png (two collision-free configurations of the gripper, of whose palm only the beginning is drawn) and
figure_6f.png (the scene described).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
import tyro
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh

from itree_jax.cli.runtime import start_jax
from itree_jax.compile import compile_tree
from itree_jax.detections import Detections
from itree_jax.grasp import Grasp, Gripper, find_grasps, grasp_tables, load_gripper
from itree_jax.grasp.body import pieces
from itree_jax.prepared import prepare
from itree_jax.recognition import recognize
from itree_jax.report.palette import ORANGE, SKY, VERMILLION
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.simulate import bundled_poses, demo_bin
from itree_jax.simulate.bin import walls_of
from itree_jax.tree.tree_file import load_tree
from itree_jax.world import World, world_meshes, world_model

NOT_YET = "not interpreted yet"
COLOURS = {"part": SKY, "prism": ORANGE, "bin": (205, 205, 205), "floor": (232, 232, 232), "gripper": VERMILLION}
SIZE, SHRINK = (1800, 1300), 2  # [px] rendered, and the factor by which the picture is smaller
FROM_ABOVE, AROUND, DISTANCE = np.radians(42.0), np.radians(-28.0), 1500.0  # where the picture is taken from; [mm]
FOCAL = 6600.0  # [px]
CREASE = 0.9  # cosine between the normals of two pixels beyond which a line is drawn
LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])  # upright frame, toward the light
PALM = 10.0  # [mm] of the palm that are drawn: all of it would hide the part
SIDES = slice(150, 750)  # [px] of a picture's width that the bin is within
MARGIN = 12  # [px] of white around a picture
SHADE = 0.45  # of the colour where the light doesn't reach

Solids = Sequence[tuple[trimesh.Trimesh, str]]


@dataclass(frozen=True)
class Config:
    """What to draw."""

    out: Path  # folder for the pictures
    tree: Path | None = None  # compiled for bundled:bench; None: it is compiled here
    gripper: str = "bundled:jaw"
    seed: int = 0


def main(config: Config) -> None:
    start_jax()
    sensor = bundled_sensor("bench")
    settled = bundled_poses()
    tree = load_tree(config.tree) if config.tree else compile_tree(bundled_part(settled.part), sensor)
    scene, _ = demo_bin(sensor, config.seed)
    answers = recognize(prepare(tree), scene.images, scene.sensor, scene.depth, scene.R_w2c)
    assert isinstance(answers, Detections)
    gripper = load_gripper(config.gripper)

    def world_of(found: Detections) -> World:
        return world_model(found, [tree], scene.sensor, scene.depth, scene.R_w2c, walls_of(settled.bin, sensor))

    first = world_of(only_the_first(answers))
    grasps = find_grasps(first, grasp_tables([tree], gripper)).grasps
    config.out.mkdir(parents=True, exist_ok=True)
    pictures = {
        "figure_6d": drawn(solids_of(first), first),
        "figure_6e": np.concatenate([
            drawn([*solids_of(first), *holding(gripper, grasp)], first)[:, SIDES] for grasp in two_of(grasps)
        ], axis=1),
        "figure_6f": drawn(solids_of(world := world_of(answers)), world),
    }
    for name, picture in pictures.items():
        cv2.imwrite(str(config.out / f"{name}.png"), cropped(picture)[..., ::-1])


def only_the_first(answers: Detections) -> Detections:
    """What is known when the highest region has been interpreted and no other one."""
    assert answers.labels is not None
    regions = [int(r) for r in np.unique(answers.labels) if r >= 0]
    left = tuple({"region": r, "reason": NOT_YET} for r in regions)
    return replace(answers, detections=answers.by_offer[:1], not_recognised=left)


def two_of(grasps: Sequence[Grasp]) -> list[Grasp]:
    """The best grasp, and the best one that closes in quite another direction."""
    across = [g for g in grasps if abs(g.T_cam_grasp[:3, 0] @ grasps[0].T_cam_grasp[:3, 0]) < 0.5]
    return [grasps[0], (across or list(grasps))[0]]


def solids_of(world: World) -> list[tuple[trimesh.Trimesh, str]]:
    return [(one.mesh, one.kind) for one in world_meshes(world)]


def holding(gripper: Gripper, grasp: Grasp) -> list[tuple[trimesh.Trimesh, str]]:
    """The open gripper at its grasp."""
    found = []
    gripper = replace(gripper, palm=(*gripper.palm[:2], PALM))
    for piece in pieces(gripper, grasp.width):
        if piece.arrives:
            mesh = trimesh.convex.convex_hull(piece.X_grip)
            mesh.apply_transform(grasp.T_cam_grasp)
            found.append((mesh, "gripper"))
    return found


def drawn(solids: Solids, world: World) -> np.ndarray:
    """Solids in their colours with lines along their edges, seen from the side [height, width, 3]."""
    R_view_cam, t = viewpoint(solids, world)
    meshes = [ray_mesh(m.vertices @ R_view_cam.T + t, m.faces, np.zeros(len(m.faces), np.int32)) for m, _ in solids]
    width, height = SIZE
    camera = Camera("pinhole", FOCAL, FOCAL, (width - 1) / 2, (height - 1) / 2, width, height)
    light = (R_view_cam @ world.R_cam_up @ LIGHT)[None]
    n = len(meshes)
    seen = render_scene(meshes, np.arange(n), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), camera, light,
                        np.ones(1), Material(1.0))  # fmt: skip
    instance = seen.instance.astype(int)
    colour = np.array([COLOURS[kind] for _, kind in solids], float)[instance]
    brightness = SHADE + (1.0 - SHADE) * np.clip(seen.images[0], 0.0, 1.0)
    picture = np.where(instance[..., None] >= 0, colour * brightness[..., None], 255.0)
    picture[lines(instance, seen.normal)] = 30.0
    small = cv2.resize(picture, (width // SHRINK, height // SHRINK), interpolation=cv2.INTER_AREA)
    return np.clip(small, 0, 255).astype(np.uint8)


def cropped(picture: np.ndarray) -> np.ndarray:
    """Without the white around it."""
    rows, columns = (np.flatnonzero((picture < 255).any(axis=(2, other))) for other in (1, 0))
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    return picture[top : rows[-1] + MARGIN, left : columns[-1] + MARGIN]


def viewpoint(solids: Solids, world: World) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation [mm] camera -> a viewer who stands aside and looks at the middle of the world."""
    look = np.array([np.cos(FROM_ABOVE) * np.sin(AROUND), np.cos(FROM_ABOVE) * np.cos(AROUND), -np.sin(FROM_ABOVE)])
    right = np.cross(look, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_view_up = np.stack([right, np.cross(look, right), look])
    corners = np.concatenate([np.asarray(m.vertices) for m, kind in solids if kind != "gripper"])
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) + 0.03 * DISTANCE * world.up_cam
    R_view_cam = R_view_up @ world.R_cam_up.T
    return R_view_cam, np.array([0.0, 0.0, DISTANCE]) - R_view_cam @ middle


def lines(instance: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Pixels between two solids, or where a surface turns sharply."""
    found = np.zeros(instance.shape, bool)
    for axis in (0, 1):
        other, turned = np.roll(instance, -1, axis), (normal * np.roll(normal, -1, axis)).sum(-1)
        edge = (instance != other) | ((instance >= 0) & (turned < CREASE))
        found |= edge | np.roll(edge, 1, axis)
    found[[0, -1]], found[:, [0, -1]] = False, False
    return found


if __name__ == "__main__":
    main(tyro.cli(Config))
