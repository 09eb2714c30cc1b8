"""Everything that the page of one scene shows, computed once: needle map, rendered poses, residuals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.mesh import RayMesh, ray_mesh
from jaxtyping import Float, Int

from itree_jax.detections import Detection, Detections
from itree_jax.grasp import Grasps
from itree_jax.report.palette import Rgb, cycle
from itree_jax.report.pose_render import RenderedPose, render_pose
from itree_jax.report.residuals import Allowed, Codes, Residuals, allowed, combined, explained_regions, residual_codes
from itree_jax.report.scene_pictures import Picture, displayed, white_level
from itree_jax.report.truth_view import Comparison, TruePose, TruePoses, as_true_pose, compare
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.reading import read_needles
from itree_jax.sensing.scene_folder import Scene
from itree_jax.tree.tree import InterpretationTree
from itree_jax.world import World, load_bin, world_model


@dataclass(frozen=True)
class PoseView:
    """One answer with its renderings; None when the pose lies outside of the image."""

    detection: Detection
    tree: InterpretationTree
    colour: Rgb
    rendered: RenderedPose | None  # at scale 1
    codes: Codes | None
    allowed: Allowed  # what still counts as agreeing


@dataclass(frozen=True)
class SceneView:
    """One scene and its answers in the order for picking."""

    scene: Scene
    detections: Detections
    needle: NeedleMap
    white: float  # intensity that is shown white
    background: Picture  # mean of the lit images; of a depth camera its needles under a light beside it
    labels: Int[np.ndarray, "h w"]
    poses: tuple[PoseView, ...]
    residuals: Residuals  # of all poses; their index is that in `poses`
    region_pose: Int[np.ndarray, "regions"]  # index in `poses` of the one that explains a region, -1 none
    meshes: dict[int, RayMesh]  # by obj_id
    trees: dict[int, InterpretationTree]
    truth: tuple[TruePose, ...]
    comparison: Comparison | None  # of `poses` with the truth, if it is known
    world: World
    grasps: Grasps | None  # where they were asked for

    @property
    def missed(self) -> tuple[TruePose, ...]:
        """True poses that no answer found."""
        found = () if self.comparison is None else self.comparison.found
        return tuple(pose for k, pose in enumerate(self.truth) if k not in found)

    @property
    def region_count(self) -> int:
        """Regions that are in the picture: a second reading may have taken all pixels of one of the first's."""
        return len(np.unique(self.labels[self.labels >= 0]))


def scene_view(
    scene: Scene,
    detections: Detections,
    trees: Sequence[InterpretationTree],
    truth: TruePoses | None = None,
    grasps: Grasps | None = None,
) -> SceneView:
    """Raises ItreeError when an answer is of a part that no tree is given for, or the scene's bin file is wrong."""
    true = None if truth is None else [as_true_pose(pose) for pose in truth]
    by_id = {tree.obj_id: tree for tree in trees}
    unknown = sorted({d.obj_id for d in detections} - set(by_id))
    if unknown:
        raise ItreeError(
            f"the detections are of the parts {unknown}, the trees of {sorted(by_id)}: a report needs the tree of "
            "every part recognised"
        )
    needle = read_needles(scene.images, scene.sensor, scene.depth)
    used = {d.obj_id for d in detections} | {pose.obj_id for pose in true or () if pose.obj_id in by_id}
    meshes = {k: part_mesh(by_id[k]) for k in sorted(used)}
    offered = detections.by_offer
    images = scene.images if len(scene.images) else head_light(needle)[None]
    white = white_level(images)
    shape = images.shape[1:]
    labels = np.full(shape, -1) if detections.labels is None else np.asarray(detections.labels)
    poses = tuple(pose_view(d, k, by_id, meshes, scene, needle) for k, d in enumerate(offered))
    residuals = combined(shape, [p.rendered for p in poses], [p.codes for p in poses])
    return SceneView(
        scene=scene, detections=detections, needle=needle, white=white,
        background=displayed(images.mean(axis=0), white),
        labels=labels, poses=poses, residuals=residuals,
        region_pose=explained_regions(labels, residuals, int(labels.max(initial=-1)) + 1)[0],
        meshes=meshes, trees=by_id, truth=tuple(true or ()),
        comparison=None if true is None else compare(offered, true, by_id),
        world=world_model(detections, trees, scene.sensor, scene.depth, scene.R_w2c, load_bin(scene)),
        grasps=grasps,
    )  # fmt: skip


def head_light(needle: NeedleMap) -> Float[np.ndarray, "h w"]:
    """What a Lambertian surface with these needles would show under a light at the camera; 0 where there is none."""
    return np.maximum(-np.asarray(needle.normals)[..., 2], 0.0) * np.asarray(needle.interpretable)


def pose_view(
    detection: Detection,
    k: int,
    trees: dict[int, InterpretationTree],
    meshes: dict[int, RayMesh],
    scene: Scene,
    needle: NeedleMap,
) -> PoseView:
    tree = trees[detection.obj_id]
    pose = detection.R_cam_obj, detection.t_cam_obj
    rendered = render_pose(meshes[detection.obj_id], *pose, scene.sensor.camera)
    limit = allowed(tree, scene.sensor, scene.depth)
    codes = None if rendered is None else residual_codes(rendered, needle, scene.depth, limit)
    return PoseView(detection, tree, cycle(k), rendered, codes, limit)


def part_mesh(tree: InterpretationTree) -> RayMesh:
    """The tree's part, for rays."""
    return ray_mesh(tree.part.vertices, tree.part.triangles, tree.part.face_of_triangle)
