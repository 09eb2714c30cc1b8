"""Dual photometric stereo of a small bin: depth of what needles cover to a third of a millimetre.

The geometry: f = 1815 px, 900 mm away, cameras 120 mm apart, so that a pixel is half a millimetre across and a pixel of
disparity 3.7 mm deep; 0.3 mm are a twelfth of a pixel of disparity.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from itree_cad.bundled import bundled_part
from itree_kernels.instances import Material
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.backtracking import MOST_TOLD, soft_steps, unread
from itree_jax.sensing.box import Box
from itree_jax.sensing.reading import read_needles
from itree_jax.sight import look
from itree_jax.stereo import dual_stereo
from itree_jax.stereo.dual_stereo import (
    AGREES,
    DULLEST_STD,
    SHARPEST_STD,
    WINDOW,
    block_matching,
    dual_photometric_stereo,
    match_windows,
    searched,
)
from itree_jax.stereo.second_camera import epipolar_pair, to_first_camera

from .two_views import (
    ASIDE,
    CAMERA,
    PARALLEL,
    SHIFTED,
    TwoViews,
    as_mesh,
    converging,
    second_of,
    sensor_with,
    two_views,
)

CAMERAS = {"parallel": (SHIFTED, PARALLEL, ASIDE), "turned": (CAMERA, *converging())}


@pytest.fixture(scope="module", params=CAMERAS)
def small_bin(request) -> TwoViews:
    """Two bundled parts, one leaning, on a dark floor; with noise."""
    parts = [bundled_part("ikeuchi-1987"), bundled_part("ikeuchi-1987")]
    meshes = [ray_mesh(p.vertices, p.triangles, p.face_of_triangle) for p in parts]
    floor = as_mesh(trimesh.creation.box((900, 900, 10)))
    R = Rotation.from_euler("xyz", [[8, 0, 20], [90, 25, -50], [0, 0, 0]], degrees=True).as_matrix()
    t = np.array([[-18.0, -10.0, 875.0], [22.0, 14.0, 868.0], [0.0, 0.0, 905.0]])
    return two_views([*meshes, floor], R, t, Material(np.array([0.7, 0.7, 0.06])), *CAMERAS[request.param], seed=5)


@pytest.fixture(scope="module")
def depths(small_bin):
    pair = epipolar_pair(small_bin.images, small_bin.sensor, small_bin.second)
    alone = to_first_camera(block_matching(pair, *searched(pair)), pair, CAMERA)
    return dual_photometric_stereo(small_bin.images, small_bin.sensor, small_bin.second), alone


def test_matched_pieces_are_where_they_are(small_bin, depths):
    stereo, alone = depths
    needle = read_needles(small_bin.images, small_bin.sensor, None)
    part = (small_bin.lit.instance < 2) & (small_bin.lit.instance >= 0)
    matched = part & stereo.by_needles
    off = np.abs(stereo.depth - small_bin.lit.depth)
    assert matched.sum() > 0.8 * (part & needle.interpretable).sum() > 4000
    assert np.median(off[matched]) < 0.3
    assert np.percentile(off[matched], 90) < 2.0
    coarse = part & (alone > 0)
    assert np.median(off[matched]) < 0.2 * np.median(np.abs(alone - small_bin.lit.depth)[coarse])


def test_what_is_not_known_is_zero(small_bin, depths):
    stereo, _ = depths
    assert (stereo.depth[stereo.by_needles] > 0).all()
    known = stereo.depth > 0
    assert 0.4 < known.mean() < 1.0
    assert np.median(np.abs(stereo.depth - small_bin.lit.depth)[known]) < 1.5
    assert 0.3 < stereo.std < 1.0  # 0.15 px of 3.7 mm


def test_block_matching_reaches_the_sides_that_both_cameras_see(small_bin):
    """Not only the columns that every disparity leaves inside of the second image."""
    pair = epipolar_pair(small_bin.images, small_bin.sensor, small_bin.second)
    first, last = searched(pair)
    depth = block_matching(pair, first, last)
    assert (depth[:, 10:last] > 0).mean() > 0.4
    seen = depth > 0
    there = (np.indices(depth.shape)[1] - pair.disparity(depth))[seen]
    assert there.min() >= -0.01
    assert there.max() <= CAMERA.width - 0.99


def test_windows_without_texture_stay_where_needles_put_them():
    """All places of a uniform surface look alike, so that none is better than the one it has."""
    images = np.full((3, CAMERA.height, CAMERA.width), 0.4, np.float32)
    pair = epipolar_pair(images, sensor_with(CAMERA), second_of(images, SHIFTED, PARALLEL, ASIDE))
    z = np.full(images.shape[1:], 880.0)
    lit = np.ones(z.shape, bool)
    uniform = replace(pair, left=np.full_like(images, 0.4), right=np.full_like(images, 0.4))
    for reach in (2.0, 1.0):
        matched, deviation = match_windows(uniform, z, reach, lit)
        seen_by_both = np.s_[:, 60:]
        np.testing.assert_allclose(matched[seen_by_both], 880.0, atol=0.01)
        np.testing.assert_allclose(deviation[seen_by_both], DULLEST_STD, rtol=1e-3)


PART_OF_IT = Box(24, 120, 40, 168)


def test_what_a_window_tells_does_not_depend_on_what_lies_around(small_bin):
    """Neither where it lies nor how sure that is, as if a floor without texture were no wider."""
    pair = epipolar_pair(small_bin.images, small_bin.sensor, small_bin.second)
    some, rows, columns = pair.within(PART_OF_IT), slice(24, 120), slice(40, 168)
    z = np.where(small_bin.lit.depth > 0, small_bin.lit.depth, 900.0).astype(float)
    told = np.zeros(z.shape, bool)
    told[60:100, 80:140] = True  # the same noise
    whole = match_windows(pair, z, 1.0, told)
    cut = match_windows(some, z[rows, columns], 1.0, told[rows, columns])
    inside = np.s_[WINDOW:-WINDOW, WINDOW:-WINDOW]
    for a, b, close in zip(whole, cut, (0.02, 0.02), strict=True):
        off = np.abs(a[rows, columns] - b)[inside]
        assert np.quantile(off, 0.99) < close
    assert (cut[1] < 0.5 * (SHARPEST_STD + DULLEST_STD)).mean() > 0.2


def test_a_part_of_the_images_is_the_same_geometry(small_bin):
    pair = epipolar_pair(small_bin.images, small_bin.sensor, small_bin.second)
    some = pair.within(PART_OF_IT)
    z = np.array([700.0, 900.0])
    np.testing.assert_allclose(some.depth(some.disparity(z)), z)
    np.testing.assert_allclose(some.disparity(z) + PART_OF_IT.left, pair.disparity(z))
    np.testing.assert_array_equal(some.left, pair.left[:, 24:120, 40:168])
    ray, at = some.sensor.camera.viewing_ray(np.array([3.0, 5.0])), np.array([43.0, 29.0])
    np.testing.assert_allclose(ray, pair.sensor.camera.viewing_ray(at))
    assert (some.sensor.camera.width, some.sensor.camera.height) == (128, 96)


def test_nothing_is_known_far_from_what_a_light_shows(small_bin):
    images, other = small_bin.images.copy(), small_bin.second.images.copy()
    images[..., :100], other[..., :80] = 0.0, 0.0
    stereo = dual_photometric_stereo(images, small_bin.sensor, replace(small_bin.second, images=other))
    box = stereo.found.box
    assert box.left > 40
    assert stereo.found.surface.shape == (box.bottom - box.top, box.right - box.left)
    assert not stereo.depth[:, :40].any()
    part = (small_bin.lit.instance < 2) & (small_bin.lit.instance >= 0)
    off = np.abs(stereo.depth - small_bin.lit.depth)[part & stereo.by_needles]
    assert len(off) > 1000
    assert np.median(off) < 0.6


def test_a_later_look_goes_on_from_the_first(small_bin, depths, monkeypatch):
    """On the same images it finds about the same, and matches neither blocks nor pieces again."""
    first, _ = depths
    for name in ("block_matching", "match_pieces"):
        monkeypatch.setattr(dual_stereo, name, None)
    again = dual_photometric_stereo(small_bin.images, small_bin.sensor, small_bin.second, before=first.found)
    np.testing.assert_array_equal(again.by_needles, first.by_needles)
    part = (small_bin.lit.instance < 2) & (small_bin.lit.instance >= 0) & first.by_needles
    assert np.median(np.abs(again.depth - first.depth)[part]) < 0.1
    off = [np.median(np.abs(one.depth - small_bin.lit.depth)[part]) for one in (first, again)]
    assert off[1] < 1.1 * off[0]


def test_surface_without_needles_makes_regions_of_its_own(small_bin):
    """Blind needles on one of two parts: windows and edges still tell that something lies there, and how far."""
    sight = look(small_bin.images, small_bin.sensor, None, None, small_bin.second)
    blind = small_bin.lit.instance == 0
    needle = sight.needle._replace(interpretable=np.asarray(sight.needle.interpretable) & ~blind)
    rest = unread(replace(sight, needle=needle), [])
    assert rest is not None
    for region in range(rest.found.count):
        told = np.asarray(needle.interpretable)[rest.found.mask(region)]
        assert told.mean() < MOST_TOLD
    on_it = [r for r in range(rest.found.count) if blind[rest.found.mask(r)].mean() > 0.9]
    covered = np.isin(rest.found.labels, on_it) & blind
    assert covered.sum() > 0.5 * blind.sum()
    largest = max(on_it, key=lambda r: rest.found.area_px[r])
    true = np.median(small_bin.lit.depth[rest.found.mask(largest)])
    assert abs(rest.found.mean_depth[largest] - true) < AGREES
    assert unread(replace(sight, soft_depth=None), []) is None


def test_a_soft_step_is_no_slope():
    u = np.arange(60.0)
    slope = np.tile(900.0 + 0.5 * np.tan(np.radians(60.0)) * u, (40, 1)).astype(np.float32)
    assert not soft_steps(slope).any()
    slope[:, 30:] += 10.0
    assert soft_steps(slope)[:, 29:31].any(axis=1).all()
    assert not soft_steps(slope)[:, :27].any()
