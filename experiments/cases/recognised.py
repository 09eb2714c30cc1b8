"""The highest region taken through the tree: every stage kept, for the pictures of one case."""

import time
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cases.case import BROTHERS_LABEL, Case, group_labelled
from cases.highest_region import HIGHEST, Measured
from cases.region_frame import RegionFrame
from cases.work_models import RegionModel, region_models
from itree_jax.answers import Interpretation, describe
from itree_jax.backtracking import FIRST
from itree_jax.decision_path import decision_path
from itree_jax.detections import Detection, Detections, Step
from itree_jax.features.characteristics import characteristics
from itree_jax.features.inertia import face_inertia
from itree_jax.features.rectify import affine_T, gradient_space
from itree_jax.features.region import RegionFeatures
from itree_jax.features.window import Window, extract_images, extract_windows
from itree_jax.interpreting import interpret
from itree_jax.prepared import Prepared
from itree_jax.recognition import as_forest
from itree_jax.region_measures import measure_regions
from itree_jax.report.scene_view import SceneView, scene_view
from itree_jax.report.truth_view import TruePose
from itree_jax.root_answer import ask_root
from itree_jax.sight import look
from itree_jax.tree.appearances import WINDOW_SIZE
from itree_jax.tree.sights import needle_deviation, window_edges
from itree_jax.tree.tree import ROOT, InterpretationTree

_characteristics = jax.jit(characteristics)


@dataclass(frozen=True)
class Recognised:
    """A scene of one case, its highest region, and what the tree made of it."""

    case: Case
    measured: Measured
    interpretation: Interpretation
    detections: Detections
    window: Window  # of the highest region
    edges: Float[np.ndarray, "s s 2"]  # edge map of the window
    frame: RegionFrame

    @property
    def tree(self) -> InterpretationTree:
        return self.interpretation.prepared.tree

    @property
    def wanted(self) -> int:
        """The group that was laid on top."""
        return group_labelled(self.tree, self.case.label)

    @cached_property
    def group_probability(self) -> Float[np.ndarray, "groups"]:
        """What the classification part says, 0 for pruned groups."""
        log_p = np.asarray(self.interpretation.classification.group_log_probability)[HIGHEST]
        p = np.where(self.tree.groups.pruned, 0.0, np.exp(log_p - log_p.max()))
        return p / p.sum()

    @cached_property
    def group(self) -> int:
        """Where the region gets to when it goes to the better side of every node, as the paper has it."""
        return group_walked_to(self.tree, np.asarray(self.interpretation.classification.node_margin)[HIGHEST])

    @cached_property
    def features(self) -> RegionFeatures:
        """Work models of the highest region, as recognition measured them."""
        f = self.interpretation.features
        inertia = type(f.inertia)(*(np.asarray(a)[HIGHEST] for a in f.inertia))
        return RegionFeatures(inertia, *(np.asarray(a)[HIGHEST] for a in f[1:]))

    @cached_property
    def models(self) -> tuple[RegionModel, ...]:
        """Work models of the regions of the representative attitude of the case's group."""
        return self.models_of(self.case.label)

    @cached_property
    def with_brother(self) -> tuple[RegionModel, ...]:
        """Those of the attitude whose brother region rule L6 looks for."""
        return self.models_of(BROTHERS_LABEL)

    def models_of(self, label: str) -> tuple[RegionModel, ...]:
        return region_models(self.interpretation.prepared.model.mesh, self.tree, group_labelled(self.tree, label))

    @cached_property
    def view(self) -> SceneView:
        """Everything the scene report's pictures are made of."""
        truth: list[TruePose] = [(t.obj_id, t.R_cam_obj, t.t_cam_obj) for t in self.measured.case_scene.truth]
        return scene_view(self.measured.scene, self.detections, [self.tree], truth)

    @cached_property
    def answer(self) -> Detection | None:
        """The pose that explains the highest region, whatever region it was derived from."""
        k = int(self.view.region_pose[HIGHEST])
        return None if k < 0 else self.view.poses[k].detection

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The decision path of the highest region to the group it gets to."""
        table = self.tree.appearances
        row = int(np.flatnonzero(table.group[table.attitude] == self.group)[0])
        return decision_path(self.tree, self.interpretation.classification, HIGHEST, row)

    @cached_property
    def memberships(self) -> Float[np.ndarray, "s s 5"]:
        """Surface characteristics of the window."""
        std = jnp.float32(needle_deviation(self.tree.sensor.noise))
        return np.asarray(_characteristics(self.window, std))


def group_walked_to(tree: InterpretationTree, margin: Float[np.ndarray, "nodes"]) -> int:
    """The group at the end of the sides with positive margins; a side of nothing but pruned groups is not taken."""
    kept = ~tree.groups.pruned
    members, node = kept.copy(), below(tree, ROOT, False)
    while node is not None:
        sides = {True: tree.nodes.visible[node] & kept, False: tree.nodes.hidden[node] & kept}
        visible = bool(sides[True].any() and (margin[node] > 0 or not sides[False].any()))
        members, node = sides[visible], below(tree, node, visible)
    return int(np.flatnonzero(members)[0])


def below(tree: InterpretationTree, parent: int, visible: bool) -> int | None:
    """The branch on one side of another (of the root: the first), if that side is divided further."""
    found = np.flatnonzero((tree.nodes.parent == parent) & (tree.nodes.on_visible_side == visible))
    return int(found[0]) if len(found) else None


def recognise(case: Case, measured: Measured, prepared: Prepared) -> Recognised:
    """Regions -> tree -> determination -> refinement, as `itree_jax.recognize` does it."""
    scene, found, needle = measured.scene, measured.found, measured.needle
    start = time.perf_counter()
    assert scene.depth is not None  # simulated scenes have one
    forest = as_forest(prepared)
    regions = measure_regions(found, needle, scene.images, scene.sensor, prepared.pitch)
    said = ask_root(forest, {prepared.pitch: regions})
    sight = look(scene.images, scene.sensor, np.asarray(scene.depth, np.float32), scene.R_w2c)
    answer = interpret(prepared, 0, np.arange(found.count), said, regions, sight, FIRST)
    detections = Detections(
        describe([answer], forest.root, sight), time.perf_counter() - start, labels=found.labels
    )
    return Recognised(case, measured, answer, detections, *highest_window(measured, prepared))


def highest_window(
    measured: Measured, prepared: Prepared
) -> tuple[Window, Float[np.ndarray, "s s 2"], RegionFrame]:
    """The window of the highest region, its edge map, and where its face lies."""
    scene, found = measured.scene, measured.found
    sensor, pitch = scene.sensor, prepared.pitch
    at = (found.centroid_uv[[HIGHEST]], found.mean_depth[[HIGHEST]], sensor.camera, pitch, WINDOW_SIZE)
    normals = np.asarray(measured.needle.normals, np.float32)
    windows, R_ray_cam = extract_windows(found.labels, normals, np.array([HIGHEST]), *at)
    images = scene.images / sensor.light_intensities[:, None, None].astype(np.float32)
    edges = np.asarray(window_edges(extract_images(images, *at), sensor.noise))[0]
    window = Window(*(np.asarray(a)[0] for a in windows))
    features = measure_regions(found, measured.needle, scene.images, sensor, pitch).features
    normal = np.asarray(features.mean_normal)[HIGHEST]
    inertia = face_inertia(window)
    frame = RegionFrame(
        T=np.asarray(affine_T(*gradient_space(normal)), float), centroid=np.asarray(inertia.centroid, float),
        alpha=float(inertia.alpha), mean_normal=normal.astype(float), R_ray_cam=R_ray_cam[0],
        centre_uv=found.centroid_uv[HIGHEST], depth=float(found.mean_depth[HIGHEST]), pitch=pitch, size=WINDOW_SIZE,
        camera=sensor.camera,
    )  # fmt: skip
    return window, edges, frame
