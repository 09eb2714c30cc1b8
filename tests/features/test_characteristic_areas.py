"""Rectangles of one characteristic on the face, and back on the image (Ikeuchi 1987, sec. 3.4 and 5.2)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from itree_jax.features.characteristic_areas import area_support, areas_on_image, characteristic_areas
from itree_jax.features.characteristics import characteristics
from itree_jax.features.inertia import face_inertia, mean_normal
from itree_jax.features.rectify import affine_T, gradient_space
from itree_jax.features.window import Window

PLANAR, CYLINDRICAL = 0, 1
STD = np.float32(np.radians(0.2))
PITCH, SIZE = 1.0, 72


@pytest.fixture(scope="module")
def composite(make_surface_window, shapes):
    """A plane 40 mm long (u < 10) beside a cylinder 20 mm long of radius 20, both 24 mm wide."""

    def make(roll: float, needle_std: float = 0.0) -> Window:
        plane, bend = shapes.plane(0.0, 0.0), shapes.cylinder(20.0)
        return make_surface_window(
            lambda u, v: np.where((u < 10)[..., None], plane(u, v), bend(u, v)),
            lambda u, v: (np.abs(u) < 30) & (np.abs(v) < 12), roll, pitch=PITCH, size=SIZE, needle_std=needle_std,
        )

    return make


def placed(window: Window, areas, half_turn: bool = False) -> np.ndarray:
    """Polygons of the areas on the same region."""
    T = affine_T(*gradient_space(mean_normal(window)))
    inertia = face_inertia(window)
    alpha = float(inertia.alpha) + (np.pi if half_turn else 0.0)
    pitch, size = float(window.pitch), len(window.mask)
    return areas_on_image(areas, np.asarray(T), np.asarray(inertia.centroid), alpha, pitch, size)


def extent(vertices: np.ndarray) -> np.ndarray:
    """Least and largest coordinate along both axes."""
    return np.concatenate([vertices.min(axis=0), vertices.max(axis=0)])


def test_the_rectangles_of_a_plane_beside_a_cylinder_lie_where_they_are(composite) -> None:
    window = composite(0.0)
    areas = characteristic_areas(window, float(STD))
    assert [a.characteristic for a in areas] == [PLANAR, CYLINDRICAL]
    centre = float(face_inertia(window).centroid[0])
    # The crease takes two pixels from each piece, but for the cylinder's middle, which goes on from the plane smoothly.
    np.testing.assert_allclose(extent(areas[0].vertices), np.array([-30 - centre, -12, 8 - centre, 12]), atol=1.01)
    np.testing.assert_allclose(extent(areas[1].vertices), np.array([8 - centre, -12, 30 - centre, 12]), atol=1.01)
    assert areas[0].area == pytest.approx(38 * 24, rel=0.03)
    assert areas[1].area == pytest.approx(18 * 2 * 20 * np.arcsin(12 / 20), rel=0.06)


@pytest.mark.parametrize("roll", [-1.2, -0.4, 0.3, 0.9])
def test_the_rectangles_turn_with_the_region(composite, roll: float) -> None:
    upright, turned = (characteristic_areas(composite(r), float(STD)) for r in (0.0, roll))
    assert [a.characteristic for a in turned] == [PLANAR, CYLINDRICAL]
    for one, other in zip(upright, turned, strict=True):
        np.testing.assert_allclose(extent(other.vertices), extent(one.vertices), atol=2.0)
        assert other.area == pytest.approx(one.area, rel=0.08)


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.7, 0.3), (-0.4, 0.8)])
def test_the_rectangle_of_a_slanted_plane_has_its_true_sides(make_face_window, p: float, q: float) -> None:
    turn = 0.5

    def inside(x, y):
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        return (np.abs(u) <= 22) & (np.abs(v) <= 8)

    (area,) = characteristic_areas(make_face_window(inside, p, q), float(STD))
    assert area.characteristic == PLANAR
    sides = np.sort(np.linalg.norm(area.vertices[:2] - area.vertices[1:3], axis=1))
    np.testing.assert_allclose(sides, [16, 44], atol=2.5)
    np.testing.assert_allclose(area.vertices.mean(axis=0), 0.0, atol=0.7)
    assert area.area == pytest.approx(16 * 44, rel=0.05)
    # along the larger moment, up to the jagged border
    np.testing.assert_allclose(extent(area.vertices), [-22, -8, 22, 8], atol=2.5)


def test_polygons_on_the_image_are_the_inverse_of_the_rectangles(composite) -> None:
    window = composite(0.7)
    areas = characteristic_areas(window, float(STD))
    T, alpha, centroid = np.array([[1.3, 0.2], [0.0, 1.1]]), 2.1, np.array([3.0, -5.0])
    polygons = areas_on_image(areas, T, centroid, alpha, 0.8, 48)
    assert polygons.shape == (2, 4, 2)
    on_face = ((polygons - 23.5) * 0.8 - centroid) @ T.T
    c, s = np.cos(alpha), np.sin(alpha)
    np.testing.assert_allclose(on_face @ np.array([[c, -s], [s, c]]), [a.vertices for a in areas], atol=1e-4)


def test_no_areas_have_no_polygons() -> None:
    assert areas_on_image([], np.eye(2), np.zeros(2), 0.0, 1.0, 48).shape == (0, 4, 2)


@pytest.mark.parametrize("roll", [0.0, 0.5])
def test_the_supposed_characteristic_is_found_in_its_place_and_nowhere_else(composite, roll: float) -> None:
    areas = characteristic_areas(composite(roll), float(STD))
    noisy = composite(roll, needle_std=0.01)
    memberships = jax.jit(characteristics)(noisy, np.float32(0.01))
    supports = jax.jit(jax.vmap(area_support, in_axes=(None, 0, 0)))
    kinds = np.array([a.characteristic for a in areas])
    there, half_turned = placed(noisy, areas), placed(noisy, areas, half_turn=True)
    np.testing.assert_allclose(supports(memberships, there, kinds), [a.support for a in areas], atol=0.08)
    assert min(a.support for a in areas) > 0.7
    assert (np.asarray(supports(memberships, there, 1 - kinds)) < 0.05).all()
    # Turned by half the cylinder's place lies on the plane, and part of the plane's on the cylinder.
    other_way = np.asarray(supports(memberships, half_turned, kinds))
    assert other_way[1] < 0.05
    assert other_way[0] < 0.6


@pytest.mark.parametrize("sense", [1, -1])
def test_the_support_of_a_rectangle_that_is_half_off_the_window_is_a_half(sense: int) -> None:
    memberships = jnp.zeros((48, 48, 5)).at[..., PLANAR].set(1.0)
    polygon = np.array([[-10.5, 10.2], [9.5, 10.2], [9.5, 20.7], [-10.5, 20.7]], dtype=np.float32)
    polygon = jnp.asarray(polygon[::sense])
    assert float(area_support(memberships, polygon, PLANAR)) == pytest.approx(0.5, abs=1e-5)
    assert float(area_support(memberships, polygon, CYLINDRICAL)) == 0.0
    assert float(area_support(memberships, jnp.zeros((4, 2)), PLANAR)) == 0.0


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.785, 1.3])
def test_the_support_of_a_place_that_is_all_of_one_kind_is_1(turn: float) -> None:
    memberships = jnp.zeros((48, 48, 5)).at[..., PLANAR].set(1.0)
    for width, within in ((0.6, 0.1), (5.0, 0.02)):
        corners = np.array([[-9, -width / 2], [9, -width / 2], [9, width / 2], [-9, width / 2]])
        turned = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + 23.3
        support = float(area_support(memberships, jnp.asarray(turned, dtype=jnp.float32), PLANAR))
        assert support == pytest.approx(1.0, abs=within)


def test_at_most_so_many_areas_the_largest_first(composite) -> None:
    window = composite(0.0)
    assert [a.characteristic for a in characteristic_areas(window, float(STD), most=1)] == [PLANAR]
    assert [a.characteristic for a in characteristic_areas(window, float(STD), least_share=0.5)] == [PLANAR]


def test_an_empty_region_has_no_areas() -> None:
    empty = Window(np.zeros((16, 16), dtype=bool), np.zeros((16, 16, 3), dtype=np.float32), np.float32(1))
    assert characteristic_areas(empty, float(STD)) == []
