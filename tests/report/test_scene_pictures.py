"""Colours and places of the scene's pictures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.report.palette import AGREE, CONTRADICT, CYCLE, GREY, HIDDEN, cycle, ink_on
from itree_jax.report.pose_pictures import magnification, residual_picture
from itree_jax.report.scene_pictures import (
    NOTHING,
    badge,
    colour_bar,
    depth_colours,
    depth_range,
    displayed,
    innermost,
    needle_lines,
    normal_colours,
    normal_legend,
    region_picture,
    scaled,
    scaled_uv,
)
from itree_jax.sensing.needle import NeedleMap


def lightness(rgb: np.ndarray) -> np.ndarray:
    """CIE L* of sRGB colours 0..255."""
    c = np.asarray(rgb, float) / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    Y = linear @ [0.2126, 0.7152, 0.0722]
    return 116.0 * np.cbrt(np.maximum(Y, 0.008856)) - 16.0


@pytest.mark.parametrize(
    ("normal", "rgb"),
    [
        ((0, 0, -1), (128, 128, 255)),
        ((1, 0, 0), (255, 128, 128)),
        ((-1, 0, 0), (0, 128, 128)),
        ((0, -1, 0), (128, 255, 128)),
        ((0, 1, 0), (128, 0, 128)),
        ((0, 0, 0), (128, 128, 128)),
    ],
)
def test_normals_have_the_usual_colours(normal, rgb):
    """Camera frame: x right, y down, z away. Colours: red right, green up, blue toward the viewer."""
    assert normal_colours(np.array([[normal]], float)).tolist() == [[list(rgb)]]


def test_the_legend_is_a_ball_in_these_colours():
    ball = normal_legend(101)
    assert ball[50, 50].tolist() == [128, 128, 255, 255]
    assert ball[50, 98, 0] > 240  # right
    assert ball[2, 50, 1] > 240  # up
    assert ball[0, 0, 3] == 0


def test_nearer_is_lighter_and_the_bar_has_the_same_colours():
    depth = np.linspace(400.0, 500.0, 64)[None]
    L = lightness(depth_colours(depth, 400.0, 500.0)[0])
    assert (np.diff(L) < 0).all()
    bar = colour_bar(9)
    ends = depth_colours(np.array([[400.0, 450.0, 500.0]]), 400.0, 500.0)[0]
    assert [bar[0], bar[4], bar[8]] == [tuple(c) for c in ends.tolist()]
    assert depth_colours(np.zeros((1, 1)), 400.0, 500.0).tolist() == [[[NOTHING] * 3]]


def test_the_depth_range_forgets_outliers_and_never_collapses():
    depth = np.full((10, 1000), 500.0)
    depth[0, :20] = 100.0
    depth[1, :500] = 0.0
    near, far = depth_range(depth)
    assert near == 500.0
    assert far > near
    assert depth_range(np.zeros((2, 2))) == (0.0, 1.0)


def test_display_is_a_gamma_with_white_at_the_level():
    image = np.array([[0.0, 0.25, 0.5, 2.0]])
    expected = np.round(255 * np.array([0.0, 0.5 ** (1 / 2.2), 1.0, 1.0]))
    np.testing.assert_array_equal(displayed(image, 0.5)[0, :, 0], expected)


@pytest.mark.parametrize("scale", [2.0, 3.0, 5.0, 0.5])
def test_a_point_moves_with_its_pixel(scale):
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[12:16, 30:34] = 200
    enlarged = scaled(picture, scale)[..., 0].astype(float)
    v, u = np.indices(enlarged.shape)
    found = np.array([(enlarged * u).sum(), (enlarged * v).sum()]) / enlarged.sum()
    np.testing.assert_allclose(found, scaled_uv(np.array([31.5, 13.5]), scale), atol=0.05)


@given(st.integers(1, 5000), st.sampled_from([640, 1280]))
def test_magnification_comes_near_its_target(width, target):
    scale = magnification(width, target)
    assert scale == int(scale) or scale <= 1.0
    assert 0.6 * target < width * scale < 1.5 * target


@pytest.mark.parametrize("seed", range(5))
def test_a_number_is_placed_inside_of_its_mask(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((20, 30)) < 0.3
    u, v = innermost(mask).astype(int)
    assert mask[v, u]


def test_a_badge_stays_inside_of_the_picture():
    for uv in ((0, 0), (99, 0), (0, 59), (99, 59)):
        picture = np.zeros((60, 100, 3), np.uint8)
        badge(picture, np.array(uv, float), "12", (230, 159, 0), 0.5)
        filled = (picture == np.array([230, 159, 0])).all(axis=2)
        assert filled.any()
        assert not filled[[0, -1]].any()
        assert not filled[:, [0, -1]].any()


def test_needles_point_where_the_surface_faces():
    """A surface that leans right: all of each line lies right of its dot."""
    n = np.array([np.sin(0.9), 0.0, -np.cos(0.9)])
    normals, zero = np.broadcast_to(n, (64, 64, 3)), np.zeros((64, 64))
    known = np.zeros((64, 64), bool)
    known[:, 20:24] = True
    needle = NeedleMap(normals, zero, known, known[None], known[None], zero, zero, zero, zero[None], known[None])
    picture = needle_lines(np.zeros((64, 64, 3), np.uint8), needle, 4.0)
    columns = np.flatnonzero(picture.any(axis=(0, 2)))
    assert columns.min() >= 4 * 20 - 4
    assert columns.max() > 4 * 24


def test_regions_have_the_colour_of_their_pose():
    labels = np.full((40, 60), -1)
    labels[5:35, 5:25], labels[5:35, 35:55] = 0, 1
    picture = region_picture(np.full((40, 60, 3), 128, np.uint8), labels, np.array([3, -1]), 1.0)
    tint = [tuple(np.round(0.5 * 128 + 0.5 * np.array(c)).astype(int)) for c in (cycle(3), GREY)]
    for at, expected in zip((8, 38), tint, strict=True):
        np.testing.assert_allclose(picture[32, at], expected, atol=1)
    assert (picture[5, 6:24] == 255).all()  # a white border


def test_residual_colours_differ_in_lightness():
    L = np.sort(lightness(np.array([AGREE, CONTRADICT, HIDDEN])))
    assert np.diff(L).min() > 12.0
    codes = np.array([[0, 1, 2, 3]], np.uint8)
    picture = residual_picture(np.zeros((1, 4, 3), np.uint8), codes)
    assert picture[0, 0].tolist() == [0, 0, 0]
    np.testing.assert_allclose(picture[0, 1:], 0.72 * np.array([AGREE, CONTRADICT, HIDDEN]), atol=1)


def test_what_is_written_on_a_colour_can_be_read():
    for colour in CYCLE:
        assert abs(lightness(np.array(colour)) - lightness(np.array(ink_on(colour)))) > 40.0
