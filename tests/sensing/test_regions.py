"""Regions are the 8-connected sets of detectable pixels, cut at depth steps, the highest first."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.ndimage
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.depth_steps import depth_noise, depth_step_limit
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.regions import NO_REGION, regions
from itree_jax.sensing.slant_limit import detectable, slants

SIZE = 60
UPWARD = np.array([0.0, 0.0, -1.0])


def needles(interpretable, normals=UPWARD):
    shape = interpretable.shape
    normals = np.where(interpretable[..., None], np.broadcast_to(normals, (*shape, 3)), 0.0).astype(np.float32)
    none, one = np.zeros((3, *shape), bool), interpretable.astype(np.float32)
    return NeedleMap(normals, 0.5 * one, interpretable, none, none, one, 0.0 * one, 0.0 * one, 0.0 * none, none)


def orthographic(smallest_region=0.0, px_per_mm=2.0, **changes):
    camera = Camera("orthographic", px_per_mm, px_per_mm, (SIZE - 1) / 2, (SIZE - 1) / 2, SIZE, SIZE)
    return replace(bundled_sensor("ikeuchi-1987"), camera=camera, smallest_region=smallest_region, **changes)


def test_components_are_the_eight_connected_ones():
    mask = np.random.default_rng(0).uniform(size=(SIZE, SIZE)) < 0.35
    found = regions(needles(mask), None, orthographic())
    twin, count = scipy.ndimage.label(mask, structure=np.ones((3, 3)))
    assert found.count == count > 10
    np.testing.assert_array_equal(found.labels != NO_REGION, mask)
    pairs = {(a, b) for a, b in zip(found.labels[mask], twin[mask], strict=True)}
    assert len(pairs) == count  # the same partition under other names
    np.testing.assert_array_equal(found.area_px, np.bincount(found.labels[mask]))
    assert (np.diff(found.area_px) <= 0).all()  # without depth the largest comes first
    assert np.isnan(found.height).all()
    assert found.labels.dtype == np.int32


def test_a_region_is_described_in_pixels_and_millimetres():
    mask = np.zeros((SIZE, SIZE), bool)
    mask[10:20, 30:50] = True
    tilt = np.radians(20.0)
    normal = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    found = regions(needles(mask, normal), np.full((SIZE, SIZE), 480.0, np.float32), orthographic())
    assert found.count == 1
    assert found.area_px.tolist() == [200]
    assert found.area_mm2.tolist() == [50.0]
    assert found.centroid_uv.tolist() == [[39.5, 14.5]]
    assert found.bbox.tolist() == [[30, 10, 20, 10]]
    assert found.mean_depth.tolist() == [480.0]
    assert found.height.tolist() == [20.0]  # above the working distance of 500 mm
    np.testing.assert_allclose(found.mean_normal, [normal], atol=1e-7)
    np.testing.assert_array_equal(found.mask(0), mask)


def test_area_of_a_pinhole_camera_grows_with_the_square_of_depth():
    mask = np.zeros((SIZE, SIZE), bool)
    mask[5:15, 5:15] = mask[5:15, 30:40] = True
    depth = np.where(np.arange(SIZE) < 20, 300.0, 600.0) * np.ones((SIZE, 1))
    camera = Camera("pinhole", 600.0, 600.0, 29.5, 29.5, SIZE, SIZE)
    sensor = replace(orthographic(), camera=camera)
    np.testing.assert_allclose(regions(needles(mask), depth, sensor).area_mm2, [25.0, 100.0])
    only = regions(needles(mask), depth, replace(sensor, smallest_region=25.1))
    assert only.area_mm2.tolist() == pytest.approx([100.0])


def test_smaller_regions_are_dropped_and_labels_stay_dense():
    mask = np.zeros((SIZE, SIZE), bool)
    for k, side in enumerate((10, 3, 8)):
        mask[5 : 5 + side, 5 + 15 * k : 5 + 15 * k + side] = True
    found = regions(needles(mask), None, orthographic(smallest_region=16.0))  # 64 px
    assert found.area_px.tolist() == [100, 64]
    assert np.unique(found.labels).tolist() == [NO_REGION, 0, 1]


def test_the_slant_is_measured_against_the_viewing_ray():
    camera = Camera("pinhole", 40.0, 40.0, 29.5, 29.5, SIZE, SIZE)
    sensor = replace(orthographic(), camera=camera, slant_limit=np.radians(25.0))
    v, u = np.mgrid[:SIZE, :SIZE]
    inside = np.hypot(u - 29.5, v - 29.5) < 40.0 * np.tan(np.radians(25.0))
    np.testing.assert_array_equal(regions(needles(np.ones_like(inside)), None, sensor).labels == 0, inside)


def test_the_region_of_interest_is_applied():
    interest = np.zeros((SIZE, SIZE), bool)
    interest[:, :25] = True
    found = regions(needles(np.ones((SIZE, SIZE), bool)), None, orthographic(region_of_interest=interest))
    np.testing.assert_array_equal(found.labels == 0, interest)


def plane(slant, rng, noise, azimuth=0.0):
    """Depth of a plane through the optical axis at 500 mm, slanted in direction `azimuth`, at 2 px/mm."""
    v, u = np.mgrid[:SIZE, :SIZE] / 2.0
    rise = np.tan(slant) * (np.cos(azimuth) * u + np.sin(azimuth) * v)
    return 500.0 + rise + rng.normal(0.0, noise, (SIZE, SIZE))


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("azimuth", [0.0, 0.8])
def test_a_surface_within_the_slant_limit_stays_whole_and_a_step_cuts_it(noise, azimuth):
    rng = np.random.default_rng(1)
    sensor = orthographic()
    depth = plane(sensor.slant_limit - 0.02, rng, noise, azimuth)
    everywhere = np.ones((SIZE, SIZE), bool)
    whole = regions(needles(everywhere), depth, sensor)
    assert whole.area_px.max() > 0.99 * SIZE**2
    limit = depth_step_limit(depth, everywhere, sensor)
    np.testing.assert_allclose(limit, 0.5 * np.tan(sensor.slant_limit) + 2 * np.sqrt(2) * noise, atol=0.06)
    flat = plane(0.0, rng, noise) + np.where(np.arange(SIZE) < 33, 0.0, limit + 8 * noise + 0.2)
    cut = regions(needles(everywhere), flat, sensor)
    large = cut.area_px > 100
    assert large.sum() == 2
    assert (cut.labels[:, :33] == 0).mean() > 0.99  # the nearer one is the first
    assert not (cut.labels[:, 33:] == 0).any()


@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
def test_depth_noise_is_measured_on_a_slanted_plane(noise):
    depth = plane(0.6, np.random.default_rng(2), noise)
    depth[:, 30:] += 40.0  # a step does not matter
    depth[10:12] = 0.0  # nor do holes
    assert depth_noise(depth, np.ones((SIZE, SIZE), bool)) == pytest.approx(noise, rel=0.08)


def test_pixels_without_depth_cut_nothing():
    depth = np.full((SIZE, SIZE), 500.0)
    depth[:, 30] = 0.0
    found = regions(needles(np.ones((SIZE, SIZE), bool)), depth, orthographic())
    assert found.area_px.tolist() == [SIZE**2]
    assert found.mean_depth.tolist() == [500.0]


def two_squares():
    mask = np.zeros((SIZE, SIZE), bool)
    mask[20:40, 5:25] = mask[20:40, 35:55] = True
    return mask


def test_without_a_world_the_nearer_region_is_first():
    depth = np.where(np.arange(SIZE) < 30, 480.0, 470.0) * np.ones((SIZE, 1))
    found = regions(needles(two_squares()), depth, orthographic())
    np.testing.assert_allclose(found.height, [30.0, 20.0])
    assert found.centroid_uv[0, 0] > 30


def test_height_is_along_the_worlds_z_axis():
    tilt = np.radians(40.0)
    R_w2c = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [0, -1, 0], [-np.sin(tilt), 0, -np.cos(tilt)]])
    depth = np.where(np.arange(SIZE) < 30, 480.0, 476.0) * np.ones((SIZE, 1))  # the right one is nearer
    found = regions(needles(two_squares()), depth, orthographic(), R_w2c)
    assert found.centroid_uv[0, 0] < 30  # but the left one is higher, up being (-sin, 0, -cos)
    x = (np.array([np.arange(5, 25), np.arange(35, 55)]) - 29.5) / 2.0
    height = np.sin(tilt) * -x + np.cos(tilt) * np.array([[20.0], [24.0]])
    np.testing.assert_allclose(found.height, np.percentile(np.repeat(height, 20, axis=1), 90, axis=1))


def test_the_height_of_a_region_is_its_90th_percentile():
    mask = np.zeros((SIZE, SIZE), bool)
    mask[10:20, 10:20] = True
    depth = np.full((SIZE, SIZE), 490.0)
    depth[10:20, 10:20] -= np.linspace(0.0, 3.0, 100).reshape(10, 10)
    found = regions(needles(mask), depth, orthographic())
    np.testing.assert_allclose(found.height, [10.0 + 0.9 * 3.0])


def test_no_region_at_all():
    found = regions(needles(np.zeros((SIZE, SIZE), bool)), np.zeros((SIZE, SIZE)), orthographic())
    assert found.count == 0
    assert (found.labels == NO_REGION).all()
    assert found.mean_normal.shape == (0, 3)
    assert found.bbox.shape == (0, 4)


@pytest.mark.parametrize(("shape", "depth_shape", "message"), [
    ((SIZE, SIZE - 1), (SIZE, SIZE), "needle map has shape"), ((SIZE, SIZE), (SIZE, 3), "depth map has shape"),
])  # fmt: skip
def test_sizes_that_differ_are_refused(shape, depth_shape, message):
    with pytest.raises(ItreeError, match=message):
        regions(needles(np.ones(shape, bool)), np.ones(depth_shape), orthographic())


def test_no_region_is_lit_in_part():
    """Nor where a face lies level with a dark wall and faces as it does, nor across a corner."""
    lit = np.zeros((SIZE, SIZE), bool)
    lit[10:40, 20:30], lit[40:50, 30:40] = True, True
    everywhere, depth = needles(np.ones((SIZE, SIZE), bool)), np.full((SIZE, SIZE), 490.0, np.float32)
    for z in (depth, None):
        assert regions(everywhere, z, orthographic()).count == 1
        found = regions(everywhere, z, orthographic(), lit=lit)
        assert found.count == 2
        for k in range(found.count):
            assert len(np.unique(lit[found.mask(k)])) == 1
        assert sorted(found.area_px) == [400, SIZE**2 - 400]


def noisy_plane(slant, noise, rng):
    """Needles of a plane tilted about the image's rows [rad], with noise [rad] of each of its angles."""
    tilt, turn = slant + rng.normal(0.0, noise, (SIZE, SIZE)), rng.normal(0.0, noise, (SIZE, SIZE))
    normals = np.stack([np.sin(turn), np.sin(tilt) * np.cos(turn), -np.cos(tilt) * np.cos(turn)], axis=-1)
    everywhere = np.ones((SIZE, SIZE), bool)
    return needles(everywhere, normals)._replace(normal_std=np.full((SIZE, SIZE), noise * np.sqrt(2.0), np.float32))


@pytest.mark.parametrize(("beside_deg", "seen"), [(-1.5, True), (1.5, False)])
def test_noise_does_not_decide_about_the_pixels_of_a_face_near_the_slant_limit(beside_deg, seen):
    sensor, noise = orthographic(), np.radians(3.0)
    slant = sensor.slant_limit + np.radians(beside_deg)
    needle = noisy_plane(slant, noise, np.random.default_rng(4))
    alone = np.degrees(slants(needle.normals, sensor) - sensor.slant_limit) < 0.0
    assert 0.2 < alone.mean() < 0.8  # each for itself: a sieve
    assert (detectable(needle, sensor) == seen).mean() > 0.97
    exact = noisy_plane(slant, 0.0, np.random.default_rng(4))
    assert (detectable(exact, sensor) == seen).all()


def test_a_needle_that_is_sure_of_its_slant_is_not_asked_about_its_neighbours():
    sensor = orthographic()
    normals = np.tile(UPWARD, (SIZE, SIZE, 1))
    steep = sensor.slant_limit + np.radians(10.0)
    normals[:, 30:] = 0.0, np.sin(steep), -np.cos(steep)
    crease = needles(np.ones((SIZE, SIZE), bool), normals)._replace(
        normal_std=np.full((SIZE, SIZE), np.radians(1.0), np.float32)
    )
    np.testing.assert_array_equal(detectable(crease, sensor), np.arange(SIZE) < np.full((SIZE, 1), 30))


def test_slants_are_angles_to_each_pixel_s_own_line_of_sight():
    """Of a sphere's needles as of a plane's; half needles are slanted as whole ones, none is at a right angle."""
    camera = Camera("pinhole", 100.0, 100.0, (SIZE - 1) / 2, (SIZE - 1) / 2, SIZE, SIZE)
    sensor = replace(bundled_sensor("ikeuchi-1987"), camera=camera)
    v, u = np.indices((SIZE, SIZE))
    rays = camera.viewing_ray(np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)).reshape(SIZE, SIZE, 3)
    np.testing.assert_allclose(slants(-0.5 * rays.astype(np.float32), sensor), 0.0, atol=1e-3)
    flat = np.tile(UPWARD, (SIZE, SIZE, 1)).astype(np.float32)
    np.testing.assert_allclose(slants(flat, sensor), np.arccos(rays[..., 2]), atol=1e-3)
    np.testing.assert_allclose(slants(0.0 * flat, sensor), np.pi / 2)
