"""The recognise-and-represent loop on a simulated bin: recognise, model the world, take the best grasp, image again
(Ikeuchi 1987, sec. 3.2), until the bin is empty or nothing in it can be taken.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from itree_cad.part import Part
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from itree_jax.detections import Detections
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.grasp.candidates import GraspTable
from itree_jax.grasp.gripper import Gripper
from itree_jax.grasp.plan import Grasp, Grasps, find_grasps, grasp_tables
from itree_jax.prepared import PreparedForest
from itree_jax.recognition import recognize_one
from itree_jax.sensor import Sensor
from itree_jax.simulate.bin import Bin, bin_for, camera_above, walls_of
from itree_jax.simulate.dataset import model_info
from itree_jax.simulate.grasp_check import TrueBin, fine_pieces
from itree_jax.simulate.imaging import LOOKS, Look, image_mixed_bin
from itree_jax.simulate.settle import Pieces, settle_from, settle_mixed
from itree_jax.world.model import World, world_model

RIGHT = 0.05  # of the diameter: a pose off by more (MSSD) is a wrong one, as in the evaluation
PATIENCE = 2  # images in a row without any pick after which the bin is given up: a new image has new noise only
CHECKED = 12  # grasps said to be free, and as many said to collide, held against the engine in every cycle
REMOVED, WRONG, MISSED, NOTHING = "removed", "wrong pose", "missed", "no grasp"


@dataclass(frozen=True)
class Cycle:
    """One image and what was done about it."""

    parts: int  # in the bin before it
    recognised: int
    prisms: int
    outcome: str  # REMOVED; WRONG: a part came out, but not as its pose said; MISSED: fingers on nothing; NOTHING
    reason: str  # what the grasp holds, or why there is none
    error: float  # [mm] MSSD of the pose taken; NaN when none was
    score: float  # of the grasp; NaN when there was none
    clearance: float  # [mm] that the world model promised; NaN when there was no grasp
    hit: tuple[str, ...]  # what the engine found touched on the way of that grasp, though none was predicted
    # Of up to `CHECKED` grasps said to be free and as many said to collide, by what the engine found:
    free_free: int = 0  # said to be free, and free
    free_hit: int = 0  # said to be free, but touches something: the error that costs
    hit_free: int = 0  # said to collide, but free: caution
    hit_hit: int = 0


@dataclass(frozen=True)
class ClearedBin:
    """The loop on one bin."""

    seed: int
    dropped: int  # parts that lay in the bin at first
    cycles: tuple[Cycle, ...]
    left: int  # parts that were still there at the end
    reason: str  # why it ended: "empty", or why nothing could be taken

    def count(self, outcome: str) -> int:
        return sum(cycle.outcome == outcome for cycle in self.cycles)

    @property
    def collisions(self) -> int:
        """Picks on whose way the engine found something touched."""
        return sum(bool(cycle.hit) for cycle in self.cycles)


@dataclass
class State:
    """The true bin while it is being cleared."""

    kinds: tuple[tuple[Part, int], ...]  # parts with their object numbers
    bin: Bin
    of_kind: Int[np.ndarray, "parts"]
    T_bin_obj: Float[np.ndarray, "parts 4 4"]
    pieces: Pieces  # convex ones of the parts, by `id(part)`
    failed: list[Float[np.ndarray, "3"]] = field(default_factory=list)  # [mm] places of grasps that brought nothing

    @property
    def parts(self) -> list[Part]:
        return [self.kinds[k][0] for k in self.of_kind]

    def without(self, taken: int) -> "State":
        """One part is out, and the others have come to rest again."""
        keep = np.arange(len(self.of_kind)) != taken
        of_kind, T = self.of_kind[keep], self.T_bin_obj[keep]
        if len(of_kind):
            T, kept = settle_from([self.kinds[k][0] for k in of_kind], T, self.bin, self.pieces)
            of_kind = of_kind[kept]
        return State(self.kinds, self.bin, of_kind, T, self.pieces)


def clear_bin(
    forest: PreparedForest,
    gripper: Gripper,
    sensor: Sensor,
    parts: int,
    seed: int,
    look: Look = LOOKS["lambert"],
    tables: dict[int, GraspTable] | None = None,
    tell: Callable[[int, int], None] | None = None,
) -> ClearedBin:
    """Drops parts into a bin and takes them out one by one, as recognition, world model and grasps say.

    Several trees share the drop evenly. `tell(left, dropped)` is called after each cycle. Depth is the depth map that
    the sensor's simulated images come with. The same seed gives the same bin. Raises ItreeError as `settle` does.
    """
    trees = [one.tree for one in forest.trees]
    tables = grasp_tables(trees, gripper) if tables is None else tables
    kinds = tuple((tree.part, tree.obj_id) for tree in trees)
    bin_ = bin_for(sensor, max(part.diameter for part, _ in kinds))
    dropped = np.arange(parts) % len(kinds)
    drop_seed, image_seed = np.random.SeedSequence(seed).generate_state(2).tolist()
    T_bin_obj, kept = settle_mixed([kinds[k][0] for k in dropped], bin_, drop_seed)
    state = State(kinds, bin_, dropped[kept], T_bin_obj, fine_pieces([part for part, _ in kinds]))
    first, cycles, idle, reason = len(kept), [], 0, "empty"
    while len(state.of_kind):
        image = np.random.SeedSequence([image_seed, len(cycles)])
        cycle, state = one_cycle(state, forest, tables, gripper, sensor, look, image)
        cycles.append(cycle)
        idle = 0 if cycle.outcome in (REMOVED, WRONG) else idle + 1
        if tell is not None:
            tell(len(state.of_kind), first)
        if idle >= PATIENCE:
            reason = cycle.reason if cycle.outcome == NOTHING else "the fingers closed on nothing"
            break
    return ClearedBin(seed, first, tuple(cycles), len(state.of_kind), reason)


def one_cycle(
    state: State, forest: PreparedForest, tables: dict[int, GraspTable], gripper: Gripper, sensor: Sensor, look: Look,
    seed: np.random.SeedSequence,
) -> tuple[Cycle, State]:
    """Images the bin, takes the best grasp, and returns what came of it and the bin afterwards."""
    noise_seed, choice_seed = seed.generate_state(2).tolist()
    found, world, grasps = seen(state, forest, tables, sensor, look, noise_seed)
    true_bin = TrueBin(state.parts, state.T_bin_obj, state.bin, gripper, state.pieces)
    T_bin_cam = np.linalg.inv(camera_above(sensor))
    table = confusion(grasps, true_bin, T_bin_cam, np.random.default_rng(choice_seed), state, found)
    counted = {"parts": len(state.of_kind), "recognised": len(found), "prisms": len(world.prisms), **table}
    grasp = first_untried(grasps, state, T_bin_cam)
    if grasp is None:
        nan = float("nan")
        reason = grasps.reason or "every grasp that is free has failed before"
        return Cycle(outcome=NOTHING, reason=reason, error=nan, score=nan, clearance=nan, hit=(), **counted), state
    target, error, right = true_part(found, grasp.detection, state, T_bin_cam)
    T_bin_grasp = T_bin_cam @ grasp.T_cam_grasp
    touched = true_bin.touched(T_bin_grasp, grasp.width, target)
    held = target if target in touched.held else touched.held[0] if touched.held else None
    outcome = MISSED if held is None else REMOVED if right and held == target else WRONG
    cycle = Cycle(outcome=outcome, reason=grasp.reason, error=error, score=grasp.score, clearance=grasp.clearance,
                  hit=touched.on_the_way, **counted)  # fmt: skip
    if held is None:
        state.failed.append(T_bin_grasp[:3, 3])
        return cycle, state
    return cycle, state.without(held)


def seen(
    state: State, forest: PreparedForest, tables: dict[int, GraspTable], sensor: Sensor, look: Look, seed: int
) -> tuple[Detections, World, Grasps]:
    """An image of the bin, the world as it tells it, and the grasps there."""
    scene, _ = image_mixed_bin(state.kinds, state.of_kind, state.T_bin_obj, state.bin, sensor, look, seed=seed)
    found = recognize_one(forest, scene.images, scene.sensor, scene.depth, scene.R_w2c)
    trees = [one.tree for one in forest.trees]
    world = world_model(found, trees, scene.sensor, scene.depth, scene.R_w2c, walls_of(state.bin, sensor))
    axes = {tree.obj_id: tree.symmetries.continuous for tree in trees}
    return found, world, find_grasps(world, tables, axes=axes)


def first_untried(grasps: Grasps, state: State, T_bin_cam: Float[np.ndarray, "4 4"]) -> Grasp | None:
    """The best grasp that isn't where one has failed since the bin last changed."""
    for grasp in grasps.grasps:
        place = (T_bin_cam @ grasp.T_cam_grasp)[:3, 3]
        if all(np.linalg.norm(place - there) > 0.1 * max(p.diameter for p in state.parts) for there in state.failed):
            return grasp
    return None


def true_part(
    found: Detections, index: int, state: State, T_bin_cam: Float[np.ndarray, "4 4"]
) -> tuple[int | None, float, bool]:
    """The true part that an answer is nearest to, its MSSD [mm], and whether that makes the answer right."""
    answer = found.by_offer[index]
    same = np.flatnonzero([state.kinds[k][1] == answer.obj_id for k in state.of_kind])
    if not len(same):
        return None, float("inf"), False
    T, part = T_bin_cam @ answer.T_cam_obj, state.parts[int(same[0])]
    truth = state.T_bin_obj[same]
    hull = part.vertices[ConvexHull(part.vertices).vertices]
    errors = mssd(Pose(T[:3, :3], T[:3, 3]), Pose(truth[:, :3, :3], truth[:, :3, 3]), hull,
                  symmetry_set(model_info(part)))  # fmt: skip
    best = int(np.argmin(errors))
    return int(same[best]), float(errors[best]), bool(errors[best] < RIGHT * part.diameter)


def confusion(
    grasps: Grasps, true_bin: TrueBin, T_bin_cam: Float[np.ndarray, "4 4"], rng: np.random.Generator, state: State,
    found: Detections,
) -> dict[str, int]:
    """Grasps said to be free and said to collide, drawn evenly, and what the engine finds of each."""
    table: dict[str, int] = dict.fromkeys(("free_free", "free_hit", "hit_free", "hit_hit"), 0)
    steep = [one for one in grasps.tried if one.verdict is not None]
    for said, some in (("free", [t for t in steep if t.free]), ("hit", [t for t in steep if not t.free])):
        for k in rng.permutation(len(some))[:CHECKED].tolist():
            target = true_part(found, some[k].part.index, state, T_bin_cam)[0]
            touched = true_bin.touched(T_bin_cam @ some[k].T_cam_grasp, some[k].candidate.width, target)
            table[f"{said}_{'hit' if touched.on_the_way else 'free'}"] += 1
    return table
