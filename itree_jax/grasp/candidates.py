"""The grasps of a part, found offline from its CAD model: once per part and gripper."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from itree_cad.part import Part
from jaxtyping import Float
from trimesh.collision import CollisionManager

from itree_jax.grasp.body import gripper_body
from itree_jax.grasp.candidate import Candidate
from itree_jax.grasp.cup_candidates import cup_candidates
from itree_jax.grasp.gripper import Cup, Gripper, Jaw
from itree_jax.grasp.jaw_candidates import jaw_candidates, opening_in_words
from itree_jax.grasp.surface import holdable_faces

# Best grasps of the same faces from one direction: others differ by some millimetres. A cup has one direction only for
# a whole plane, of which other parts may hide much.
PER_DIRECTION = {Jaw: 3, Cup: 12}
SAME_WIDTH = 4  # decimals [mm]: widths that a tessellation's rounding tells apart are one


@dataclass(frozen=True)
class GraspTable:
    """The grasps of one part with one gripper, the best first; without any, `reason` says why."""

    part: Part
    gripper: Gripper
    candidates: tuple[Candidate, ...]
    reason: str = ""

    def __len__(self) -> int:
        return len(self.candidates)


def grasp_table(part: Part, gripper: Gripper) -> GraspTable:
    """Candidates whose pads or rim lie on the part's faces, and whose gripper the part itself isn't in the way of."""
    faces = holdable_faces(part)
    tool = gripper.tool
    found = jaw_candidates(faces, tool) if isinstance(tool, Jaw) else cup_candidates(faces, tool)
    middle = centre_of_mass(part)
    rated = [_rated(one, middle) for one in found]
    if not rated:
        return GraspTable(part, gripper, (), _nothing_fits(part, gripper))
    own = _solid(part)
    free = _best_of_each_direction(rated, part.diameter, PER_DIRECTION[type(tool)],
                                   lambda one: not _in_own_way(own, gripper, one))  # fmt: skip
    if not free:
        return GraspTable(part, gripper, (), f"the part '{part.name}' itself is in the gripper's way at all its faces")
    return GraspTable(part, gripper, tuple(free))


def quality(one: Candidate, diameter: float) -> float:
    """0 to 1: how much of the pads touches, less where the part hangs off the grasp."""
    return one.contact / (1.0 + one.lever / diameter)


def centre_of_mass(part: Part) -> Float[np.ndarray, "3"]:
    """Of the solid [mm]; of an open mesh, of its hull."""
    mesh = trimesh.Trimesh(part.vertices, part.triangles, process=False)
    return np.asarray((mesh if mesh.is_volume else mesh.convex_hull).center_mass)


def _rated(one: Candidate, middle: Float[np.ndarray, "3"]) -> Candidate:
    lever = float(np.linalg.norm(one.T_obj_grasp[:3, 3] - middle))
    return replace(one, lever=lever, width=round(one.width, SAME_WIDTH))


def _best_of_each_direction(
    rated: Iterable[Candidate], diameter: float, most: int, is_free: Callable[[Candidate], bool]
) -> list[Candidate]:
    """At most so many free ones of the same faces from the same direction, the best first."""
    count: dict[tuple, int] = {}
    kept = []
    for one in sorted(rated, key=lambda one: -quality(one, diameter)):
        key = (one.faces, *np.round(one.T_obj_grasp[:3, (0, 2)].ravel(), 3).tolist())
        if count.get(key, 0) < most and is_free(one):
            count[key] = count.get(key, 0) + 1
            kept.append(one)
    return kept


def _in_own_way(own: CollisionManager, gripper: Gripper, one: Candidate) -> bool:
    return bool(own.in_collision_other(gripper_body(gripper, one.width).at(one.T_obj_grasp)))


def _solid(part: Part) -> CollisionManager:
    manager = CollisionManager()
    manager.add_object("part", trimesh.Trimesh(part.vertices, part.triangles, process=False))
    return manager


def _nothing_fits(part: Part, gripper: Gripper) -> str:
    if isinstance(gripper.tool, Jaw):
        return (f"no candidate fits the opening: '{part.name}' has no two opposed faces and no cylinder "
                f"{opening_in_words(gripper.tool)} wide that the pads can hold")  # fmt: skip
    return (f"no candidate fits the cup: no plane of '{part.name}' holds a disk of "
            f"{gripper.tool.diameter:g} mm, and no cylinder is flat enough for its lip")  # fmt: skip
