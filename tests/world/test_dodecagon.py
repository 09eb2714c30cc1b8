"""Laws of the dodecagon and the prism over it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.errors import ItreeError

from itree_jax.world.dodecagon import SIDES, around, dodecagon, hull_points, polygon_area
from itree_jax.world.prism import Prism, prisms_over

seeds = st.integers(0, 2**32 - 1)


def circle(radius: float, count: int = 7200) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return radius * np.stack([np.cos(a), np.sin(a)], axis=-1)


def pixel_sheet(mask: np.ndarray, height: float = 10.0) -> np.ndarray:
    """Corners of the unit squares of a mask, all at one height."""
    v, u = np.nonzero(mask)
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    xy = np.stack([u, v], axis=-1)[:, None] + corner
    return np.concatenate([xy, np.full((*xy.shape[:2], 1), height)], axis=-1)


@given(seeds, st.integers(1, 60), st.floats(0.01, 100.0))
@settings(deadline=None, max_examples=40)
def test_it_has_twelve_corners_and_holds_every_point(seed, count, stretch):
    points = np.random.default_rng(seed).normal(size=(count, 2)) * np.array([stretch, 1.0])
    corners = dodecagon(points)
    assert corners.shape == (SIDES, 2)
    side = np.roll(corners, -1, axis=0) - corners
    left = side[:, None, 0] * (points[:, 1] - corners[:, None, 1]) - side[:, None, 1] * (
        points[:, 0] - corners[:, None, 0]
    )
    assert (left >= -1e-6 * (1 + stretch) * (1 + np.linalg.norm(side, axis=1)[:, None])).all()
    assert polygon_area(corners) >= -1e-9


@pytest.mark.parametrize("radius", [1.0, 20.0])
def test_around_a_disk_it_is_the_regular_one(radius):
    corners = dodecagon(circle(radius) + np.array([3.0, -7.0]))
    assert polygon_area(corners) == pytest.approx(12 * np.tan(np.pi / 12) * radius**2, rel=1e-5)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    np.testing.assert_allclose(sides, 2 * np.tan(np.pi / 12) * radius, rtol=1e-2)


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_no_other_turn_encloses_less(seed):
    points = np.random.default_rng(seed).uniform(size=(30, 2))
    least = polygon_area(dodecagon(points))
    turns = np.random.default_rng(seed + 1).uniform(0, np.pi / 6, 10)
    assert least <= min(polygon_area(around(points, float(t))) for t in turns) * 1.02


def test_a_square_keeps_its_own_shape():
    square = np.array([[0, 0], [5, 0], [5, 5], [0, 5]], float)
    assert polygon_area(dodecagon(square)) == pytest.approx(25.0)
    assert polygon_area(hull_points(square)) == pytest.approx(25.0)


def test_no_point_is_refused():
    with pytest.raises(ItreeError, match="at least one point"):
        dodecagon(np.zeros((0, 2)))


def test_volume_is_area_times_height():
    disk = Prism(0, dodecagon(circle(10.0)), -880.0, -900.0, "")
    assert disk.volume == pytest.approx(12 * np.tan(np.pi / 12) * 100 * 20, rel=1e-5)
    assert disk.height == 20.0


def test_a_compact_region_is_one_prism_as_high_as_its_90th_percentile():
    pixels = pixel_sheet(np.ones((20, 30), bool))
    pixels[..., 2] = np.linspace(0.0, 10.0, len(pixels))[:, None]
    (prism,) = prisms_over(pixels, 4, -5.0, "why", 60.0)
    assert (prism.region, prism.reason, prism.bottom) == (4, "why", -5.0)
    assert prism.top == pytest.approx(9.0)
    assert polygon_area(prism.outline_up) == pytest.approx(600.0)


def test_a_ring_does_not_fill_what_it_surrounds():
    """Each piece is at least half full, so that the middle stays free; and all pixels are covered."""
    mask = np.ones((120, 160), bool)
    mask[4:-4, 4:-4] = False
    found = list(prisms_over(pixel_sheet(mask), 1, 0.0, "rim", 60.0))
    assert len(found) > 1
    assert sum(polygon_area(p.outline_up) for p in found) < 2.0 * mask.sum()


def test_a_speck_makes_no_prism_and_neither_does_what_is_as_low_as_the_floor():
    assert not list(prisms_over(pixel_sheet(np.ones((3, 3), bool)), 0, 0.0, "", 60.0))
    assert not list(prisms_over(pixel_sheet(np.ones((30, 30), bool), 5.0), 0, 5.0, "", 60.0))
