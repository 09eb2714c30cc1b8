"""Surface characteristics: the table of sec. 5.2 on surfaces of known kind, with and without noise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.characteristics import CHARACTERISTICS, characteristic_shares, characteristics
from itree_jax.features.window import Window

PLANAR, CYLINDRICAL, CONVEX, CONCAVE, HYPERBOLIC = range(5)
DEGREE = np.radians(1.0)
STD = np.float32(0.2 * DEGREE)
memberships_of = jax.jit(characteristics)
shares_of = jax.jit(lambda window, std: characteristic_shares(characteristics(window, std), window))


def disc(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.hypot(u, v) < 20


def test_every_surface_has_its_name(make_surface_window, shapes) -> None:
    surfaces = {
        "planar": shapes.plane(0.6, -0.3),
        "cylindrical": shapes.cylinder(20.0, 0.4),
        "convex elliptic": shapes.sphere(30.0),
        "concave elliptic": shapes.sphere(30.0, -1.0),
        "hyperbolic": shapes.neck(30.0, 50.0),
    }
    assert tuple(surfaces) == CHARACTERISTICS
    for index, normals in enumerate(surfaces.values()):
        for roll in (0.0, 0.5):
            shares = np.asarray(shares_of(make_surface_window(normals, disc, roll), STD))
            assert shares[index] > 0.97, (CHARACTERISTICS[index], shares)


def test_a_hollow_cylinder_is_cylindrical_too(make_surface_window, shapes) -> None:
    assert float(shares_of(make_surface_window(shapes.cylinder(20.0, 0.3, -1.0), disc), STD)[CYLINDRICAL]) > 0.97


@pytest.mark.parametrize("needle_std", [0.1, 1.0, 4.0])
@pytest.mark.parametrize("slant", [0.0, 45.0])
def test_a_noisy_plane_stays_planar(make_surface_window, shapes, needle_std: float, slant: float) -> None:
    std = needle_std * DEGREE
    window = make_surface_window(shapes.plane(np.tan(np.radians(slant)), 0.0), disc, needle_std=std)
    assert float(shares_of(window, np.float32(std))[PLANAR]) > 0.95


@pytest.mark.parametrize("facet", [0.0, 5 * DEGREE])
@pytest.mark.parametrize("roll", [0.0, 0.6])
def test_a_noisy_cylinder_stays_cylindrical(make_surface_window, shapes, facet: float, roll: float) -> None:
    normals = shapes.cylinder(20.0, 0.3, facet=facet)
    window = make_surface_window(normals, disc, roll, needle_std=DEGREE, slant_limit=np.radians(45))
    assert float(shares_of(window, np.float32(DEGREE))[CYLINDRICAL]) > 0.97


@pytest.mark.parametrize("radius", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("facet", [4 * DEGREE, 5 * DEGREE])
def test_facets_of_a_cylinder_are_neither_planes_nor_creases(
    make_surface_window, shapes, radius: float, facet: float
) -> None:
    normals = shapes.cylinder(radius, 0.3, facet=facet)
    window = make_surface_window(normals, lambda u, v: np.abs(u) < 25, 0.4, slant_limit=np.radians(45))
    assert float(shares_of(window, STD)[CYLINDRICAL]) > 0.97


@pytest.mark.parametrize("needle_std", [0.05, 1.0])
@pytest.mark.parametrize("dihedral", [15.0, 30.0, 70.0, -40.0])
@pytest.mark.parametrize("roll", [0.0, 0.6])
def test_a_crease_between_planes_is_not_called_curved(
    make_surface_window, shapes, needle_std: float, dihedral: float, roll: float
) -> None:
    lean, std = np.tan(np.radians(dihedral / 2)), needle_std * DEGREE
    left, right = shapes.plane(-lean, 0.2), shapes.plane(lean, 0.2)
    window = make_surface_window(
        lambda u, v: np.where((u < 0)[..., None], left(u, v), right(u, v)), disc, roll, needle_std=std
    )
    shares = np.asarray(shares_of(window, np.float32(std)))
    assert shares[PLANAR] > 0.7
    assert shares[1:].sum() < 0.03
    known = np.asarray(memberships_of(window, np.float32(std))).sum(axis=-1) > 0
    assert not known[23:25, 23:25].any()  # the middle of the window lies on the crease


def test_better_needles_tell_a_fainter_bend_from_a_plane_down_to_the_floor(make_surface_window, shapes) -> None:
    def cylindrical(radius: float, needle_std: float) -> float:
        window = make_surface_window(shapes.cylinder(radius), disc)
        return float(shares_of(window, np.float32(needle_std * DEGREE))[CYLINDRICAL])

    assert cylindrical(100.0, 4.0) < 0.05
    assert cylindrical(100.0, 0.2) > 0.95
    assert cylindrical(2000.0, 0.0) < 0.05  # 25 times the window, bent by less than 2 degrees


def test_memberships_sum_to_1_where_known_and_to_0_elsewhere(make_surface_window, shapes) -> None:
    window = make_surface_window(shapes.cylinder(40.0), lambda u, v: disc(u, v) | (np.abs(v) < 1), needle_std=DEGREE)
    memberships = np.asarray(memberships_of(window, np.float32(DEGREE)))
    total = memberships.sum(axis=-1)
    assert memberships.shape == (48, 48, 5)
    assert memberships.dtype == np.float32
    assert (memberships >= 0).all()
    known = total > 0.5
    np.testing.assert_allclose(total[known], 1.0, atol=1e-6)
    np.testing.assert_array_equal(total[~known], 0.0)
    assert not known[~window.mask].any()
    assert 0 < (window.mask & ~known).sum() < 0.15 * window.mask.sum()  # the strip outside the disc is too narrow


def test_shares_are_by_surface_not_by_pixels(make_surface_window, shapes) -> None:
    steep, bend = shapes.plane(np.sqrt(3.0), 0.0), shapes.cylinder(20.0)
    window = make_surface_window(
        lambda u, v: np.where((u < 0)[..., None], steep(u, v), bend(u, v)),
        lambda u, v: (np.abs(u) < 20) & (np.abs(v) < 4), slant_limit=np.radians(80),
    )
    memberships = np.zeros((48, 48, 5), dtype=np.float32)
    memberships[:, :24, PLANAR], memberships[:, 24:, CYLINDRICAL] = 1, 1
    shares = np.asarray(characteristic_shares(jnp.asarray(memberships * window.mask[..., None]), window))
    assert shares.sum() == pytest.approx(1.0, abs=1e-5)
    assert shares[PLANAR] == pytest.approx(2 / 3, abs=0.01)  # 60 degrees of slant: twice the surface


@pytest.mark.parametrize("radius", [60.0, 110.0])
def test_the_derivative_is_that_of_finite_differences(make_surface_window, shapes, radius: float) -> None:
    """At curvatures that the noise leaves undecided, where memberships change fastest."""
    window = make_surface_window(
        shapes.cylinder(radius, 0.3), lambda u, v: np.hypot(u, v) < 10, 0.4, needle_std=0.5 * DEGREE, size=16
    )
    rng = np.random.default_rng(1)
    weight = jnp.asarray(rng.normal(size=(16, 16, 5)), dtype=jnp.float32)
    std = jnp.float32(2.0 * DEGREE)

    @jax.jit
    def score(normals):
        return jnp.sum(weight * characteristics(Window(window.mask, normals, window.pitch), std))

    slope = np.asarray(jax.jit(jax.grad(score))(jnp.asarray(window.normals)))
    for _ in range(5):
        way = (rng.normal(size=window.normals.shape) * window.mask[..., None]).astype(np.float32)
        step = np.float32(1e-3)
        numeric = (score(window.normals + step * way) - score(window.normals - step * way)) / (2 * step)
        scale = np.linalg.norm(slope) * np.linalg.norm(way) / np.sqrt(way.size)
        assert float(numeric) == pytest.approx(float(np.sum(slope * way)), abs=0.02 * scale)


@pytest.mark.parametrize("name", ["plane", "sphere", "cylinder"])
def test_exact_surfaces_have_finite_derivatives(make_surface_window, shapes, name: str) -> None:
    normals = {"plane": shapes.plane(0.0, 0.0), "sphere": shapes.sphere(40.0), "cylinder": shapes.cylinder(40.0)}[name]
    window = make_surface_window(normals, disc)
    slope = jax.jit(
        jax.grad(lambda n: jnp.sum(characteristics(window._replace(normals=n), jnp.float32(0.0))[..., CYLINDRICAL]))
    )(jnp.asarray(window.normals))
    assert np.isfinite(slope).all()


def test_an_empty_region_has_no_shares() -> None:
    empty = Window(np.zeros((8, 8), dtype=bool), np.zeros((8, 8, 3), dtype=np.float32), np.float32(1))
    np.testing.assert_array_equal(shares_of(empty, STD), 0.0)
