"""What a user can get wrong is said in the error."""

import numpy as np
import pytest
from itree_kernels.apparent import cast_apparent_shapes
from itree_kernels.bin import bin_mesh
from itree_kernels.errors import ItreeError
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh

from .solids import LIGHTS, PINHOLE, SLANT_LIMIT, small_solids

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
FACES = np.array([0, 1])
SPOILT = VERTICES.copy()
SPOILT[2, 1] = np.nan


@pytest.mark.parametrize(
    ("vertices", "triangles", "faces", "message"),
    [
        (np.zeros((0, 3)), TRIANGLES, FACES, "vertices of shape"),
        (VERTICES[:, :2], TRIANGLES, FACES, "vertices of shape"),
        (VERTICES, TRIANGLES[:0], FACES[:0], "triangles of shape"),
        (VERTICES, TRIANGLES.ravel(), FACES, "triangles of shape"),
        (VERTICES, TRIANGLES + 2, FACES, r"triangles holds 2..5, outside 0..3"),
        (VERTICES, TRIANGLES - 1, FACES, r"triangles holds -1..2, outside 0..3"),
        (VERTICES, TRIANGLES.astype(float), FACES, "must be integers"),
        (VERTICES, TRIANGLES, FACES[:1], "2 triangles"),
        (VERTICES, TRIANGLES, FACES - 1, "face_of_triangle holds -1"),
        (VERTICES, TRIANGLES, FACES + 32767, "face_of_triangle holds 32767..32768"),
        (SPOILT, TRIANGLES, FACES, "vertex 2 of the mesh is not finite"),
    ],
)
def test_meshes(vertices, triangles, faces, message):
    with pytest.raises(ItreeError, match=message):
        ray_mesh(vertices, triangles, faces)


def test_unknown_device():
    with pytest.raises(ItreeError, match=r"no device 'abacus'.*cpu"):
        ray_mesh(VERTICES, TRIANGLES, FACES, device="abacus")


def test_a_mesh_keeps_its_own_copy():
    vertices = VERTICES.astype(np.float32)
    mesh = ray_mesh(vertices, TRIANGLES.astype(np.int32), FACES, device="cpu")
    vertices[:] = 7
    np.testing.assert_array_equal(mesh.vertices, VERTICES)


def test_a_triangle_without_area_has_no_normal():
    mesh = ray_mesh(VERTICES, np.array([[0, 1, 2], [1, 1, 2]]), FACES, device="cpu")
    np.testing.assert_array_equal(mesh.triangle_normals, [[0, 0, 1], [0, 0, 0]])


@pytest.mark.parametrize(
    ("R", "t", "lights", "message"),
    [
        (np.zeros((2, 3, 3)), np.zeros((1, 3)), LIGHTS, "2 rotations but 1 translations"),
        (np.zeros((1, 3, 3)), np.zeros((1, 3)), 2 * LIGHTS, "light 0 has length 2"),
        (np.zeros((1, 3, 3)), np.zeros((1, 3)), LIGHTS[0], "shape"),
    ],
)
def test_views(R, t, lights, message):
    with pytest.raises(ItreeError, match=message):
        cast_apparent_shapes(small_solids()["box"], R, t, PINHOLE, lights, SLANT_LIMIT)


@pytest.mark.parametrize(
    ("meshes", "which", "poses", "intensities", "material", "message"),
    [
        (0, [], 0, 3, Material(), "one or more meshes"),
        (1, [0, 1], 2, 3, Material(), "must name one of the 1 meshes"),
        (1, [-1], 1, 3, Material(), "must name one of the 1 meshes"),
        (1, [0], 2, 3, Material(), "1 instances need rotations"),
        (1, [0], 1, 2, Material(), "3 light directions but intensities"),
        (1, [0], 1, 3, Material(np.ones(2)), "albedo has shape"),
    ],
)
def test_scenes(meshes, which, poses, intensities, material, message):
    box = small_solids()["box"]
    R, t = np.stack([np.eye(3)] * poses) if poses else np.zeros((0, 3, 3)), np.zeros((poses, 3))
    with pytest.raises(ItreeError, match=message):
        render_scene([box] * meshes, which, R, t, PINHOLE, LIGHTS, np.ones(intensities), material)


@pytest.mark.parametrize("lengths", [((0.0, 10.0), 1.0, 5.0), ((10.0, 10.0), -1.0, 5.0), ((10.0, 10.0), 1.0, np.nan)])
def test_bins(lengths):
    with pytest.raises(ItreeError, match="positive lengths"):
        bin_mesh(*lengths)
