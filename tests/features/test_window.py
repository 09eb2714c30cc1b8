"""A window is the region seen along its viewing ray at a fixed metric pitch."""

import numpy as np
import pytest
from itree_kernels.camera import Camera

from itree_jax.features.inertia import face_inertia
from itree_jax.features.window import Window, extract_windows, smallest_rotation_to_z

ORTHOGRAPHIC = Camera("orthographic", 2.0, 2.0, 49.5, 39.5, 100, 80)
PINHOLE = Camera("pinhole", 600.0, 600.0, 319.5, 239.5, 640, 480)


def test_an_orthographic_window_at_the_image_pitch_is_the_image() -> None:
    labels = np.full((80, 100), -1, dtype=np.int32)
    labels[20:40, 30:60], labels[50:60, 10:20] = 0, 5
    normals = np.zeros((80, 100, 3), dtype=np.float32)
    normals[..., 2] = -1
    normals[25, 35] = [0.6, 0, -0.8]
    centre = np.array([[44.5, 29.5], [14.5, 54.5]])
    windows, R = extract_windows(labels, normals, np.array([0, 5]), centre, np.zeros(2), ORTHOGRAPHIC, 0.5, 32)
    np.testing.assert_array_equal(R, np.broadcast_to(np.eye(3), (2, 3, 3)))
    np.testing.assert_array_equal(windows.mask[0], labels[14:46, 29:61] == 0)
    np.testing.assert_array_equal(windows.normals[0, 25 - 14, 35 - 29], normals[25, 35])
    assert windows.mask[1].sum() == 100
    assert (windows.normals[~windows.mask] == 0).all()
    assert windows.normals.dtype == np.float32
    np.testing.assert_array_equal(windows.pitch, np.float32([0.5, 0.5]))


def test_what_lies_outside_the_image_is_outside_the_region() -> None:
    labels = np.zeros((80, 100), dtype=np.int32)
    windows, _ = extract_windows(
        labels, np.zeros((80, 100, 3)), np.array([0]), np.array([[-0.5, -0.5]]), np.zeros(1), ORTHOGRAPHIC, 0.5, 20
    )
    assert windows.mask[0].sum() == 100  # one quadrant of 20 x 20
    assert windows.mask[0, 10:, 10:].all()


def test_the_rotation_takes_the_ray_to_z_by_the_smallest_angle() -> None:
    ray = np.array([[0.3, -0.4, 1.0], [0.0, 0.0, 1.0]])
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    R = smallest_rotation_to_z(ray)
    np.testing.assert_allclose(np.einsum("rij,rj->ri", R, ray), [[0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-15)
    np.testing.assert_allclose((np.trace(R, axis1=1, axis2=2) - 1) / 2, ray[:, 2], atol=1e-15)


@pytest.mark.parametrize("uv", [(319.5, 239.5), (560.0, 240.0), (90.0, 430.0)])
def test_a_disc_that_faces_its_viewing_ray_is_a_disc_of_its_size(uv: tuple[float, float]) -> None:
    radius, distance = 20.0, 500.0
    centre_uv = np.array([uv])
    ray = PINHOLE.viewing_ray(centre_uv)[0]
    u, v = np.meshgrid(np.arange(640.0), np.arange(480.0))
    rays = PINHOLE.viewing_ray(np.stack([u, v], axis=-1))
    X_cam = rays * (distance / (rays @ ray))[..., None]  # the plane across the ray
    hit = np.linalg.norm(X_cam - distance * ray, axis=-1) <= radius
    labels = np.where(hit, 0, -1)
    normals = np.where(hit[..., None], -ray, 0.0)
    windows, _ = extract_windows(
        labels, normals, np.array([0]), centre_uv, np.array([distance * ray[2]]), PINHOLE, 1.0, 64
    )
    window = Window(windows.mask[0], windows.normals[0], windows.pitch[0])
    np.testing.assert_allclose(window.normals[window.mask], np.tile([0, 0, -1], (window.mask.sum(), 1)), atol=1e-6)
    inertia = face_inertia(window)
    assert float(inertia.area) == pytest.approx(np.pi * radius**2, rel=0.02)
    assert float(inertia.I_max) == pytest.approx(np.pi * radius**4 / 4, rel=0.04)
    np.testing.assert_allclose(inertia.centroid, 0.0, atol=0.5)
