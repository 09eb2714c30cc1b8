"""Fitted analytic surfaces: distances vanish on the surface, normals are gradients, and the types tell apart."""

import numpy as np
import pytest
from itree_cad.surfaces import FittedSurface, fit_any
from itree_cad.symmetry import rotation

DIAMETER = 60.0
TOLERANCE = 1e-4 * DIAMETER
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
POINT = np.array([3.0, -7.0, 11.0])

SURFACES = [
    FittedSurface("plane", POINT, AXIS),
    FittedSurface("cylinder", POINT, AXIS, 9.0),
    FittedSurface("cone", POINT, AXIS, 0.4),
    FittedSurface("sphere", POINT, AXIS, 12.0),
    FittedSurface("torus", POINT, AXIS, 14.0, 4.0),
]


def patch(surface, turn):
    """Points on a patch of the surface and their normals, in closed form: `turn` [rad] of its circle."""
    u, v = (grid.reshape(-1) for grid in np.meshgrid(np.linspace(0.0, turn, 13), np.linspace(0.3, 1.2, 11)))
    radial = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1)
    z = np.array([0.0, 0.0, 1.0])
    a, b = surface.size_a, surface.size_b
    if surface.type == "plane":
        points, normals = np.stack([10.0 * u, 10.0 * v, 0.0 * u], axis=-1), np.broadcast_to(z, radial.shape)
    elif surface.type == "cylinder":
        points, normals = a * radial + 10.0 * v[:, None] * z, radial
    elif surface.type == "cone":
        along = np.cos(a) * z + np.sin(a) * radial
        points, normals = 20.0 * v[:, None] * along, np.cos(a) * radial - np.sin(a) * z
    elif surface.type == "sphere":
        normals = np.cos(v)[:, None] * radial + np.sin(v)[:, None] * z
        points = a * normals
    else:
        normals = np.cos(v)[:, None] * radial + np.sin(v)[:, None] * z
        points = a * radial + b * normals
    turned = rotation(np.cross(z, AXIS) / np.linalg.norm(np.cross(z, AXIS)), np.arccos(AXIS[2]))
    return points @ turned.T + POINT, normals @ turned.T


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.type)
def test_distance_vanishes_on_the_surface_and_grows_along_the_normal(surface):
    points, normals = patch(surface, 1.5)
    np.testing.assert_allclose(surface.distance(points), 0.0, atol=1e-12 * DIAMETER)
    np.testing.assert_allclose(surface.distance(points + 0.5 * normals), 0.5, atol=1e-12 * DIAMETER)
    np.testing.assert_allclose(surface.normal(points), normals, atol=1e-12)


@pytest.mark.parametrize("turn", [0.6, 2.0, 6.0])
@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: s.type)
def test_a_patch_is_fitted_by_its_own_type(surface, turn):
    points, normals = patch(surface, turn)
    found = fit_any(points, points, normals, np.ones(len(points)), TOLERANCE, DIAMETER)
    assert found is not None
    assert found.type == surface.type
    np.testing.assert_allclose(found.distance(points), 0.0, atol=TOLERANCE)
    sizes = (surface.size_a, surface.size_b)
    np.testing.assert_allclose((found.size_a, found.size_b), sizes, rtol=1e-3)
    if surface.type not in ("sphere",):
        assert abs(found.axis @ surface.axis) == pytest.approx(1.0, abs=1e-5)


def test_a_saddle_is_no_surface_of_revolution():
    x, y = (grid.reshape(-1) for grid in np.meshgrid(np.linspace(-8, 8, 11), np.linspace(-8, 8, 11)))
    points = np.stack([x, y, 0.03 * x**2 - 0.05 * y**2 + 0.002 * x**3], axis=-1)
    normals = np.stack([0.06 * x + 0.006 * x**2, -0.1 * y, -np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert fit_any(points, points, normals, np.ones(len(points)), TOLERANCE, DIAMETER) is None
