"""Laws of the extended Gaussian image."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from itree_jax.features import egi
from itree_jax.features.egi import MOST_PATCHES, WIDTH, egi_cells, spread_patches, visible_cells


def extended_gaussian_image(normals, areas, cells) -> np.ndarray:
    arrays = (jnp.asarray(np.asarray(a, dtype=np.float32)) for a in (normals, areas, cells))
    return np.asarray(egi.extended_gaussian_image(*arrays))


def egi_mass_centre(normals, areas) -> np.ndarray:
    return np.asarray(egi.egi_mass_centre(jnp.asarray(normals), jnp.asarray(areas)))


def ellipsoid(axes=(1.0, 2.0, 3.0), n: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Normals and areas of patches over a closed convex surface, in opposite pairs."""
    k = np.arange(n // 2) + 0.5
    z, azimuth = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    half = np.stack([np.sqrt(1 - z**2) * np.cos(azimuth), np.sqrt(1 - z**2) * np.sin(azimuth), z], axis=1)
    point = np.concatenate([half, -half])
    stretched = point / np.array(axes)  # normal of the ellipsoid above a point of the unit sphere, by cofactors
    length = np.linalg.norm(stretched, axis=1)
    areas = np.prod(axes) * length * 4 * np.pi / n
    return (stretched / length[:, None]).astype(np.float32), areas.astype(np.float32)


def turn_of_the_icosahedron(index: int) -> np.ndarray:
    return Rotation.create_group("I").as_matrix()[index]


def icosahedral_turns_of_the_cells() -> list[np.ndarray]:
    """Rotations that permute the cells: scipy's icosahedral group, turned to the dome's axes if need be."""
    cells = egi_cells().astype(float)
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    for frame in (np.eye(3), quarter):
        turns = [frame @ turn_of_the_icosahedron(i) @ frame.T for i in range(60)]
        if all(np.abs((cells @ R.T) @ cells.T).max(axis=1).min() > 1 - 1e-6 for R in turns):
            return turns
    raise AssertionError("the dome does not have the symmetries of the icosahedron")


def test_the_egi_of_a_solid_turned_by_a_symmetry_of_the_cells_is_the_turned_egi() -> None:
    normals, areas = ellipsoid()
    cells = egi_cells()
    image = extended_gaussian_image(normals, areas, cells)
    for R in icosahedral_turns_of_the_cells()[1::7]:
        turned = extended_gaussian_image((normals @ R.T), areas, cells)
        moved_to = np.argmax((cells @ R.T) @ cells.T, axis=1)  # cell k goes to moved_to[k]
        assert sorted(moved_to) == list(range(len(cells)))
        np.testing.assert_allclose(turned[moved_to], image, rtol=2e-3, atol=1e-4 * image.max())


def test_the_egi_of_a_turned_solid_is_nearly_the_turned_egi_for_any_turn() -> None:
    normals, areas = ellipsoid()
    front = normals[:, 0] > 0.2  # an open piece: it has a first moment to turn
    normals, areas = normals[front], areas[front]
    R = Rotation.random(rng=np.random.default_rng(7)).as_matrix()
    cells = egi_cells().astype(float)
    image = extended_gaussian_image(normals, areas, cells)
    turned = extended_gaussian_image(normals @ R.T, areas, cells)
    total = areas.sum()
    np.testing.assert_allclose(turned @ cells / total, R @ (image @ cells) / total, atol=2e-3)
    spread, turned_spread = (np.einsum("c,ci,cj->ij", mass, cells, cells) / total for mass in (image, turned))
    np.testing.assert_allclose(turned_spread, R @ spread @ R.T, atol=4e-3)


def test_mass_is_the_surface_area() -> None:
    normals, areas = ellipsoid()
    assert float(extended_gaussian_image(normals, areas, egi_cells()).sum()) == pytest.approx(areas.sum(), rel=1e-5)


def test_a_closed_surface_has_its_mass_centre_at_0_and_a_plane_on_the_sphere() -> None:
    normals, areas = ellipsoid()
    np.testing.assert_allclose(egi_mass_centre(normals, areas), 0.0, atol=1e-6)
    image = extended_gaussian_image(normals, areas, egi_cells())
    np.testing.assert_allclose(image @ egi_cells() / image.sum(), 0.0, atol=1e-5)
    plane = np.tile(np.float32([0.6, 0, -0.8]), (50, 1))
    np.testing.assert_allclose(egi_mass_centre(plane, np.ones(50, np.float32)), [0.6, 0, -0.8], rtol=1e-6)


def test_a_hemisphere_has_its_mass_centre_half_way() -> None:
    normals, areas = ellipsoid((1.0, 1.0, 1.0), 20000)
    near = normals[:, 2] < 0
    np.testing.assert_allclose(egi_mass_centre(normals[near], areas[near]), [0, 0, -0.5], atol=1e-3)


def test_the_viewer_sees_one_of_every_two_opposite_cells() -> None:
    visible = visible_cells()
    assert visible.shape == (264, 3)
    assert (visible[:, 2] < 0).all()


def test_the_egi_has_the_derivative_that_finite_differences_give() -> None:
    rng = np.random.default_rng(3)
    with jax.enable_x64(True):
        cells = jnp.asarray(egi_cells().astype(np.float64))
        normals = jnp.asarray(Rotation.random(20, rng=rng).as_matrix()[:, :, 0])
        areas, weight = jnp.asarray(rng.uniform(1, 2, 20)), jnp.asarray(rng.normal(size=len(cells)))
        step = jnp.asarray(rng.normal(size=(20, 3)))

        def loss(t):
            moved = normals + t * step
            length = jnp.linalg.norm(moved, axis=1, keepdims=True)
            return egi.extended_gaussian_image(moved / length, areas, cells) @ weight

        h = 1e-6
        numeric = (loss(h) - loss(-h)) / (2 * h)
        assert float(jax.grad(loss)(0.0)) == pytest.approx(float(numeric), rel=1e-6)


def test_the_weights_are_half_a_cell_wide() -> None:
    cells = egi_cells().astype(float)
    nearest = np.sort(cells @ cells.T, axis=1)[:, -2]
    assert 0.3 < WIDTH / np.arccos(nearest).mean() < 1.0


def test_pixels_off_the_region_have_no_mass() -> None:
    normals = np.float32([[0, 0, 0], [0, 0, -1]])
    image = extended_gaussian_image(normals, np.float32([0, 3]), visible_cells())
    assert float(image.sum()) == pytest.approx(3.0)


def spread(normals, areas, most: int) -> tuple[np.ndarray, np.ndarray]:
    arrays = (jnp.asarray(np.asarray(a, dtype=np.float32)) for a in (normals, areas))
    return tuple(np.asarray(a) for a in spread_patches(*arrays, most))


def numbered(there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Patches whose "normal" is their number, with area 1 + number where there is one."""
    number = np.arange(len(there))
    return np.tile(number[:, None], (1, 3)), np.where(there, 1.0 + number, 0.0)


@pytest.mark.parametrize("count", [0, 1, 7, 20])
def test_few_patches_are_all_taken_once_and_unchanged(count) -> None:
    there = np.zeros(60, bool)
    there[np.random.default_rng(count).choice(60, count, replace=False)] = True
    normals, areas = numbered(there)
    number, area = spread(normals, areas, 20)
    assert number.shape == (20, 3)
    assert number[:count, 0].tolist() == np.flatnonzero(there).tolist()
    np.testing.assert_allclose(area[:count], areas[there], rtol=1e-6)
    np.testing.assert_array_equal(area[count:], 0.0)


@pytest.mark.parametrize("count", [21, 30, 40, 59])
def test_of_many_patches_some_are_taken_at_even_steps_with_the_area_of_all(count) -> None:
    there = np.zeros(60, bool)
    there[np.random.default_rng(count).choice(60, count, replace=False)] = True
    normals, areas = numbered(there)
    number, area = spread(normals, areas, 20)
    rank = np.cumsum(there)[number[:, 0].astype(int)]
    assert there[number[:, 0].astype(int)].all()
    assert set(np.diff(rank).tolist()) <= {count // 20, count // 20 + 1}
    assert area.sum() == pytest.approx(areas.sum(), rel=1e-5)
    own = areas[number[:, 0].astype(int)]
    np.testing.assert_allclose(area / own, area.sum() / own.sum(), rtol=1e-5)


def test_spread_pixels_of_a_region_have_nearly_the_egi_of_all() -> None:
    """The largest region that a curved part can have: a sphere that fills the window, to a slant of 42 degrees."""
    x, y = np.meshgrid(*[(np.arange(48) - 23.5) / 21.8] * 2)
    inside = x**2 + y**2 < np.sin(np.radians(42)) ** 2
    normals = np.stack([x, y, -np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1) * inside[..., None]
    normals = normals.reshape(-1, 3)
    areas = np.where(inside.ravel(), 1.0 / np.maximum(-normals[:, 2], 0.5), 0.0)
    assert inside.sum() > 1.5 * MOST_PATCHES
    whole = extended_gaussian_image(normals, areas, visible_cells())
    some = extended_gaussian_image(*spread(normals, areas, MOST_PATCHES), visible_cells())
    assert some.sum() == pytest.approx(whole.sum(), rel=1e-4)
    assert np.abs(some - whole).sum() < 0.05 * whole.sum()
