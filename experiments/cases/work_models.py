"""Work models of every region that a representative attitude shows.

The tree keeps those of the largest region alone. Of an attitude with brother regions any of them may be the highest.
"""

from dataclasses import dataclass

import numpy as np
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.mesh import RayMesh
from jaxtyping import Bool, Float

from itree_jax.features.characteristic_areas import CharacteristicArea, characteristic_areas
from itree_jax.features.prominent_edges import Edge, prominent_edges
from itree_jax.features.window import Window
from itree_jax.tree.appearances import (
    brothers_of_each,
    interpretable,
    measured,
    mesh_reach,
    pixels_of,
    window_camera,
)
from itree_jax.tree.sights import describe_region, largest_regions, needle_deviation, window_edges, window_images
from itree_jax.tree.tree import InterpretationTree


@dataclass(frozen=True)
class RegionModel:
    """One region of a representative attitude; lengths [mm] in its face frame."""

    R_cam_obj: Float[np.ndarray, "3 3"]
    faces: str  # identifying faces of the region, such as "1+3", counted from 1
    mask: Bool[np.ndarray, "s s"]
    mean_normal: Float[np.ndarray, "3"]
    alpha: float  # [rad]
    I_max: float  # [mm^4]
    I_min: float
    outline: Float[np.ndarray, "n_theta"]
    edges: tuple[Edge, ...]
    areas: tuple[CharacteristicArea, ...]
    brothers: Float[np.ndarray, "most fields"]


def region_models(mesh: RayMesh, tree: InterpretationTree, group: int) -> tuple[RegionModel, ...]:
    """The regions of a group's representative attitude, the largest first; none of a group that shows none."""
    sensor = tree.sensor
    camera, pitch = window_camera(mesh_reach(mesh))
    R = tree.leaf_models[group].R_cam_obj
    shapes = cast_apparent_shapes(
        mesh, R[None], np.zeros((1, 3)), camera, sensor.light_directions, sensor.slant_limit
    )
    masks = largest_regions(interpretable(shapes, sensor)[0], sensor.smallest_region / pitch**2)
    if not masks:
        return ()
    images = window_images(shapes.face >= 0, shapes.normal, shapes.lit, sensor)
    edges = np.asarray(window_edges(np.moveaxis(images, 0, 1), sensor.noise))[0]
    needle_std = needle_deviation(sensor.noise)
    normals = [np.where(mask[..., None], shapes.normal[0], 0.0).astype(np.float32) for mask in masks]
    features = measured([pixels_of(mask, shapes.normal[0], edges) for mask in masks], pitch, needle_std)
    regions = [describe_region(mask, shapes.normal[0], shapes.depth[0], camera) for mask in masks]
    beside = brothers_of_each([regions], np.asarray(features.inertia.alpha))
    found = []
    for k, (mask, normal) in enumerate(zip(masks, normals, strict=True)):
        window = Window(mask, normal, np.float32(pitch))
        found.append(RegionModel(
            R_cam_obj=np.asarray(R, float), faces=faces_in(tree, shapes.face[0][mask]), mask=mask,
            mean_normal=np.asarray(features.mean_normal[k], float), alpha=float(features.inertia.alpha[k]),
            I_max=float(features.inertia.I_max[k]), I_min=float(features.inertia.I_min[k]),
            outline=np.asarray(features.outline[k], float), edges=prominent_edges(edges, window),
            areas=tuple(characteristic_areas(window, needle_std)), brothers=np.asarray(beside[k], float),
        ))  # fmt: skip
    return tuple(found)


def faces_in(tree: InterpretationTree, face: np.ndarray) -> str:
    """Identifying faces that make more than a twentieth of a region's pixels."""
    share = [np.mean(face == f) for f in tree.groups.identifying_faces]
    return "+".join(str(digit + 1) for digit, s in enumerate(share) if s > 0.05)
