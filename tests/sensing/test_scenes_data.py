"""The scenes of the development data, rendered by another program: what the sensing stage reads is what is there."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.regions import regions
from itree_jax.sensing.scene_folder import load_scene, scene_folders

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = Path(os.environ.get("ITREE_DATA", REPOSITORY.parent / "shared" / "data")) / "scenes"

pytestmark = pytest.mark.skipif(not SCENES.is_dir(), reason=f"no development data at {SCENES} (set ITREE_DATA)")


@pytest.fixture(scope="module")
def level_a():
    scene = load_scene(SCENES / "test" / "000201")
    ids = cv2.imread(str(SCENES / "test" / "000201" / "ids" / "000000.png"), cv2.IMREAD_UNCHANGED)
    return scene, needle_map(scene.images, scene.sensor), ids


def test_every_scene_is_found():
    folders = scene_folders(SCENES)
    assert [int(folder.name) for folder in folders] == [100 * obj + k for obj in range(1, 5) for k in range(1, 7)]


def test_a_scene_is_read_as_its_files_say(level_a):
    scene, _, _ = level_a
    assert (scene.scene_id, scene.im_id) == (201, 0)
    assert scene.images.shape == (3, 480, 640)
    assert scene.images.dtype == np.float32
    assert scene.sensor.camera.fx == pytest.approx(1814.81, abs=0.01)
    assert scene.sensor.working_distance == pytest.approx(900.0)
    assert np.degrees(scene.sensor.slant_limit) == pytest.approx(42.0, abs=1e-9)
    assert scene.depth is not None
    assert 800 < scene.depth.min() < scene.depth.max() < 930


def test_normals_of_a_noise_free_scene_agree_with_its_exact_depth(level_a):
    """Level A is Lambertian with direct light: needles are those of the depth map's gradient but for creases."""
    scene, needle, ids = level_a
    path = scene.folder / "depth_exact" / "000000.png"
    scale = json.loads((scene.folder / "scene_camera.json").read_text())["0"]["depth_scale"]
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * scale
    v, u = np.mgrid[:480, :640].astype(float)
    X = scene.sensor.camera.unproject(np.stack([u, v], axis=-1), cv2.GaussianBlur(depth, (0, 0), 2.0))
    normal = np.cross(np.gradient(X, axis=0), np.gradient(X, axis=1))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    flat = cv2.morphologyEx(depth, cv2.MORPH_GRADIENT, np.ones((13, 13))) < 13 * 0.5  # no step in the blur's reach
    same = cv2.erode((ids > 0).astype(np.uint8), np.ones((13, 13))) > 0
    sure = flat & same & np.asarray(needle.interpretable)
    assert sure.sum() > 2000
    cosine = np.clip((np.asarray(needle.normals) * normal).sum(-1)[sure], -1, 1)
    assert np.degrees(np.median(np.arccos(cosine))) < 1.0  # the depth map's own steps of 0.1 mm


def test_half_of_the_visible_area_is_lit_by_all_lights(level_a):
    _, needle, ids = level_a
    assert 0.4 < np.asarray(needle.interpretable)[ids > 0].mean() < 0.7


def test_regions_are_pure_and_the_highest_is_a_part(level_a):
    scene, needle, ids = level_a
    found = regions(needle, scene.depth, scene.sensor, scene.R_w2c)
    of_parts = [ids[found.mask(k)] for k in range(found.count) if np.median(ids[found.mask(k)]) > 0]
    assert len(of_parts) >= 8
    purity = [np.bincount(members).max() / members.size for members in of_parts]
    assert np.mean(np.array(purity) > 0.95) >= 0.9
    assert np.median(ids[found.mask(0)]) > 0
    assert (np.diff(found.height) <= 0).all()
