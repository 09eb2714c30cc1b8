"""The world model as bodies to be drawn: parts in the colours of the overlay, prisms, bin, the camera's axes."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float

from itree_jax.report.body import Body, Stage, stage_of
from itree_jax.report.markup import number
from itree_jax.report.palette import BLACK, GREY, cycle
from itree_jax.world import World, world_meshes
from itree_jax.world.meshes import WorldMesh

PRISM_OPACITY = 0.3  # parts are seen through it
AXIS_SHARE = 0.35  # of the scene's radius: the length of the camera's axes
TILT = np.radians(50.0)  # first view, above the floor: the bin's walls hide little of what lies in it


def world_bodies(world: World) -> tuple[list[Body], Stage]:
    """All of a world but a floor that nothing tells the borders of, and where it is first looked at from."""
    solids = world_meshes(world)
    bodies = [*part_bodies(world), *prism_bodies(world, solids), *bin_bodies(world, solids)]
    stage = stage_of(bodies, world.R_cam_up, TILT)
    return [*bodies, *camera_bodies(world, stage)], stage


def part_bodies(world: World) -> list[Body]:
    """In the order for picking, whose colours the overlay has; parts of one kind share a mesh."""
    meshes = {id(p.part): trimesh.Trimesh(p.part.vertices, p.part.triangles, process=False) for p in world.parts}
    offered = sorted(world.parts, key=lambda p: p.detection.offer_rank)
    bodies = []
    for k, p in enumerate(offered):
        d = p.detection
        at = ", ".join(number(x) for x in d.t_cam_obj)
        doubt = " · ambiguous" if d.ambiguous else ""
        note = f"{p.part.name} · score {number(d.score, 3)}{doubt} · at x, y, z {at} mm"
        name, link = f"pose {d.offer_rank}", f"#pose-{d.offer_rank}"
        mesh, rank = meshes[id(p.part)], str(d.offer_rank)
        bodies.append(Body("part", name, note, mesh, p.T_cam_obj, cycle(k), 1.0, rank, link, d.score))
    return bodies


def prism_bodies(world: World, solids: Sequence[WorldMesh]) -> list[Body]:
    """With the reason why each is no part."""
    found = []
    for prism, solid in zip(world.prisms, (s for s in solids if s.kind == "prism"), strict=True):
        note = f"not explained: {prism.reason} · {number(prism.height)} mm tall"
        found.append(Body("prism", solid.name, note, solid.mesh, np.eye(4), GREY, PRISM_OPACITY))
    return found


def bin_bodies(world: World, solids: Sequence[WorldMesh]) -> list[Body]:
    """Walls and floor as lines, where the bin is known."""
    if world.bin is None:
        return []
    walls = [s for s in solids if s.kind in ("bin", "floor")]
    return [Body("bin", s.name, "", s.mesh, np.eye(4), GREY, 0.0) for s in walls]


def camera_bodies(world: World, stage: Stage) -> list[Body]:
    """Directions of the camera's axes, drawn above the middle of the scene: the camera itself is far away."""
    length = AXIS_SHARE * stage.radius
    wide = 0.04 * length
    needle = trimesh.Trimesh([[0.0, -wide, 0], [length, 0, 0], [0, wide, 0]], [[0, 1, 2]], process=False)
    names = {"x": "right in the image", "y": "down in the image", "z": "away from the camera"}
    bodies = []
    for k, (name, words) in enumerate(names.items()):
        T_cam_axis = np.eye(4)
        T_cam_axis[:3, :3] = np.roll(np.eye(3), k, axis=0)  # the needle's x becomes the camera's k-th axis
        T_cam_axis[:3, 3] = corner(world, stage)
        bodies.append(Body("camera", f"camera {name}", words, needle, T_cam_axis, BLACK, 0.0, name))
    return bodies


def corner(world: World, stage: Stage) -> Float[np.ndarray, "3"]:
    """A place [mm] beside everything, at the left and lower side of the first view, where nothing is hidden."""
    left = np.cross(stage.toward, stage.up)
    return stage.centre + stage.radius * (0.8 * left / np.linalg.norm(left) + 0.3 * world.up_cam)
