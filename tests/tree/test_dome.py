"""The geodesic dome."""

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from scipy.spatial.transform import Rotation

from itree_jax.tree.dome import GOLDEN, camera_rotation, dome, parent_view


@pytest.mark.parametrize("frequency", [1, 2, 3])
def test_there_are_60_f_squared_different_directions(frequency: int) -> None:
    directions = dome(frequency).directions
    assert directions.shape == (60 * frequency**2, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
    assert np.sort(directions @ directions.T, axis=1)[:, -2].max() < np.cos(np.radians(10 / frequency))


def test_the_first_dome_looks_from_the_centroids_of_plane_triangles() -> None:
    # The pentagon around (0, 1, g) has the corners (+-1, 1, 1), (0, g, 1/g), (+-1/g, 0, g).
    corners = np.array(
        [(1, 1, 1), (1 / GOLDEN, 0, GOLDEN), (-1 / GOLDEN, 0, GOLDEN), (-1, 1, 1), (0, GOLDEN, 1 / GOLDEN)]
    )
    centroids = (corners.mean(axis=0) + corners + np.roll(corners, -1, axis=0)) / 3
    expected = centroids / np.linalg.norm(centroids, axis=1, keepdims=True)
    nearest = (dome(1).directions @ expected.T).max(axis=0)
    np.testing.assert_allclose(nearest, 1.0, atol=1e-12)


@pytest.mark.parametrize("frequency", [1, 3])
def test_the_directions_have_the_symmetries_of_the_dodecahedron(frequency: int) -> None:
    directions = dome(frequency).directions
    axis = np.array([0, 1, GOLDEN]) / np.hypot(1, GOLDEN)
    for turn in (2 * np.pi / 5 * axis, np.array([0, 0, np.pi]), 2 * np.pi / 3 * np.ones(3) / 3**0.5):
        turned = directions @ Rotation.from_rotvec(turn).as_matrix().T
        np.testing.assert_allclose((turned @ directions.T).max(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose((-directions @ directions.T).max(axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("frequency", [1, 2, 4])
def test_the_triangles_tile_the_dodecahedron_facing_outward(frequency: int) -> None:
    a, b, c = np.moveaxis(dome(frequency).triangles, 1, 0)
    normal_area = np.cross(b - a, c - a) / 2
    assert (np.sum(normal_area * dome(frequency).directions, axis=1) > 0).all()
    inradius_of_unit_edge = np.sqrt(250 + 110 * np.sqrt(5)) / 20
    surface_of_unit_edge = 3 * np.sqrt(25 + 10 * np.sqrt(5))
    total = np.linalg.norm(normal_area, axis=1).sum()
    assert total == pytest.approx(surface_of_unit_edge / inradius_of_unit_edge**2, rel=1e-12)


@pytest.mark.parametrize(("frequency", "k"), [(1, 1), (1, 3), (2, 2), (3, 2)])
def test_a_finer_dome_nests_in_the_coarser_one(frequency: int, k: int) -> None:
    coarse, fine = dome(frequency), dome(frequency * k)
    parent = parent_view(frequency, k)
    np.testing.assert_array_equal(np.bincount(parent), k**2)
    # The small triangle's centroid is a convex combination of its parent's corners.
    weights = np.linalg.solve(
        np.swapaxes(coarse.triangles[parent], 1, 2), fine.triangles.mean(axis=1)[..., None]
    ).squeeze(-1)
    assert weights.min() > 0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)


def test_the_camera_looks_at_the_part_with_z_up() -> None:
    directions = np.concatenate([dome(2).directions, [[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0]]])
    R = camera_rotation(directions)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(np.einsum("vij,vj->vi", R, directions), np.tile([0, 0, -1.0], (len(R), 1)), atol=1e-12)
    z_in_image = R[:, :2, 2]
    np.testing.assert_allclose(z_in_image[:, 0], 0.0, atol=1e-12)
    assert (z_in_image[:-3, 1] < 0).all()  # image y points down
    np.testing.assert_allclose(R[-3:-1, :, 1], [[0, -1, 0], [0, -1, 0]], atol=1e-12)  # along z, the part's y is up
    np.testing.assert_array_equal(camera_rotation(directions[3]), R[3])


@pytest.mark.parametrize("frequency", [0, -1])
def test_a_frequency_under_1_is_refused(frequency: int) -> None:
    with pytest.raises(ItreeError, match="whole number"):
        dome(frequency)
