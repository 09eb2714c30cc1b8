"""A part compiled for a depth camera and found by it alone, through files as a user would."""

from dataclasses import replace

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from scipy.spatial.transform import Rotation

from itree_jax.cli.main import main as itree
from itree_jax.evaluation import mssd
from itree_jax.evaluation.pose_errors import Pose
from itree_jax.evaluation.symmetry import symmetry_set
from itree_jax.results import read_bop_csv
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.dataset import model_info
from itree_jax.simulate.imaging import image_bin
from itree_jax.tree.tree_file import load_tree

TABLE = Bin((500.0, 400.0), 5.0)  # its walls are out of view
ROTATION = Rotation.from_euler("zx", [30, 15], degrees=True)


@pytest.fixture(scope="module")
def scene():
    """One part in the middle of the image, which is cropped to it: quicker."""
    T_bin_obj = np.eye(4)[None]
    T_bin_obj[0, :3, :3], T_bin_obj[0, 2, 3] = ROTATION.as_matrix(), 30.0
    sensor = bundled_sensor("depth-bench")
    sensor = replace(sensor, camera=sensor.camera.cropped(180, 110, 280, 260))
    return image_bin(bundled_part("bracket"), T_bin_obj, TABLE, sensor, seed=0)


def test_the_tree_keeps_its_sensor_and_compares_no_edges(depth_tree_file):
    tree = load_tree(depth_tree_file)
    assert tree.sensor.is_depth_camera
    assert tree.sensor.depth_noise == 0.3
    assert tree.sensor.light_directions.shape == (0, 3)
    assert not tree.appearances.edge_map.any()
    assert not any("L5" in rule for rule in tree.nodes.rule)
    assert not any("A7" in steps for steps in tree.determination.steps)


def test_the_part_is_found_in_a_scene_folder(depth_tree_file, scene, tmp_path):
    seen, truth = scene
    write_scene(tmp_path / "000001", seen, truth)
    out = tmp_path / "results.csv"
    words = ["recognize", tmp_path / "000001", depth_tree_file, "-o", out, "--report", tmp_path / "pages", "--quiet"]
    assert itree([str(word) for word in words]) == 0
    found, part = read_bop_csv(out), bundled_part("bracket")
    symmetry = symmetry_set(model_info(part))
    assert len(found.R) == 1
    true = Pose(truth[0].R_cam_obj, truth[0].t_cam_obj)
    assert float(mssd(Pose(found.R[0], found.t[0]), true, part.vertices, symmetry)) < 0.05 * part.diameter
    assert "gradient" in (tmp_path / "pages" / "scene_000001.html").read_text()


def test_a_scene_with_lights_is_refused_with_what_to_do(depth_tree_file, tmp_path, capsys):
    lit = image_bin(bundled_part("bracket"), np.eye(4)[None], TABLE, bundled_sensor("bench"), seed=0)[0]
    write_scene(tmp_path / "000001", lit)
    words = ["recognize", tmp_path / "000001", depth_tree_file, "-o", tmp_path / "r.csv", "--quiet"]
    assert itree([str(word) for word in words]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "compiled for a depth camera, and this scene has lights" in said
    assert "itree compile" in said
    assert not (tmp_path / "r.csv").exists()
