"""The world model as triangle meshes: for pictures, for files (GLB, PLY), and for a gripper to collide with."""

from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.visual import ColorVisuals

from itree_jax.world.dodecagon import SIDES
from itree_jax.world.model import World
from itree_jax.world.prism import Prism

FLOOR_MARGIN = 1.5  # of the extent of what lies on it: a floor without a bin is drawn so large
FLOOR_THICKNESS = 5.0  # [mm]: a floor has to be a solid
COLOURS = {  # red, green, blue, opacity
    "part": (86, 145, 200, 255),
    "prism": (224, 159, 62, 150),
    "bin": (150, 150, 150, 255),
    "floor": (190, 190, 190, 255),
}


class WorldMesh(NamedTuple):
    name: str  # "part 0", "region 7", "wall +x", "floor"; a name that repeats gets a letter
    mesh: trimesh.Trimesh  # camera frame [mm]
    kind: str  # "part", "prism", "bin" or "floor"


def world_meshes(world: World) -> list[WorldMesh]:
    """Every solid of the world. All but the parts are convex."""
    found = [WorldMesh(f"part {p.index}", trimesh.Trimesh(p.X_cam, p.part.triangles, process=False), "part")
             for p in world.parts]  # fmt: skip
    seen: dict[int, int] = {}
    for prism in world.prisms:
        count = seen[prism.region] = seen.get(prism.region, 0) + 1
        name = f"region {prism.region}" if prism.region >= 0 else "surface without region"
        found.append(WorldMesh(name if count == 1 else f"{name}, piece {count}", prism_mesh(prism, world), "prism"))
    if world.bin is None:
        return [*found, WorldMesh("floor", _floor_mesh(world, found), "floor")]
    for name, (low, high) in world.bin.boxes.items():
        box = trimesh.creation.box(bounds=np.stack([low, high]))
        box.apply_transform(world.bin.T_cam_bin)
        found.append(WorldMesh(name, box, "floor" if name == "floor" else "bin"))
    return found


def to_scene(world: World) -> trimesh.Scene:
    """The world with colours, in the camera's frame [mm]; `.export("world.glb")` or `"world.ply"` writes a file."""
    scene = trimesh.Scene()
    for name, mesh, kind in world_meshes(world):
        coloured = mesh.copy()
        coloured.visual = ColorVisuals(coloured, face_colors=np.array(COLOURS[kind], np.uint8))
        scene.add_geometry(coloured, node_name=name, geom_name=name)
    return scene


def prism_mesh(prism: Prism, world: World) -> trimesh.Trimesh:
    """A closed mesh of a prism in the camera frame [mm]."""
    levels = [np.column_stack([prism.outline_up, np.full(SIDES, z)]) for z in (prism.bottom, prism.top)]
    return _convex(np.concatenate(levels) @ world.R_cam_up.T)


def _convex(X_cam: Float[np.ndarray, "points 3"]) -> trimesh.Trimesh:
    """The hull, which also leaves out sides of no length."""
    return trimesh.convex.convex_hull(X_cam)


def _floor_mesh(world: World, found: list[WorldMesh]) -> trimesh.Trimesh:
    """A slab under everything, wider than it."""
    points = np.concatenate([np.zeros((1, 3)), *(np.asarray(one.mesh.vertices) @ world.R_cam_up for one in found)])
    points = points[1:] if len(found) else points
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), FLOOR_MARGIN * 0.5 * np.maximum(high - low, 1.0)
    bounds = np.array([[*(middle - half)[:2], world.floor - FLOOR_THICKNESS], [*(middle + half)[:2], world.floor]])
    slab = trimesh.creation.box(bounds=bounds)
    T = np.eye(4)
    T[:3, :3] = world.R_cam_up
    slab.apply_transform(T)
    return slab
