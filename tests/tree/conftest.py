"""A cut gem under lights on the camera's axis: convex, without shadow, and alike to itself under no rotation."""

import dataclasses

import numpy as np
import pytest
from itree_kernels.mesh import RayMesh, ray_mesh
from scipy.spatial import ConvexHull

from itree_jax.features.inertia import FaceInertia
from itree_jax.features.region import RegionFeatures
from itree_jax.features.relation import BROTHER_FIELDS, MOST_BROTHERS
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensor import Sensor
from itree_jax.tree.appearances import Appearances, appearances
from itree_jax.tree.dome import camera_rotation, dome

ROLLS = 12


@pytest.fixture(scope="session")
def sensor() -> Sensor:
    return bundled_sensor("ikeuchi-1987")


@pytest.fixture(scope="session")
def flash(sensor: Sensor) -> Sensor:
    """The same sensor with its lights on the axis of the camera: nothing casts a shadow that it sees."""
    return dataclasses.replace(sensor, light_directions=np.tile([0.0, 0.0, -1.0], (3, 1)))


@pytest.fixture(scope="session")
def gem() -> RayMesh:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(90, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * np.where(directions > 0, [34.0, 26.0, 19.0], [24.0, 17.0, 12.0])
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = np.einsum("tx,tx->t", outward, hull.equations[:, :3]) < 0
    triangles = np.where(turned[:, None], hull.simplices[:, ::-1], hull.simplices)
    return ray_mesh(points, triangles, np.arange(len(triangles)))


@pytest.fixture(scope="session")
def gem_table(gem: RayMesh, flash: Sensor) -> Appearances:
    """The gem from 60 viewer directions at 12 rolls."""
    R_cam_obj = camera_rotation(dome(1).directions)
    return appearances(gem, flash, R_cam_obj, np.arange(60), ROLLS)


def features_of_row(table: Appearances, row: int) -> RegionFeatures:
    """An appearance as a region that was observed; what a table doesn't keep is 0."""
    I_max, I_min, alpha, uniqueness = table.inertia[row]
    zero, two = np.float32(0.0), np.zeros(2, np.float32)
    beside = np.zeros((MOST_BROTHERS, BROTHER_FIELDS), np.float32)
    beside[: table.brothers.shape[1]] = table.brothers[row]
    return RegionFeatures(
        inertia=FaceInertia(zero, two, I_max, I_min, alpha, uniqueness), outline=table.outline[row],
        egi=table.egi[row], mass_centre=table.mass_centre[row], mean_normal=table.mean_normal[row],
        normal_scatter=two, area=table.area[row], shares=table.shares[row],
        characteristic_map=table.characteristic_map[row].astype(np.float32),
        edge_map=table.edge_map[row].astype(np.float32), brothers=beside,
    )  # fmt: skip


@pytest.fixture(scope="session")
def as_features():
    return features_of_row
