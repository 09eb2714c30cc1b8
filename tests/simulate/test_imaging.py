"""Laws of simulated images, and a data set written and read back."""

import json
from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError

from itree_jax.detections import Detection, Detections
from itree_jax.evaluation import evaluate
from itree_jax.results import write_bop_csv
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import load_scene
from itree_jax.simulate import Bin, ImageNoise, Look, bin_for, demo_bin, demo_scene, image_bin, simulate
from itree_jax.simulate.bin import camera_above
from itree_jax.stereo.second_file import load_second

from ..primitives import box_part

SMALL = replace(
    bundled_sensor("bench"), camera=Camera("pinhole", 300.0, 300.0, 59.5, 44.5, 120, 90), working_distance=500.0
)
FLAT = replace(SMALL, camera=Camera("orthographic", 1.0, 1.0, 59.5, 44.5, 120, 90))
NOISELESS = ImageNoise(sensor=False, depth=0.0)
BOX = box_part(40, 30, 20)
LOW_BIN = Bin((110.0, 80.0), 2.0)


def lying(x: float, y: float, z: float = 0.0) -> np.ndarray:
    """A box that lies on z with its long side along x."""
    T = np.eye(4)
    T[:3, 3] = np.array([x, y, z + 10.0]) - BOX.vertices.mean(axis=0)
    return T


@pytest.mark.parametrize("sensor", [SMALL, FLAT])
def test_the_camera_looks_straight_down_on_the_middle_of_the_floor(sensor):
    X_cam = camera_above(sensor) @ [0, 0, 0, 1]
    np.testing.assert_allclose(sensor.camera.project(X_cam[:3]), [59.5, 44.5])
    assert X_cam[2] == 500.0
    np.testing.assert_array_equal(camera_above(sensor)[:3, :3] @ [0, 0, 1], [0, 0, -1])  # up is toward the camera


def test_a_level_face_has_its_depth_and_brightness():
    look = Look("test", albedo=0.5, bin_albedo=0.1)
    scene, _ = image_bin(BOX, lying(0, 0)[None], LOW_BIN, FLAT, look, NOISELESS, seed=0)
    assert scene.depth is not None
    np.testing.assert_allclose(scene.depth[40:50, 45:75], 480.0, atol=1e-3)
    cosine = np.cos(np.radians(35))
    np.testing.assert_allclose(scene.images[:, 40:50, 45:75], 0.5 * cosine, rtol=1e-5)
    np.testing.assert_allclose(scene.depth[10, 10], 500.0, atol=1e-3)
    np.testing.assert_allclose(scene.images[:, 40:50, 9], 0.1 * cosine, rtol=1e-5)


def test_visibility_is_the_share_of_pixels_that_nothing_hides():
    """Seen orthographically, a box half under another one is half visible."""
    T = np.stack([lying(0, 0), lying(0, 0, 20), lying(-20, 0, 40), lying(-20, 0, -60)])
    scene, truth = image_bin(BOX, T, LOW_BIN, FLAT, noise=NOISELESS, seed=0)
    visible = [true.visib_fract for true in truth]
    assert visible == pytest.approx([0.0, 0.5, 1.0, 0.0], abs=0.03)
    assert [true.px_count_all for true in truth] == [1200] * 4
    assert truth[2].bbox_visib == (20, 30, 40, 30)
    assert truth[3].bbox_visib == (-1, -1, -1, -1)
    assert scene.images.dtype == np.float32


def test_noise_is_what_was_asked_for():
    T = lying(0, 0)[None]
    clean, _ = image_bin(BOX, T, LOW_BIN, FLAT, noise=NOISELESS, seed=0)
    noisy, _ = image_bin(BOX, T, LOW_BIN, FLAT, noise=ImageNoise(depth=0.3), seed=0)
    assert clean.depth is not None
    assert noisy.depth is not None
    assert np.std(noisy.depth - clean.depth) == pytest.approx(0.3, rel=0.05)
    lit = np.s_[:, 32:58, 42:78]  # the top of the box: 2808 pixels, so the deviation is known to 1.3 %
    mean, noise = float(clean.images[lit].mean()), FLAT.noise
    expected = np.sqrt(mean / noise.full_well_e + (noise.read_noise_e / noise.full_well_e) ** 2)
    assert np.std(noisy.images[lit] - clean.images[lit]) == pytest.approx(expected, rel=0.08)


def test_the_same_seed_gives_the_same_image():
    a, b, c = (demo_scene(bundled_sensor("ikeuchi-1987"), seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(a.images, b.images)
    np.testing.assert_array_equal(a.depth, b.depth)
    assert (a.images != c.images).mean() > 0.5


def test_the_demo_needs_no_engine_and_shows_most_parts():
    scene, truth = demo_bin(bundled_sensor("bench"), 0)
    assert len(truth) == 8
    assert sum(true.visib_fract >= 0.7 for true in truth) >= 6
    assert 0.5 < scene.images.max() <= 1.0
    for true in truth:
        assert true.t_cam_obj[2] == pytest.approx(860, abs=60)


def test_a_sensor_that_sees_too_little_is_refused():
    with pytest.raises(ItreeError, match="192 x 144 mm, is larger than the field of view, 120 x 90 mm"):
        demo_scene(FLAT, 0)
    with pytest.raises(ItreeError, match="no room for a part of diameter 200"):
        bin_for(SMALL, 200.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulated") / "dataset"
    calls = []
    simulate(BOX, SMALL, 2, 2, out, seed=5, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(1, 2), (2, 2)]
    return out


def test_a_data_set_is_read_back(dataset):
    scene = load_scene(dataset / "test" / "000002")
    assert scene.scene_id == 2
    assert scene.images.shape == (3, 90, 120)
    assert scene.depth is not None
    assert scene.depth.max() == pytest.approx(504, abs=2)  # the table, under a floor 4 mm thick
    assert scene.sensor.camera == SMALL.camera
    np.testing.assert_allclose(scene.sensor.light_directions, SMALL.light_directions, atol=1e-12)
    assert scene.sensor.working_distance == pytest.approx(500.0)
    np.testing.assert_array_equal(scene.R_w2c, np.diag([1, -1, -1]))
    record = json.loads((dataset / "scenes.json").read_text())["000002"]
    assert (record["level"], record["kind"], record["lights"], record["instances"]) == ("S", "bin", 3, 2)
    info = json.loads((dataset / "models" / "models_info.json").read_text())["1"]
    assert info["diameter"] == pytest.approx(np.sqrt(40**2 + 30**2 + 20**2))
    assert len(info["symmetries_discrete"]) == 3  # a box: half turns about three axes


def test_the_truth_of_a_data_set_scores_all(dataset, tmp_path):
    images = []
    for scene_id in (1, 2):
        folder = dataset / "test" / f"{scene_id:06d}"
        entries = json.loads((folder / "scene_gt.json").read_text())["0"]
        rows = tuple(
            Detection(scene_id, 0, e["obj_id"], 1.0, np.reshape(e["cam_R_m2c"], (3, 3)), np.array(e["cam_t_m2c"]))
            for e in entries
        )
        images.append(Detections(rows, scene_id=scene_id))
    write_bop_csv(images, tmp_path / "truth.csv")
    report = evaluate(dataset, tmp_path / "truth.csv")
    assert report.groups["level S"].precision_5.fraction == 1.0
    assert report.groups["level S"].top_pick.fraction == 1.0


def test_the_same_seed_gives_the_same_data_set(dataset, tmp_path):
    simulate(BOX, SMALL, 2, 2, tmp_path / "again", seed=5)
    for path in sorted(p for p in dataset.rglob("*") if p.is_file()):
        assert path.read_bytes() == (tmp_path / "again" / path.relative_to(dataset)).read_bytes(), path


def test_a_second_camera_sees_the_same_bin_from_the_side(tmp_path):
    simulate(BOX, SMALL, 1, 2, tmp_path / "two", seed=1, second_camera=60.0)
    scene = load_scene(tmp_path / "two" / "test" / "000001")
    second = load_second(scene)
    assert second is not None
    np.testing.assert_allclose(second.R_second_first, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(second.t_second_first, [-60.0, 0.0, 0.0], atol=1e-9)
    alone = image_bin(BOX, lying(0, 0)[None], LOW_BIN, SMALL, noise=NOISELESS, seed=0)[0]
    aside = image_bin(BOX, lying(0, 0)[None], LOW_BIN, SMALL, noise=NOISELESS, seed=0, aside=60.0, im_id=1)[0]
    rows = np.flatnonzero((alone.depth == alone.depth[alone.depth > 0].min()).any(axis=1))
    row = rows[len(rows) // 2]
    shown = [np.flatnonzero(np.isclose(one.depth[row], alone.depth[row].min(), atol=0.01)) for one in (alone, aside)]
    disparity = shown[0].mean() - shown[1].mean()
    assert disparity == pytest.approx(300.0 * 60.0 / alone.depth[row].min(), abs=0.6)


def test_a_folder_with_something_in_it_is_not_touched(dataset):
    with pytest.raises(ItreeError, match="not an empty folder"):
        simulate(BOX, SMALL, 1, 1, dataset)


def test_one_part_alone_is_a_kind_of_its_own(tmp_path):
    simulate(box_part(20, 15, 10), FLAT, 1, 1, tmp_path, seed=0, look=Look("dull", albedo=0.3))
    record = json.loads((tmp_path / "scenes.json").read_text())["000001"]
    assert (record["kind"], record["instances"], record["material"]) == ("isolated", 1, "dull")
    gt = json.loads((tmp_path / "test" / "000001" / "scene_gt_info.json").read_text())["0"]
    assert gt[0]["visib_fract"] == 1.0
    assert load_scene(tmp_path / "test" / "000001").sensor.camera.is_orthographic
