"""Distances to triangles: closed forms, and the quick answer against the exact one."""

import numpy as np
from itree_cad.bundled import bundled_part
from itree_cad.surface_distance import SurfaceDistance, surface_sample

from ..primitives import box_part


def box_surface_distance(points, half):
    """Closed form: outside by the excess, inside by the nearest wall."""
    excess = np.abs(points) - half
    outside = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
    return np.where((excess > 0.0).any(axis=1), outside, -excess.max(axis=1))


def test_distance_to_a_box():
    points = np.random.default_rng(0).uniform(-30.0, 30.0, (400, 3))
    part = box_part(20.0, 30.0, 24.0)
    surface = SurfaceDistance(part.vertices, part.triangles)
    expected = box_surface_distance(points, np.array([10.0, 15.0, 12.0]))
    np.testing.assert_allclose(surface.exact(points), expected, atol=1e-9)
    assert (surface.near(points) >= expected - 1e-9).all()


def test_samples_lie_on_the_surface_and_spread_by_area():
    part = bundled_part("bracket")
    surface = SurfaceDistance(part.vertices, part.triangles)
    points = surface_sample(part.vertices, part.triangles, 4000, seed=4)
    assert surface.all_within(points, 1e-9 * part.diameter)
    top = np.isclose(points[:, 2], 0.0).mean()  # the underside is face 0
    np.testing.assert_allclose(top, part.face_areas[0] / part.face_areas.sum(), atol=0.01)


def test_all_within_is_exact_at_the_tolerance():
    part = box_part(20.0, 20.0, 20.0)
    surface = SurfaceDistance(part.vertices, part.triangles)
    points = 1.1 * surface_sample(part.vertices, part.triangles, 500, seed=5)
    largest = surface.exact(points).max()
    assert surface.all_within(points, largest * (1 + 1e-9))
    assert not surface.all_within(points, largest * (1 - 1e-9))
