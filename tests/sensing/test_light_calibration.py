"""Rendered spheres give back the lights that lit them, through a pinhole and orthographically."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.sensing.light_calibration.chrome import find_highlights, lights_from_highlights
from itree_jax.sensing.light_calibration.matte import lights_from_shading, strengths_along
from itree_jax.sensing.light_calibration.sphere import Sphere, fit_sphere, uncalibrated_camera

from .conftest import light_ring
from .rendered_spheres import (
    BY_ORTHOGRAPHIC,
    BY_PINHOLE,
    ORTHOGRAPHIC,
    PINHOLE,
    degrees_between,
    mask_of,
    matte,
    mirror,
    pixels,
)

LIGHTS = np.concatenate([light_ring(4), light_ring(2, np.radians(20.0)), [[0.0, 0.0, -1.0]]])
STRENGTHS = np.array([0.5, 0.6, 0.7, 0.8, 0.55, 0.65, 0.75])
BOTH = pytest.mark.parametrize("sphere", [BY_PINHOLE, BY_ORTHOGRAPHIC], ids=["pinhole", "orthographic"])


def fitted(sphere: Sphere) -> Sphere:
    return fit_sphere(mask_of(sphere), sphere.camera, sphere.radius)


@BOTH
def test_the_sphere_is_where_its_mask_says(sphere):
    found = fitted(sphere)
    np.testing.assert_allclose(found.centre, sphere.centre, atol=0.002 * np.linalg.norm(sphere.centre))
    assert found.radius == pytest.approx(sphere.radius, rel=1e-3)
    assert found.outline_rms < 0.4
    np.testing.assert_allclose(found.outline(), sphere.outline(), atol=0.15)


@BOTH
def test_the_outline_is_where_sight_grazes(sphere):
    uv = sphere.outline(90)
    centre = uv.mean(0)
    inside, outside = centre + 0.9999 * (uv - centre), centre + 1.0001 * (uv - centre)
    _, normal, sight = sphere.at(inside)
    assert np.abs((normal * sight).sum(-1)).max() < 0.03
    assert np.isnan(sphere.at(outside)[1]).all()


def test_a_pinholes_outline_is_no_circle():
    """A circle through it puts the centre a pixel or more away from the image of the sphere's."""
    uv = BY_PINHOLE.outline()
    middle = (uv.min(0) + uv.max(0)) / 2
    radii = np.linalg.norm(uv - middle, axis=1)
    assert np.ptp(radii) > 1.0
    assert np.linalg.norm(middle - PINHOLE.project(BY_PINHOLE.centre)) > 1.0


def test_a_stand_a_hole_and_the_images_rim_do_not_move_the_sphere():
    sphere = replace(BY_PINHOLE, centre=np.array([25.0, -30.0, 170.0]))  # its top is outside
    mask = mask_of(sphere)
    u, v = np.moveaxis(pixels(PINHOLE), -1, 0)
    centre = PINHOLE.project(sphere.centre)
    damaged = mask | ((abs(u - centre[0]) < 12) & (v > centre[1]) & (v < centre[1] + 115))
    damaged &= (u - centre[0]) ** 2 + (v - centre[1]) ** 2 > 20**2
    found = fit_sphere(damaged, PINHOLE, sphere.radius)
    np.testing.assert_allclose(found.centre, sphere.centre, atol=0.004 * np.linalg.norm(sphere.centre))


@BOTH
def test_a_mirror_gives_the_direction_to_a_tenth_of_a_degree(sphere):
    found = find_highlights(mirror(sphere, LIGHTS), fitted(sphere))
    directions, _ = lights_from_highlights(found.uv, fitted(sphere))
    assert degrees_between(directions, LIGHTS).max() < 0.1
    # and it is not the normal there, which turns by half as much
    _, normal, _ = sphere.at(found.uv)
    assert degrees_between(normal, LIGHTS)[:4].min() > 10.0


@given(st.floats(0.0, 50.0), st.floats(0.0, 360.0))
@settings(max_examples=30, deadline=None)
def test_the_ray_to_the_camera_is_mirrored_into_the_light(off_axis, azimuth):
    a, b = np.radians([off_axis, azimuth])
    light = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), -np.cos(a)])
    for sphere in (BY_PINHOLE, BY_ORTHOGRAPHIC):
        at = pixels(sphere.camera)
        toward, X = lights_from_highlights(at, sphere)
        best = np.nanargmax(toward @ light)
        assert degrees_between(toward.reshape(-1, 3)[best], light) < 2.5  # the nearest pixel
        on = X.reshape(-1, 3)[best] - sphere.centre
        assert np.linalg.norm(on) == pytest.approx(sphere.radius, rel=1e-9)


@BOTH
def test_stray_reflections_are_no_highlights(sphere):
    """A window in all images, brighter in some, and a streak in one that is as bright as the lamp."""
    images = mirror(sphere, LIGHTS)
    u, v = np.moveaxis(pixels(sphere.camera), -1, 0)
    centre = sphere.camera.project(sphere.centre)
    window = (abs(u - centre[0] + 65) < 8) & (abs(v - centre[1]) < 20)
    streak = (abs(u - centre[0] - 65) < 1) & (abs(v - centre[1]) < 30)
    for k, image in enumerate(images):
        image[window] = np.maximum(image[window], 0.7 + 0.3 * (k % 2))
    images[2][streak] = 1.0
    directions, _ = lights_from_highlights(find_highlights(images, sphere).uv, sphere)
    assert degrees_between(directions, LIGHTS).max() < 0.1


@BOTH
def test_a_matte_sphere_gives_direction_and_intensity(sphere):
    found = lights_from_shading(matte(sphere, LIGHTS, STRENGTHS), fitted(sphere))
    assert degrees_between(found.directions, LIGHTS).max() < 0.1
    np.testing.assert_allclose(found.strengths, STRENGTHS, rtol=2e-3)
    np.testing.assert_allclose(found.intensities, STRENGTHS / STRENGTHS.mean(), rtol=2e-3)
    assert found.residuals.max() < 2e-3


@BOTH
def test_stains_gloss_and_cast_shadow_count_little(sphere):
    images = matte(sphere, LIGHTS, STRENGTHS)
    u, v = np.moveaxis(pixels(sphere.camera), -1, 0)
    centre = sphere.camera.project(sphere.centre)
    images[:, (abs(u - centre[0] + 15) < 9) & (abs(v - centre[1] - 20) < 9)] *= 0.7
    images[:, (abs(u - centre[0] - 15) < 3) & (abs(v - centre[1] + 10) < 3)] = 1.0
    images[0, abs(u + v - centre.sum()) < 8] = 0.0
    images += np.random.default_rng(0).normal(0.0, 0.003, images.shape).astype(np.float32)
    found = lights_from_shading(images, sphere)
    assert degrees_between(found.directions, LIGHTS).max() < 0.3
    np.testing.assert_allclose(found.strengths, STRENGTHS, rtol=0.01)


def test_strengths_of_known_directions():
    images = matte(BY_PINHOLE, LIGHTS, STRENGTHS)
    found = strengths_along(images, BY_PINHOLE, LIGHTS)
    np.testing.assert_allclose(found.strengths, STRENGTHS, rtol=1e-6)
    assert found.residuals.max() < 1e-6
    turned = strengths_along(images, BY_PINHOLE, np.roll(LIGHTS, 1, axis=0))
    assert turned.residuals.min() > 0.02  # wrong directions leave a residual


def test_half_of_the_pixels_tell_the_same():
    images = matte(BY_ORTHOGRAPHIC, LIGHTS, STRENGTHS)
    u, _ = np.moveaxis(pixels(ORTHOGRAPHIC), -1, 0)
    halves = [lights_from_shading(images, BY_ORTHOGRAPHIC, (u // 16) % 2 == k).directions for k in (0, 1)]
    assert degrees_between(*halves).max() < 1e-3


def test_an_uncalibrated_camera_gives_the_same_directions():
    camera = uncalibrated_camera(ORTHOGRAPHIC.width, ORTHOGRAPHIC.height)
    sphere = fit_sphere(mask_of(BY_ORTHOGRAPHIC), camera)
    assert sphere.radius == pytest.approx(2.0 * BY_ORTHOGRAPHIC.radius, rel=1e-3)
    images = mirror(BY_ORTHOGRAPHIC, LIGHTS)
    directions, _ = lights_from_highlights(find_highlights(images, sphere).uv, sphere)
    assert degrees_between(directions, LIGHTS).max() < 0.1


def test_wrong_images_are_told():
    mask = mask_of(BY_PINHOLE)
    with pytest.raises(ItreeError, match=r"m\.png: the mask is 320 x 240 px, images are 100 x 100"):
        fit_sphere(mask, Camera("pinhole", 400.0, 400.0, 49.5, 49.5, 100, 100), where="m.png")
    with pytest.raises(ItreeError, match="no sphere"):
        fit_sphere(np.zeros_like(mask), PINHOLE)
    square = np.zeros_like(mask)
    square[50:200, 20:300] = True
    with pytest.raises(ItreeError, match="no sphere's outline"):
        fit_sphere(square, PINHOLE)
    images = mirror(BY_PINHOLE, LIGHTS)
    images[3] = 0.01
    with pytest.raises(ItreeError, match="d: no highlight"):
        find_highlights(images, BY_PINHOLE, list("abcdefg"))
    images[3] = matte(BY_PINHOLE, LIGHTS, STRENGTHS)[3]
    with pytest.raises(ItreeError, match="image 3: no highlight on the sphere: the brightest patch covers"):
        find_highlights(images, BY_PINHOLE)
    with pytest.raises(ItreeError, match="image 0: 0 pixels"):
        lights_from_shading(np.zeros_like(images), BY_PINHOLE)
    with pytest.raises(ItreeError, match="0 lit"):
        strengths_along(np.ones_like(images), BY_PINHOLE, LIGHTS)
