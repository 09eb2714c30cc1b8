"""What is written for other programs is read back: poses of GLB, JSON and csv are the same."""

import json

import numpy as np
import pytest
import trimesh
from itree_kernels.errors import ItreeError

from itree_jax.report.scene_view import scene_view
from itree_jax.report.world_files import CAMERA_NODE, METRES, upright_metres, write_world
from itree_jax.results import read_bop_csv, write_bop_csv, write_json


@pytest.fixture(scope="module")
def world(scene, detections, tree):
    return scene_view(scene, detections, [tree]).world


def test_the_nodes_of_a_glb_file_are_the_poses(world, detections, tree, tmp_path):
    glb, _ = write_world(world, tmp_path, "w")
    read = trimesh.load_scene(glb)
    write_bop_csv([detections], tmp_path / "r.csv")
    write_json([detections], tmp_path / "r.json")
    rows = read_bop_csv(tmp_path / "r.csv")
    (image,) = json.loads((tmp_path / "r.json").read_text())["images"]
    assert len(image["detections"]) == len(rows) == len(detections)
    for k, told in enumerate(image["detections"]):
        T_cam_obj, geometry = read.graph.get(f"pose {told['offer_rank']}", CAMERA_NODE)
        np.testing.assert_allclose(T_cam_obj, np.reshape(told["T"], (4, 4)), atol=1e-4)  # GLB holds single precision
        np.testing.assert_allclose(rows.R[k].ravel(), told["R"])
        np.testing.assert_array_equal(rows.t[k], told["t"])
        mesh = read.geometry[geometry]
        assert mesh.volume == pytest.approx(trimesh.Trimesh(tree.part.vertices, tree.part.triangles).volume, rel=1e-4)
        assert mesh.metadata["kind"] == "part"
        assert f"score {told['score']:.3f}" in mesh.metadata["note"]


def test_a_glb_file_is_in_metres_with_y_up(world, tmp_path):
    glb, ply = write_world(world, tmp_path, "w")
    read = trimesh.load_scene(glb)
    mesh = trimesh.load_mesh(ply)
    parts = [name for name in read.graph.nodes_geometry if name.startswith("pose")]
    heights = {name: (read.graph.get(name)[0] @ [0, 0, 0, 1])[1] / METRES for name in parts}
    for placed in world.parts:
        height = placed.detection.t_cam_obj @ world.up_cam
        assert heights[f"pose {placed.detection.offer_rank}"] == pytest.approx(height, abs=1e-3)
    both = np.ptp(read.bounds, axis=0) / METRES, np.abs(upright_metres(world.up_cam)[:3, :3]) / METRES
    np.testing.assert_allclose(both[0], both[1] @ np.ptp(mesh.bounds, axis=0), rtol=1e-4)  # axes are only swapped


@pytest.mark.parametrize("up", [[0.0, 0, -1], [0.0, -1, 0], [1.0, 0, 0], [0.6, 0, -0.8]])
def test_up_becomes_y_by_a_rotation(up):
    R = upright_metres(np.array(up))[:3, :3] / METRES
    np.testing.assert_allclose(R @ up, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_folder_that_is_not_there_is_an_error(world, tmp_path):
    with pytest.raises(ItreeError, match="cannot be written"):
        write_world(world, tmp_path / "none", "w")
