"""Trees made ready for recognition: ray meshes built, arrays where they are used."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from itree_cad.decimate import coarser, lean
from itree_cad.part import Part
from itree_cad.symmetry import Symmetries
from itree_kernels.mesh import ray_mesh
from jaxtyping import Float, Int

from itree_jax.open_attitudes import distinct_attitudes
from itree_jax.refinement.bending import smooth_surface
from itree_jax.refinement.hypotheses import turns_about_axes
from itree_jax.refinement.nearly_revolved import Axis, revolved_axis
from itree_jax.refinement.optimise import Hypotheses, RefineModel, padded_normals, padded_surface
from itree_jax.refinement.pose_distance import NEARLY_SAME, same_part_distance
from itree_jax.refinement.solids import Solid, solid
from itree_jax.shown_surface import DomePoints, ShownSurface, dome_points, shown_surface
from itree_jax.tree.appearances import mesh_reach, window_camera
from itree_jax.tree.classify import ClassificationArrays, classification_arrays
from itree_jax.tree.determine import DeterminationArrays, determination_arrays
from itree_jax.tree.dome import dome
from itree_jax.tree.forest import Forest, compile_forest
from itree_jax.tree.root import Root
from itree_jax.tree.tree import InterpretationTree

ROUGHNESS = 0.005  # of the diameter that surfaces of the rough model may move: a seventh of the finest rough pixel
SAME_TURN = 0.03  # of the diameter: turns that differ by less are one


@dataclass(frozen=True)
class Prepared:
    """A tree with its arrays on the device. Prepare once, recognise many scenes.

    CAD files put a part's origin anywhere. Inside recognition its middle is the origin: poses of one place lie near
    each other, and windows about the origin are no larger than the part.
    """

    tree: InterpretationTree
    middle: Float[np.ndarray, "3"]  # of the part's bounding box, object frame [mm]
    model: RefineModel  # about the middle, as all that follows
    rough: RefineModel  # the same with a fraction of the triangles, for windows of few pixels
    symmetries: Symmetries
    classification: ClassificationArrays
    determination: DeterminationArrays
    pitch: float  # of feature windows [mm]
    solid: Solid
    turns: Float[np.ndarray, "turns 4 4"]  # about its main axes, model -> model
    own_axis: Axis | None  # of a part that is nearly one of revolution
    attitudes: Int[np.ndarray, "attitudes"]  # of the whole dome those that differ, as in `distinct_attitudes`
    shown: ShownSurface  # by each view of the dome
    points: DomePoints  # some of it
    largest_view: float  # the largest area that it shows, across the line of sight [mm^2], or somewhat more

    def of_object(self, poses: Hypotheses) -> Hypotheses:
        """Poses of the part about its middle as those of the CAD file's own frame: T_cam_obj."""
        R, t = (np.asarray(a, float) for a in poses)
        return Hypotheses(R, t - R @ self.middle)

    def about_middle(self, R_cam_obj: Float[np.ndarray, "*n 3 3"], t_cam_obj: Float[np.ndarray, "*n 3"]) -> Hypotheses:
        """The other way round."""
        return Hypotheses(R_cam_obj, t_cam_obj + R_cam_obj @ self.middle)

    @property
    def usual_area(self) -> float:
        """Of the part's regions [mm^2]."""
        return float(np.median(self.tree.appearances.area))


@dataclass(frozen=True)
class PreparedForest:
    """A forest whose trees are prepared."""

    trees: tuple[Prepared, ...]
    root: Root

    @property
    def pitches(self) -> tuple[float, ...]:
        """Of the feature windows that any tree wants [mm]."""
        return tuple(sorted({one.pitch for one in self.trees}))


@overload
def prepare(tree: InterpretationTree) -> Prepared: ...
@overload
def prepare(tree: Forest) -> PreparedForest: ...
def prepare(tree: InterpretationTree | Forest) -> Prepared | PreparedForest:
    """Builds the ray mesh and puts the tree's arrays where they are used; of a forest, of all its trees."""
    if isinstance(tree, Forest):
        return PreparedForest(tuple(prepare(one) for one in tree.trees), tree.root)
    middle, part = tree.part.middle, tree.part.about_middle()
    symmetries = tree.symmetries.about(middle)
    seen = lean(part)
    mesh = ray_mesh(seen.vertices, seen.triangles, seen.face_of_triangle)
    surface = padded_surface(smooth_surface(mesh))
    model = RefineModel(mesh, padded_normals(mesh.triangle_normals), mesh_reach(mesh), part.diameter, surface)
    rough = rough_model(model)
    shown = shown_surface(model, tree.sensor.camera, tree.sensor.working_distance)
    return Prepared(
        tree, middle, model, rough, symmetries, classification_arrays(tree), determination_arrays(tree),
        window_camera(model.reach)[1], solid(mesh, part.diameter, part.watertight),
        rival_turns(part, symmetries), None if symmetries.continuous else revolved_axis(part),
        distinct_attitudes(part, symmetries),
        shown, dome_points(shown), largest_view(part),
    )


def rough_model(model: RefineModel) -> RefineModel:
    """A coarser mesh in windows of the same size: rough windows cost what triangles they project and walk along."""
    mesh = model.mesh
    vertices, triangles = coarser(mesh.vertices, mesh.triangles, ROUGHNESS * model.diameter)
    few = ray_mesh(vertices, triangles, np.zeros(len(triangles), int))
    return replace(model, mesh=few, normal_obj=padded_normals(few.triangle_normals), surface=None, rough=True)


def largest_view(part: Part) -> float:
    """The largest area [mm^2] of what any view of the dome shows: all that faces it, hidden or not, and no more than
    the part's own circle.
    """
    corners = np.asarray(part.vertices, float)[np.asarray(part.triangles)]
    half_cross = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.maximum(half_cross @ dome().directions.T, 0.0).sum(axis=0)
    return min(float(facing.max()), np.pi / 4.0 * part.diameter**2)


def rival_turns(part: Part, symmetries: Symmetries) -> Float[np.ndarray, "turns 4 4"]:
    """Turns about the part's main axes after which it lies otherwise; each once."""
    kept = [np.eye(4)]
    for turn in turns_about_axes(part.vertices, part.triangles):
        R, t = np.array(kept)[:, :3, :3], np.array(kept)[:, :3, 3]
        apart = same_part_distance(R, t, turn[:3, :3], turn[:3, 3], symmetries, part.diameter)
        if apart[0] > NEARLY_SAME * part.diameter and apart.min() > SAME_TURN * part.diameter:
            kept.append(turn)
    return np.array(kept[1:]).reshape(-1, 4, 4)


def prepare_forest(trees: Sequence[InterpretationTree | Prepared]) -> PreparedForest:
    """Trees, some of them prepared, as a forest. Raises ItreeError as `compile_forest` does."""
    prepared = tuple(one if isinstance(one, Prepared) else prepare(one) for one in trees)
    return PreparedForest(prepared, compile_forest([one.tree for one in prepared]).root)
