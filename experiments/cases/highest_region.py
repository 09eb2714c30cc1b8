"""The highest region of a scene: as measured, and whether it is a fair instance of its case."""

from dataclasses import dataclass

import cv2
import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float

from cases.bin_with_target import CaseScene
from itree_jax.sensing.lit import lit_by_any
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.reading import read_needles
from itree_jax.sensing.regions import Regions, regions
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sight import by_light
from itree_jax.tree.groups import group_of_label
from itree_jax.tree.tree import InterpretationTree

HIGHEST = 0  # regions are sorted by height
SAME_REGION = 0.85  # intersection over union: noise at the slant limit takes a rim of a pixel or two


@dataclass(frozen=True)
class Measured:
    """What the low-level operations make of a scene (sec. 3.1)."""

    case_scene: CaseScene
    needle: NeedleMap
    found: Regions

    @property
    def scene(self) -> Scene:
        return self.case_scene.scene


def measure_scene(case_scene: CaseScene) -> Measured:
    """Needle map and regions, as recognition has them."""
    scene = case_scene.scene
    needle = read_needles(scene.images, scene.sensor, scene.depth)
    lit = lit_by_any(scene.images, scene.sensor, needle)
    found, _ = by_light(regions(needle, scene.depth, scene.sensor, scene.R_w2c, lit=lit), lit)
    return Measured(case_scene, needle, found)


def unfair(measured: Measured, tree: InterpretationTree, mesh: RayMesh, group: int) -> str:
    """Why the highest region is no instance of attitude `group`; "" if it is one.

    The paper's highest region "is usually not occluded and exhibits all information necessary": it has to be a region
    that the part on top would show alone, and the part's shape label has to be the group's.
    """
    if measured.found.count == 0:
        return "there is no region"
    alone, face_area = seen_alone(measured, mesh)
    if int(group_of_label(tree.groups, face_area[None])[0]) != group:
        return "another label"
    mask = measured.found.mask(HIGHEST)
    _, pieces = cv2.connectedComponents(alone.astype(np.uint8), connectivity=8)
    inside = pieces[mask & alone]
    if inside.size < 0.5 * mask.sum():
        return "another part's region is the highest"
    own = pieces == np.bincount(inside).argmax()
    overlap = (own & mask).sum() / (own | mask).sum()
    return "" if overlap > SAME_REGION else "the region is cut"


def seen_alone(measured: Measured, mesh: RayMesh) -> tuple[Bool[np.ndarray, "h w"], Float[np.ndarray, "faces"]]:
    """What would be detectable of the part on top without the others, and of each component face [mm^2]."""
    target, sensor = measured.case_scene.target, measured.scene.sensor
    shapes = cast_apparent_shapes(
        mesh, target.R_cam_obj[None], target.t_cam_obj[None], sensor.camera, sensor.light_directions, sensor.slant_limit
    )
    detectable = shapes.detectable[0]
    pixel = sensor.camera.mm_per_px(float(target.t_cam_obj[2])) ** 2
    count = int(np.asarray(mesh.face_of_triangle).max()) + 1
    return detectable, np.bincount(shapes.face[0][detectable], minlength=count) * pixel
