"""Lit scenes equal their brute-force twin and closed forms; a bin is an open box."""

import os

import numpy as np
import pytest
import trimesh
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.bin import bin_mesh
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh

from .solids import LIGHTS, SLANT_LIMIT, as_ray_mesh, facing_plane, random_poses, small_solids
from .twins import boundary_band, render_scene_twin

INTENSITIES = np.array([0.9, 0.7, 1.1])
OVERHEAD = np.diag([1.0, -1.0, -1.0])  # the bin's z up, the camera's z down
CAMERAS = {
    "orthographic": Camera("orthographic", 1.0, 1.05, 47.63, 35.37, 96, 72),
    "pinhole": Camera("pinhole", 400.0, 410.0, 47.63, 35.37, 96, 72),
}


def bin_ray_mesh(size=(80.0, 60.0), wall=3.0, height=25.0):
    vertices, triangles = bin_mesh(size, wall, height)
    return ray_mesh(vertices, triangles, np.arange(len(triangles)), device="cpu")


def small_bin(seed: int):
    """A bin and six parts of three kinds, floating and overlapping in the image."""
    solids = small_solids()
    meshes = [bin_ray_mesh(), solids["box"], solids["cylinder"], solids["torus"]]
    R, t = random_poses(6, seed)
    rng = np.random.default_rng(seed)
    t = np.column_stack([rng.uniform(-25, 25, 6), rng.uniform(-18, 18, 6), 400 - rng.uniform(15, 50, 6)])
    return meshes, [0, 1, 2, 3, 1, 2, 3], np.concatenate([OVERHEAD[None], R]), np.concatenate([[[0, 0, 400.0]], t])


def glossy(count: int) -> Material:
    rng = np.random.default_rng(count)
    return Material(rng.uniform(0.3, 0.9, count), rng.uniform(0.0, 0.5, count), rng.uniform(5.0, 50.0, count))


@pytest.mark.parametrize("camera", CAMERAS)
def test_kernel_equals_twin(camera):
    args = *small_bin(seed=1), CAMERAS[camera], LIGHTS[:2], INTENSITIES[:2], glossy(7), 0.1
    kernel, twin = render_scene(*args), render_scene_twin(*args)
    same = (kernel.instance == twin.instance) & (kernel.face == twin.face) & (kernel.lit == twin.lit).all(axis=0)
    band = boundary_band(twin.instance, twin.face, *twin.lit)
    assert same[~band].all()
    assert np.count_nonzero(~same) <= 5
    np.testing.assert_allclose(kernel.depth[same], twin.depth[same], rtol=0, atol=2e-3)
    np.testing.assert_allclose(kernel.normal[same], twin.normal[same], rtol=0, atol=1e-6)
    np.testing.assert_allclose(kernel.images[:, same], twin.images[:, same], rtol=0, atol=2e-5)
    assert set(np.unique(twin.instance)) == {-1, 0, 1, 2, 3, 4, 5, 6}
    # shadows between instances are there: facing the light, yet not lit
    facing = np.einsum("hwc,nc->nhw", twin.normal, LIGHTS[:2]) > 0
    assert np.count_nonzero(facing & ~twin.lit) > 500


def test_one_instance_equals_its_apparent_shape():
    """Rays and filled triangles, one truth."""
    torus, camera = small_solids()["torus"], CAMERAS["pinhole"]
    R, t = random_poses(1, seed=2, distance=400.0)
    shapes = cast_apparent_shapes(torus, R, t, camera, LIGHTS, SLANT_LIMIT)
    scene = render_scene([torus], [0], R, t, camera, LIGHTS, INTENSITIES, Material())
    np.testing.assert_array_equal(scene.face, shapes.face[0])
    np.testing.assert_array_equal(scene.instance, np.where(shapes.face[0] >= 0, 0, -1))
    np.testing.assert_allclose(scene.depth, shapes.depth[0], rtol=1e-6)
    np.testing.assert_array_equal(scene.normal, shapes.normal[0])
    assert np.count_nonzero(scene.lit != shapes.lit[0]) <= 2  # their shadow rays start a few micrometres apart


def test_lambert_specular_and_ambient_on_a_plane():
    """A plane that faces the camera: n.l = cos a, n.h = cos(a/2). In the dark only the ambient fraction is left."""
    a = np.deg2rad(np.array([0.0, 30.0, 60.0, 100.0]))
    lights = np.column_stack([np.sin(a), 0 * a, -np.cos(a)])
    E, albedo, specular, exponent, ambient = np.array([1.0, 0.5, 2.0, 1.0]), 0.6, 0.3, 12.0, 0.05
    camera = Camera("orthographic", 1.0, 1.0, 3.5, 3.5, 8, 8)
    scene = render_scene(
        [facing_plane(50.0)], [0], np.eye(3)[None], np.array([[0, 0, 70.0]]), camera, lights, E,
        Material(albedo, specular, exponent), ambient,
    )  # fmt: skip
    lobe = specular * np.cos(a / 2) ** exponent
    expected = E * (albedo * ambient + np.where(a < np.pi / 2, albedo * np.cos(a) + lobe, 0.0))
    np.testing.assert_allclose(scene.images, np.broadcast_to(expected[:, None, None], (4, 8, 8)), rtol=1e-5)
    assert scene.images.dtype == np.float32
    assert scene.lit.all(axis=(1, 2)).tolist() == [True, True, True, False]


def test_images_are_linear_in_light_and_albedo():
    args = *small_bin(seed=3), CAMERAS["pinhole"], LIGHTS
    one = render_scene(*args, INTENSITIES, Material(0.4)).images
    np.testing.assert_allclose(render_scene(*args, 2 * INTENSITIES, Material(0.4)).images, 2 * one, rtol=1e-6)
    np.testing.assert_allclose(render_scene(*args, INTENSITIES, Material(0.8)).images, 2 * one, rtol=1e-6)


@pytest.mark.parametrize("elevation_deg", [45.0, 65.0])
def test_shadow_of_one_instance_on_another(elevation_deg):
    """A box of height h on a plane: the shadow is h / tan(elevation) long, and moves with the box."""
    height, pitch, e = 12.0, 0.2, np.deg2rad(elevation_deg)
    plane, box = as_ray_mesh(trimesh.creation.box((160, 80, 4))), as_ray_mesh(trimesh.creation.box((20, 20, height)))
    camera = Camera("orthographic", 1 / pitch, 1 / pitch, 400.3, 2.4, 800, 5)
    light = np.array([[-np.cos(e), 0, -np.sin(e)]])
    for x in (-40.0, 10.0):
        t = np.array([[0, 0, 102.0], [x, 0, 100 - height / 2]])
        scene = render_scene([plane, box], [0, 1], np.stack([OVERHEAD] * 2), t, camera, light, np.ones(1), Material())
        shadow = (scene.instance == 0) & ~scene.lit[0]
        assert (np.abs(shadow.sum(axis=1) * pitch - height / np.tan(e)) <= pitch).all()
        first = np.argmax(shadow, axis=1)
        assert (np.abs((first - camera.cx) * pitch - (x + 10)) <= pitch).all()
        assert scene.lit[0][scene.instance == 1].all()


def test_the_bin_shades_its_floor():
    """The wall toward the light is `height` over the floor: its shadow is height / tan(elevation) long."""
    e, pitch = np.deg2rad(50.0), 0.2
    camera = Camera("orthographic", 1 / pitch, 1 / pitch, 250.3, 2.4, 500, 5)
    light = np.array([[-np.cos(e), 0, -np.sin(e)]])
    t = np.array([[0, 0, 300.0]])
    scene = render_scene([bin_ray_mesh()], [0], OVERHEAD[None], t, camera, light, np.ones(1), Material())
    floor = np.abs(scene.depth - 300.0) < 1e-3
    assert (np.abs(floor.sum(axis=1) * pitch - 80.0) <= pitch).all()
    assert (np.abs((floor & ~scene.lit[0]).sum(axis=1) * pitch - 25.0 / np.tan(e)) <= pitch).all()
    assert scene.lit[0][np.abs(scene.depth - 275.0) < 1e-3].all()  # the rim


def test_a_bin_is_a_closed_open_box():
    vertices, triangles = bin_mesh((80.0, 60.0), 3.0, 25.0)
    solid = trimesh.Trimesh(vertices, triangles, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume == pytest.approx(86 * 66 * 28 - 80 * 60 * 25, rel=1e-12)
    np.testing.assert_allclose(solid.bounds, [[-43, -33, -3], [43, 33, 25]], atol=1e-12)
    floor = (solid.triangles_center[:, 2] == 0) & (solid.face_normals[:, 2] > 0.5)
    assert solid.area_faces[floor].sum() == pytest.approx(80 * 60, rel=1e-12)


def test_threads_change_nothing(monkeypatch):
    args = *small_bin(seed=5), CAMERAS["pinhole"], LIGHTS, INTENSITIES, glossy(7)
    images = []
    for cores in (1, 2, 3):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        images.append(render_scene(*args).images.tobytes())
    assert images[0] == images[1] == images[2]


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_the_nearer_of_two_close_planes_is_seen(order):
    """Also far off the optical axis, where a pixel's ray is much longer than its depth."""
    camera = Camera("pinhole", 40.0, 40.0, 31.5, 31.5, 64, 64)
    t = np.array([[0, 0, 99.5], [0, 0, 100.0]])[order]
    plane, pose = facing_plane(300.0), np.stack([np.eye(3)] * 2)
    scene = render_scene([plane], [0, 0], pose, t, camera, LIGHTS, INTENSITIES, Material())
    assert (scene.instance == order.index(0)).all()
    np.testing.assert_allclose(scene.depth, 99.5, rtol=1e-6)


def test_the_order_of_instances_does_not_matter():
    meshes, which, R, t = small_bin(seed=6)
    camera, order = CAMERAS["pinhole"], np.array([4, 2, 0, 6, 5, 1, 3])
    a = render_scene(meshes, which, R, t, camera, LIGHTS, INTENSITIES, Material())
    b = render_scene(meshes, np.array(which)[order], R[order], t[order], camera, LIGHTS, INTENSITIES, Material())
    hit = b.instance >= 0
    np.testing.assert_array_equal(a.instance[hit], order[b.instance[hit]])
    np.testing.assert_array_equal(a.images, b.images)
    np.testing.assert_array_equal(a.depth, b.depth)
