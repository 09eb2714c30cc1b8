"""From the world model to grasps: which part to take, how, and why the others can't be taken."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from itree_kernels.errors import ItreeError
from jaxtyping import Float

from itree_jax.grasp.candidate import Candidate
from itree_jax.grasp.candidates import GraspTable, grasp_table
from itree_jax.grasp.collide import Obstacles, Verdict
from itree_jax.grasp.gripper import Gripper
from itree_jax.grasp.rank import score
from itree_jax.tree.tree import InterpretationTree
from itree_jax.world.meshes import world_meshes
from itree_jax.world.model import PlacedPart, World

NO_PART = "no part was recognised"
LEAST_SCORE = 1e-3  # a grasp under it would miss: its pose isn't known along the jaw


@dataclass(frozen=True)
class Grasp:
    """One grasp that is free of collision, in the model of the world."""

    detection: int  # index in `Detections.by_offer`, as the number of the part in the world
    T_cam_grasp: Float[np.ndarray, "4 4"]  # gripper -> camera [mm]
    T_robot_grasp: Float[np.ndarray, "4 4"] | None  # gripper -> robot, where the hand-eye transform is known
    width: float  # [mm] between the pads; 0 for a cup
    clearance: float  # [mm] to the nearest other thing, all along the approach
    score: float  # 0 to 1, see `rank.score`
    reason: str  # what it holds and what is nearest, in words
    candidate: Candidate


@dataclass(frozen=True)
class Tried:
    """One candidate of one placed part, as it stands in the world."""

    part: PlacedPart
    candidate: Candidate
    T_cam_grasp: Float[np.ndarray, "4 4"]
    verdict: Verdict | None  # None: it comes too flat, and was not held against anything

    @property
    def free(self) -> bool:
        return self.verdict is not None and not self.verdict.hit


@dataclass(frozen=True)
class Grasps:
    """The grasps of a scene."""

    gripper: Gripper
    grasps: tuple[Grasp, ...]  # the best first; at most one per face and direction
    reasons: Mapping[int, str]  # of the detections that have none, by index
    reason: str  # why the scene has none; "" when it has
    tried: tuple[Tried, ...] = field(default=(), repr=False)  # all candidates, also those that collide

    @property
    def best(self) -> Grasp | None:
        return self.grasps[0] if self.grasps else None


def grasp_tables(trees: Sequence[InterpretationTree], gripper: Gripper) -> dict[int, GraspTable]:
    """Candidates of every part, by object number."""
    return {tree.obj_id: grasp_table(tree.part, gripper) for tree in trees}


def find_grasps(
    world: World,
    tables: Mapping[int, GraspTable],
    T_robot_cam: Float[np.ndarray, "4 4"] | None = None,
    axes: Mapping[int, Sequence] | None = None,
) -> Grasps:
    """All grasps that are free, best first, and the reason for every part that has none.

    Args:
        tables: candidates by object number, of one gripper.
        T_robot_cam: the hand-eye transform [mm].
        axes: a part's axes of revolution by object number (`Symmetries.continuous`): turns about them don't count.

    A part held is taken to come out along the approach as freely as the gripper went in: that it lifts what leans on it
    isn't looked at. Raises ItreeError when a part's table is missing.
    """
    grippers = {id(table.gripper): table.gripper for table in tables.values()}
    if len(grippers) != 1:
        raise ItreeError(f"grasps need the candidates of exactly one gripper, not of {len(grippers)}")
    gripper = next(iter(grippers.values()))
    if not world.parts:
        return Grasps(gripper, (), {}, NO_PART)
    highest = max(float(world.height(part.X_cam).max()) for part in world.parts)
    tried = tried_grasps(world, tables)
    found: list[Grasp] = []
    reasons: dict[int, str] = {}
    for part in world.parts:
        own = [one for one in tried if one.part is part]
        turns = (axes or {}).get(part.detection.obj_id, ())
        free = [_grasp(one, gripper, world, highest, turns) for one in own if one.free]
        sure = [grasp for grasp in free if grasp.score >= LEAST_SCORE]
        found += sure
        if not sure:
            reasons[part.index] = tables[part.detection.obj_id].reason or _why_none(own, len(free))
    found.sort(key=lambda grasp: -grasp.score)
    if T_robot_cam is not None:
        found = [replace(grasp, T_robot_grasp=T_robot_cam @ grasp.T_cam_grasp) for grasp in found]
    summary = "" if found else "; ".join(f"part {index}: {why}" for index, why in reasons.items())
    return Grasps(gripper, tuple(found), reasons, summary, tuple(tried))


def tried_grasps(world: World, tables: Mapping[int, GraspTable]) -> list[Tried]:
    """Every candidate of every placed part, held against the world."""
    obstacles = Obstacles(world_meshes(world))
    tried = []
    for part in world.parts:
        table = tables[part.detection.obj_id]
        for candidate in table.candidates:
            T_cam_grasp = part.T_cam_obj @ candidate.T_obj_grasp
            steep = -float(T_cam_grasp[:3, 2] @ world.up_cam) >= np.cos(table.gripper.tilt)
            verdict = None
            if steep:
                verdict = obstacles.verdict(table.gripper, candidate.width, T_cam_grasp, f"part {part.index}")
            tried.append(Tried(part, candidate, T_cam_grasp, verdict))
    return tried


def _grasp(tried: Tried, gripper: Gripper, world: World, highest: float, axes: Sequence) -> Grasp:
    """A free one, with its score and what it holds."""
    part, candidate, verdict = tried.part, tried.candidate, tried.verdict
    assert verdict is not None
    height = float(world.height(tried.T_cam_grasp[:3, 3]))
    value = score(part.detection, candidate, gripper, verdict.clearance, height, highest, part.part.diameter, axes)
    near = f", {verdict.clearance:.1f} mm from {in_words(verdict.near)}" if verdict.near else ""
    words = f"holds face {' and face '.join(map(str, candidate.faces))}{near}"
    return Grasp(part.index, tried.T_cam_grasp, None, candidate.width, verdict.clearance, value, words, candidate)


def _why_none(tried: Sequence[Tried], unsure: int) -> str:
    """In words: what became of every candidate of a part."""
    count, flat = len(tried), sum(one.verdict is None for one in tried)
    hits = Counter(one.verdict.hit for one in tried if one.verdict is not None and one.verdict.hit)
    collided = sum(hits.values())
    by = Counter()
    for name, n in hits.items():
        by[in_words(name)] += n
    with_what = ", ".join(f"{n} with {name}" for name, n in by.most_common())
    if collided == count:
        return f"all {count} grasps in collision: {with_what}"
    said = [f"{flat} come too flat or from below" if flat else "",
            f"{collided} in collision: {with_what}" if collided else "",
            f"{unsure} where the pose isn't known well enough" if unsure else ""]  # fmt: skip
    return f"of {count} grasps, {'; '.join(filter(None, said))}"


def in_words(name: str) -> str:
    """An obstacle's name in a sentence; the pieces of one region count as one, and so do the walls."""
    name = name.partition(",")[0]
    if name.startswith("region"):
        return f"{name}'s prism"
    return "the wall" if name.startswith("wall") else f"the {name}" if name.startswith(("floor", "surface")) else name
