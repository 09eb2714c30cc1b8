"""Signed distance against closed forms of sphere, box and a solid with a notch."""

import numpy as np
import pytest
import trimesh
from itree_kernels.inside import signed_distance

from .solids import as_ray_mesh

COUNT = 500


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Signed distance to a box about the origin."""
    beyond = np.abs(points) - half
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (40.0, -25.0, 7.0)])
def test_box(shift):
    """Inside, outside, beside edges and corners; the mesh need not be about the origin."""
    edges = np.array([30.0, 20.0, 10.0])
    mesh = as_ray_mesh(trimesh.creation.box(edges, transform=trimesh.transformations.translation_matrix(shift)))
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (COUNT, 3)) * edges
    expected = box_distance(points, edges / 2)
    assert (expected < 0).sum() > 50
    np.testing.assert_allclose(signed_distance(mesh, points + shift), expected, rtol=0, atol=2e-5)


def test_sphere():
    """The facets lie between the sphere and its inscribed one."""
    radius = 25.0
    mesh = as_ray_mesh(trimesh.creation.icosphere(subdivisions=4, radius=radius))
    inradius = np.sum(mesh.vertices[mesh.triangles[:, 0]] * mesh.triangle_normals, axis=1).min()
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    r = np.concatenate([rng.uniform(0.0, 50.0, COUNT - 2), [0.0, 500.0]])
    distance = signed_distance(mesh, direction * r[:, None])
    assert (distance >= r - radius - 1e-4).all()
    assert (distance <= r - inradius + 1e-4).all()
    sure = (r < inradius) | (r > radius)
    np.testing.assert_array_equal(np.sign(distance[sure]), np.sign(r[sure] - radius))


def test_a_notch_is_outside():
    """A U of three boxes (one closed surface): its hollow is outside, its walls are inside."""
    outer = trimesh.creation.box((30, 20, 20))
    notch = trimesh.creation.box((10, 30, 15), transform=trimesh.transformations.translation_matrix((0, 0, 5)))
    mesh = as_ray_mesh(trimesh.boolean.difference([outer, notch], engine="manifold"))
    points = np.array([[0.0, 0, 5], [0, 0, -6], [10, 0, 5], [-12, 3, 8], [0, 0, 30]])
    np.testing.assert_allclose(signed_distance(mesh, points), [5.0, -3.5, -5.0, -2.0, np.hypot(20, 5)], atol=2e-5)


def test_no_points():
    mesh = as_ray_mesh(trimesh.creation.box((1, 1, 1)))
    assert signed_distance(mesh, np.zeros((0, 3))).shape == (0,)
