"""Photometric stereo of what the lit-scene kernel renders gives the kernel's own normals back."""

import numpy as np
import pytest
import trimesh
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh
from itree_kernels.noise import sensor_noise

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise

CAMERA = Camera("pinhole", 400.0, 400.0, 39.5, 29.5, 80, 60)


def ball_on_a_table():
    meshes = [trimesh.creation.icosphere(subdivisions=3, radius=20.0), trimesh.creation.box((400.0, 400.0, 10.0))]
    t_cam_obj = np.array([[0.0, 0.0, 480.0], [0.0, 0.0, 505.0]])
    return [ray_mesh(m.vertices, m.faces, np.zeros(len(m.faces), np.int32)) for m in meshes], t_cam_obj


@pytest.fixture(scope="module")
def rendered():
    meshes, t_cam_obj = ball_on_a_table()
    sensor = bundled_sensor("bench")
    e = np.array([0.9, 1.0, 1.1])
    R_cam_obj = np.tile(np.eye(3), (2, 1, 1))
    scene = render_scene(meshes, [0, 1], R_cam_obj, t_cam_obj, CAMERA, sensor.light_directions, e, Material(albedo=0.6))
    return scene, sensor, e


def test_normals_and_shadows_are_the_kernels(rendered, angle_between):
    scene, sensor, e = rendered
    needle = photometric_stereo(scene.images, sensor.light_directions, e, sensor.noise)
    all_lit = scene.lit.all(axis=0)
    within = all_lit & (-scene.normal[..., 2] > np.cos(np.radians(41.0)))
    assert within.sum() > 2000
    assert np.asarray(needle.interpretable)[within].all()
    assert not np.asarray(needle.interpretable)[~all_lit].any()
    assert angle_between(needle.normals, scene.normal)[within].max() < 2e-5
    table = (scene.instance == 1) & scene.lit.any(axis=0)
    np.testing.assert_array_equal(np.asarray(needle.shadowed)[:, table], ~scene.lit[:, table])
    assert (table & ~all_lit).sum() > 100  # there were cast shadows to find


def test_noise_turns_the_normals_as_predicted(rendered, angle_between):
    scene, sensor, e = rendered
    images = sensor_noise(scene.images, 12000.0, 6.0, 12, seed=4)
    needle = photometric_stereo(images, sensor.light_directions, e, Noise(12000.0, 6.0, 12))
    within = scene.lit.all(axis=0) & (-scene.normal[..., 2] > np.cos(np.radians(40.0)))
    assert np.asarray(needle.interpretable)[within].mean() > 0.999
    in_sigmas = angle_between(needle.normals, scene.normal)[within] / np.asarray(needle.normal_std)[within]
    assert np.sqrt(np.mean(in_sigmas**2)) == pytest.approx(1.0, abs=0.05)
