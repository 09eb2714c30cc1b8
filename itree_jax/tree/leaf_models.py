"""Taking the work models of the representative attitudes (Ikeuchi 1987, sec. 2.1.3)."""

import numpy as np
from itree_kernels.mesh import RayMesh
from jaxtyping import Float

from itree_jax.features.characteristic_areas import characteristic_areas
from itree_jax.features.prominent_edges import edge_table, face_frame, prominent_edges
from itree_jax.features.region import RegionFeatures
from itree_jax.features.window import Window
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import (
    WINDOW_SIZE,
    brothers_of_each,
    inertia_table,
    measured,
    mesh_reach,
    pixels_of,
    seen_attitudes,
    window_camera,
)
from itree_jax.tree.groups import AttitudeGroups
from itree_jax.tree.leaf_model import LeafModel
from itree_jax.tree.sights import Region, sensor_needle_deviation


def leaf_models(mesh: RayMesh, sensor: Sensor, groups: AttitudeGroups) -> tuple[LeafModel, ...]:
    """The work models of every group's representative attitude, taken of its largest region."""
    camera, pitch = window_camera(mesh_reach(mesh))
    R = groups.representative_rotations()
    seen = seen_attitudes(mesh, sensor, R, camera, pitch, sensor.smallest_region / pitch**2)
    largest = [a.regions[0].mask if a.regions else np.zeros((WINDOW_SIZE, WINDOW_SIZE), bool) for a in seen]
    windows = [pixels_of(mask, a.normal, a.edges) for mask, a in zip(largest, seen, strict=True)]
    needle_std = sensor_needle_deviation(sensor)
    features = measured(windows, pitch, needle_std)
    return tuple(
        _leaf_model(R[k], *windows[k], seen[k].regions, features, k, pitch, needle_std)
        for k in range(len(R))
    )


def _leaf_model(
    R: Float[np.ndarray, "3 3"], mask: np.ndarray, normals: np.ndarray, edges: np.ndarray, regions: list[Region],
    features: RegionFeatures, k: int, pitch: float, needle_std: float,
) -> LeafModel:
    window = Window(mask, normals.astype(np.float32), np.float32(pitch))
    found = prominent_edges(edges, window)
    areas = characteristic_areas(window, needle_std) if mask.any() else []
    frame = face_frame(window)
    alpha = np.full(max(len(regions), 1), float(features.inertia.alpha[k]))
    beside = brothers_of_each([regions], alpha) if regions else brothers_of_each([], alpha)
    return LeafModel(
        R_cam_obj=R, mask=mask, pitch=pitch, mean_normal=np.asarray(features.mean_normal[k]), T=np.asarray(frame.T),
        centroid=np.asarray(frame.centroid),
        inertia=inertia_table(features)[k],
        outline=np.asarray(features.outline[k]), egi=np.asarray(features.egi[k]),
        mass_centre=np.asarray(features.mass_centre[k]), area=float(features.area[k]),
        shares=np.asarray(features.shares[k]), edges=edge_table(found, len(found)),
        edge_strength=np.array([edge.strength for edge in found], np.float32),
        areas=np.array([a.vertices for a in areas], np.float32).reshape(-1, 4, 2),
        area_characteristic=np.array([a.characteristic for a in areas], np.int32),
        area_surface=np.array([a.area for a in areas], np.float32),
        brothers=beside[0] if len(beside) else np.zeros(beside.shape[1:], np.float32),
    )
