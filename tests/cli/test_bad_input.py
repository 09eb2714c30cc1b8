"""Bad input as a user meets it: a message that names the file and the reason, exit code 2, and nothing written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from itree_kernels.camera import Camera

from itree_jax.detections import Detections
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene
from itree_jax.sensing.scene_writer import write_scene
from itree_jax.sensing.sensor_file import sensor_to_json

WIDTH, HEIGHT = 64, 48
BENCH = bundled_sensor("bench")
L = BENCH.light_directions.tolist()
HUGE = 10**400  # a whole number that no float holds
DEEP = "[" * 100_000


@pytest.fixture(scope="module")
def good_scene(tmp_path_factory) -> Path:
    """A tenth of the bench camera's image, of random pixels. Not to be changed."""
    rng = np.random.default_rng(0)
    c = BENCH.camera
    sensor = replace(BENCH, camera=Camera(c.kind, c.fx / 10, c.fy / 10, 31.5, 23.5, WIDTH, HEIGHT))
    images = rng.uniform(0.1, 0.9, (3, HEIGHT, WIDTH)).astype(np.float32)
    depth = rng.uniform(850, 900, (HEIGHT, WIDTH)).astype(np.float32)
    down, t = np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, BENCH.working_distance])
    folder = tmp_path_factory.mktemp("scene") / "000042"
    write_scene(folder, Scene(42, 0, images, depth, sensor, down, None, t), None)
    return folder


@pytest.fixture
def scene(good_scene, tmp_path) -> Path:
    """A copy to be spoilt."""
    return shutil.copytree(good_scene, tmp_path / "000042")


@pytest.fixture
def recognises(monkeypatch):
    """Recognition that finds nothing, at once."""
    monkeypatch.setattr(import_module("itree_jax.recognition"), "recognize_one", lambda *_: Detections((), time=1.0))


def image(folder: Path, light: int = 1) -> Path:
    return folder / "lit" / f"000000_{light:02d}.png"


def stored(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def every_image(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        for light in range(3):
            cv2.imwrite(str(image(folder, light)), change(stored(image(folder, light))))

    return spoil


def as_array(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Image 1 as an array in floats."""
    def spoil(folder: Path) -> None:
        np.save(image(folder).with_suffix(".npy"), change(stored(image(folder)) / 65535.0))
        image(folder).unlink()

    return spoil


def array_file(content: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        as_array(lambda values: values)(folder)
        path = image(folder).with_suffix(".npy")
        path.write_bytes(content(path.read_bytes()))

    return spoil


def entry(name: str, key: str, value: object) -> Callable[[Path], None]:
    """A value in the entry of image 0; called with the old one if it is a function."""
    def spoil(folder: Path) -> None:
        data = json.loads((folder / name).read_text())
        data["0"][key] = value(data["0"].get(key)) if callable(value) else value
        (folder / name).write_text(json.dumps(data))

    return spoil


def text(name: str, content: str | bytes) -> Callable[[Path], None]:
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(data) and None


def K(change: Callable[[list[float]], list[float]]) -> Callable[[Path], None]:
    return entry("scene_camera.json", "cam_K", change)


def focal(factor: float) -> Callable[[Path], None]:
    return K(lambda K: [factor * x if i in (0, 4) else x for i, x in enumerate(K)])


def lights(value: object) -> Callable[[Path], None]:
    return entry("scene_lights.json", "directions", value)


def intensities(value: object) -> Callable[[Path], None]:
    return entry("scene_lights.json", "intensities", value)


def cut(path_of: Callable[[Path], Path], share: float) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        content = path_of(folder).read_bytes()
        path_of(folder).write_bytes(content[: int(share * len(content))])

    return spoil


def flip(folder: Path) -> None:
    content = bytearray(image(folder).read_bytes())
    content[len(content) // 2] ^= 0xFF
    image(folder).write_bytes(bytes(content))


def long_chunk(folder: Path) -> None:
    """The data of a PNG begins at byte 33 with their length."""
    content = image(folder).read_bytes()
    image(folder).write_bytes(content[:33] + b"\xff\xff" + content[35:])


def as_folder(folder: Path) -> None:
    image(folder).unlink()
    image(folder).mkdir()


SPOILT: dict[str, tuple[Callable[[Path], object], str]] = {
    # images
    "missing": (lambda f: image(f).unlink(), "image 000000_01 (light 1) is missing"),
    "empty": (cut(image, 0.0), "000000_01.png: the image file is empty"),
    "truncated": (cut(image, 0.7), "000000_01.png: not an image that is whole: it is cut short"),
    "damaged": (flip, "000000_01.png: not an image, cut short, or"),
    "a chunk of 4 GB": (long_chunk, "000000_01.png: not an image that is whole"),
    "no image": (lambda f: image(f).write_text("hello"), "000000_01.png: not an image"),
    "a folder": (as_folder, "000000_01.png: the image cannot be read (Is a directory)"),
    "other size": (lambda f: cv2.imwrite(str(image(f)), stored(image(f))[1:]), "the image is 64 x 47 px, the first"),
    "colour": (lambda f: cv2.imwrite(str(image(f)), np.dstack([stored(image(f))] * 2 + [stored(image(f, 2))])),
               "000000_01.png: the image has colour"),
    "black": (lambda f: cv2.imwrite(str(image(f)), 0 * stored(image(f))), "000000_01.png (light 1) is black"),
    "all black": (every_image(np.zeros_like), "000000_00.png (light 0) is black: no pixel is brighter than noise"),
    "saturated": (every_image(lambda a: np.full_like(a, 65535)), "is overexposed: 100 % of its pixels are saturated"),
    "twice the same": (lambda f: shutil.copy(image(f, 0), image(f)), "(lights 0 and 1) are the same image"),
    "array: empty": (array_file(lambda content: b""), "000000_01.npy: the image file is empty"),
    "array: cut": (array_file(lambda content: content[:500]), "000000_01.npy: cannot be read as an array"),
    "array: rubbish": (array_file(lambda content: b"\x93NUMPY\x01\x00\x01\x00("), "cannot be read as an array"),
    "array: archive": (array_file(lambda content: b"PK\x05\x06" + bytes(18)), "cannot be read as an array"),
    "array: no pixel": (as_array(lambda a: a[:0, :0, None][..., :0]), "000000_01.npy: the image has no pixel"),
    "NaN": (as_array(lambda a: np.where(a > 0.5, np.nan, a)), "000000_01.npy: the image has values that are not"),
    "infinite": (as_array(lambda a: np.where(a > 0.5, np.inf, a)), "000000_01.npy: the image has values that are not"),
    "counts as floats": (as_array(lambda a: 255.0 * a), "but 1.0 is full scale of an image in floats"),
    "negative": (as_array(lambda a: -a), "000000_01.npy (light 1) is black"),
    "complex": (as_array(lambda a: a + 1j), "images must be 8-bit, 16-bit or float, this one is complex128"),
    # depth
    "depth: truncated": (cut(lambda f: f / "depth" / "000000.png", 0.5), "depth/000000.png: not an image that is"),
    "depth: none": (lambda f: cv2.imwrite(str(f / "depth/000000.png"), np.zeros((HEIGHT, WIDTH), np.uint16)),
                    "the depth map has no depth"),
    "depth in m": (entry("scene_camera.json", "depth_scale", lambda s: 0.001 * s), "check 'depth_scale'"),
    "depth in um": (entry("scene_camera.json", "depth_scale", lambda s: 1000 * s), "check 'depth_scale'"),
    "depth in inches": (entry("scene_camera.json", "depth_scale", lambda s: 25.4 * s), "check 'depth_scale'"),
    # camera
    "camera: missing": (lambda f: (f / "scene_camera.json").unlink(), "no scene folder with a scene_camera.json"),
    "camera: empty": (text("scene_camera.json", ""), "scene_camera.json: cannot be read as JSON"),
    "camera: deep": (text("scene_camera.json", DEEP), "scene_camera.json: cannot be read as JSON (it is nested"),
    "camera: long number": (text("scene_camera.json", "9" * 5000), "scene_camera.json: cannot be read as JSON"),
    "camera: binary": (text("scene_camera.json", b"\xff\xfe\x00"), "scene_camera.json: cannot be read as JSON"),
    "camera: none": (text("scene_camera.json", '{"0": {}}'), "has no 'cam_K'"),
    "camera: huge": (K(lambda _: [HUGE] * 9), "'cam_K' must be numbers"),
    "camera: words": (K(lambda _: ["a"] * 9), "'cam_K' must be numbers"),
    "camera: negative": (focal(-1.0), "positive fx, fy"),
    "camera: in m": (focal(0.001), "give focal lengths in px"),
    "camera: of another unit": (focal(1000.0), "give focal lengths in px"),
    "camera: of inches": (focal(25.4), "the field of view by 'cam_K' beside that of the sensor"),
    "camera: not square": (K(lambda K: [3 * K[0], *K[1:]]), "so far from square"),
    "camera: of a larger image": (K(lambda K: [K[0], 0, 640.0, 0, *K[4:]]), "far outside of the image of 64 x 48 px"),
    "pose in m": (entry("scene_camera.json", "cam_t_w2c", lambda t: [0.001 * x for x in t]), "by 'cam_t_w2c' beside"),
    "pose: no rotation": (entry("scene_camera.json", "cam_R_w2c", [0] * 9), "is not a rotation matrix"),
    # lights
    "lights: two": (lights(L[:2]), "needs three or more lights, there are 2"),
    "lights: twice": (lights([L[0], L[0], L[1]]), "lie in one plane or coincide (condition number"),
    "lights: in one plane": (lights([L[0], [0, 0, -1], [0, 0.5736, -0.8192]]), "(condition number"),
    "lights: behind": (lights([[x, y, -z] for x, y, z in L]), "light 0 is behind the scene"),
    "lights: not unit": (lights((2 * np.array(L)).tolist()), "light direction 0 must be a unit vector, its norm is 2"),
    "lights: NaN": (lights([[np.nan] * 3] * 3), "light direction 0 must be a unit vector, its norm is nan"),
    "lights: huge": (lights([[HUGE, 0, 0]] * 3), "light directions must be numbers"),
    "lights: words": (lights("up"), "light directions must be numbers"),
    "lights: ragged": (lights([L[0], L[1], [1]]), "light directions must be numbers"),
    "lights: none": (lights(None), "light directions must be a list of [x, y, z]"),
    "lights: others": (lights([[x, -y, z] for x, y, z in L]), "was compiled for another sensor: its light"),
    "intensity: negative": (intensities([1, -1, 1]), "the intensity of light 1 must be positive"),
    "intensity: tiny": (intensities([1e-320] * 3), "intensities are relative, near 1"),
    "intensity: apart": (intensities([1, 1e-4, 1]), "the lights' intensities go from 0.0001 to 1"),
    "intensity: huge": (intensities([HUGE] * 3), "light intensities must be numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_scene_is_refused(itree, recognises, scene, paper_tree_file, tmp_path, case):
    spoil, message = SPOILT[case]
    spoil(scene)
    before = sorted(tmp_path.rglob("*"))
    ran = itree("recognize", scene, paper_tree_file, "-o", tmp_path / "r.csv", "--json", tmp_path / "r.json")
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert str(scene) in ran.err
    assert sorted(tmp_path.rglob("*")) == before


NEEDLE_TOO = ["truncated", "all black", "saturated", "NaN", "camera: in m", "lights: twice", "lights: behind"]


@pytest.mark.parametrize("case", NEEDLE_TOO)
def test_so_it_is_by_itree_needle_and_as_a_sensor(itree, scene, tmp_path, case):
    spoil, message = SPOILT[case]
    spoil(scene)
    before = sorted(tmp_path.rglob("*"))
    ran = itree("needle", scene, "-o", tmp_path / "out")
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert sorted(tmp_path.rglob("*")) == before
    if case.startswith(("camera", "lights")):
        ran = itree("compile", "bundled:bracket", "--sensor", scene, "-o", tmp_path / "a.tree")
        assert ran.code == 2
        assert message in ran.err


def test_the_scene_as_it_was_is_not_refused(itree, recognises, scene, paper_tree_file, tmp_path):
    (scene / "scene_camera.json").write_bytes(b"\xef\xbb\xbf" + (scene / "scene_camera.json").read_bytes())
    words = ["recognize", scene, paper_tree_file, "-o", tmp_path / "r.csv", "--quiet"]
    assert itree(*words) == (0, "", "")


def test_eight_bits_without_a_response_are_a_warning(itree, recognises, scene, paper_tree_file, tmp_path):
    every_image(lambda a: np.round(255 * (a / 65535.0) ** (1 / 2.2)).astype(np.uint8))(scene)
    ran = itree("recognize", scene, paper_tree_file, "-o", tmp_path / "r.csv", "--quiet")
    assert (ran.code, ran.out) == (0, "")
    assert ran.err.count("itree: warning: ") == 1
    assert "stored in 8 bits, as cameras store gamma-coded ones" in ran.err
    assert '"response": {"gamma": 2.2}' in ran.err
    ran = itree("needle", scene, "-o", tmp_path / "out", "--quiet")
    assert ran.err.count("itree: warning: ") == 1


SENSORS: dict[str, tuple[Callable[[dict], object], str]] = {
    "no face is detectable": (lambda s: s.update(slant_limit_deg=0.01), "No face of part 'bracket'"),
    "no region is large enough": (lambda s: s.update(smallest_region_mm2=1e9), "smallest region 1000000000.0 mm^2"),
    "distance in m": (lambda s: s.update(working_distance_mm=0.9), "the sensor's field of view of 0.3967 mm"),
    "distance in um": (lambda s: s.update(working_distance_mm=9e5), "under a hundredth of the sensor's field of view"),
    "no electrons": (lambda s: s.update(noise={"full_well_e": 1e-300}), "'noise.full_well_e' must be at least 1"),
    "no response": (lambda s: s.update(response={"gamma": 1e300}), "'response.gamma' must be at most 10"),
    "huge size": (lambda s: s["camera"].update(size=[HUGE, 1]), "'camera.size[0]' must be a finite number"),
    "exposure": (lambda s: s["lights"].update(exposure=[1, 1e9, 1]), "intensities"),
    "near at infinity": (lambda s: s.update(lights={"positions_mm": [[1e308, 1e308, 0]] * 3}), "no place near"),
}  # fmt: skip


@pytest.mark.parametrize("case", SENSORS)
def test_a_sensor_that_cannot_be_is_refused(itree, tmp_path, case):
    spoil, message = SENSORS[case]
    data = sensor_to_json(BENCH)
    spoil(data)
    (tmp_path / "sensor.json").write_text(json.dumps(data))
    ran = itree("compile", "bundled:bracket", "--sensor", tmp_path / "sensor.json", "-o", tmp_path / "a.tree")
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert [p.name for p in tmp_path.iterdir()] == ["sensor.json"]


@pytest.mark.parametrize(("words", "message"), [
    (["compile", "bundled:bracket", "--sensor", "bundled:bench", "-o", "OUT", "--seed", "-1"], "--seed must be 0 or"),
    (["compile", "bundled:bracket", "--sensor", "bundled:bench", "-o", "OUT", "--obj-id", "-1"], "--obj-id must be 0"),
    (["compile", "bundled:bracket", "--sensor", "bundled:bench", "-o", "OUT", "--dome", "0"], "A dome's frequency is"),
    (["compile", "bundled:bracket", "--sensor", "bundled:bench", "-o", "OUT", "--solid", "1"], "is one solid, in mm"),
    (["simulate", "bundled:bracket", "--sensor", "bundled:bench", "--scenes", "1", "--parts", "1", "-o", "OUT",
      "--second-camera", "nan"], "--second-camera must be a distance"),
    (["simulate", "bundled:bracket", "--sensor", "bundled:bench", "--scenes", "1", "--parts", "1", "-o", "OUT",
      "--seed", "-1"], "--seed must be 0 or more"),
    (["clear-bin", "OUT", "-o", "OUT", "--seed", "-1"], "--seed must be 0 or more"),
    (["recognize", "OUT", "OUT", "-o", "OUT", "--picks", "0"], "how many sure poses are enough"),
    (["show", "/proc/none.tree"], "there is no tree file"),
    (["view", "OUT", "OUT"], "there is no such folder of scenes"),
    (["compile", "bundled:bracket", "--sensor", "bundled:bench", "-o", "/proc/a.tree"], "/proc cannot be written to"),
    (["needle", "OUT", "-o", "/proc/needles"], "the folder /proc cannot be written to"),
    (["demo", "-o", "/proc/demo"], "the folder /proc cannot be written to"),
])  # fmt: skip
def test_options_that_cannot_be_are_refused(itree, tmp_path, words, message):
    ran = itree(*[str(tmp_path / "out") if word == "OUT" else word for word in words])
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err
    assert list(tmp_path.iterdir()) == []


TRUTHS: dict[str, tuple[str, str, str]] = {
    "truth: empty": ("test/000042/scene_gt.json", "", "cannot be read as JSON"),
    "truth: a number": ("test/000042/scene_gt.json", '{"0": 3}', "the key '0'"),
    "truth: deep": ("test/000042/scene_gt.json", DEEP, "nested too deeply"),
    "truth: no visibility": ("test/000042/scene_gt_info.json", '{"0": [{}]}', "a visib_fract for each instance"),
    "models: a number": ("models/models_info.json", '{"1": 3}', "'1': 3 is not the number of an object"),
    "models: a name": ("models/models_info.json", '{"bolt": {}}', "'bolt': {} is not the number of an object"),
    "models: no size": ("models/models_info.json", '{"1": {"diameter": -1}}', "needs a diameter in mm, it has -1"),
    "models: symmetry": ("models/models_info.json", '{"1": {"diameter": 1, "symmetries_continuous": [3]}}', "is 3,"),
    "models: no mesh": ("models/obj_000001.ply", "ply", "not a mesh of a solid"),
    "scenes: a number": ("scenes.json", '{"000042": 3}', "each scene's entry must be an object"),
    "scenes: a name": ("scenes.json", '{"first": {}}', "must be named by its number"),
}  # fmt: skip


@pytest.mark.parametrize("case", TRUTHS)
def test_a_spoilt_truth_is_refused(itree, bin_dataset, tmp_path, case):
    name, content, message = TRUTHS[case]
    dataset = shutil.copytree(bin_dataset, tmp_path / "dataset")
    (dataset / name).write_text(content)
    ran = itree("evaluate", dataset, write_results(tmp_path / "r.csv"), "--json")
    assert (ran.code, ran.out) == (2, "")
    assert message in ran.err


def write_results(path: Path, scene: str = "42") -> Path:
    path.write_text(f"scene_id,im_id,obj_id,score,R,t,time\n{scene},0,1,0.5,1 0 0 0 1 0 0 0 1,0 0 900,1\n")
    return path


def test_results_with_numbers_that_no_object_has_are_refused(itree, bin_dataset, tmp_path):
    ran = itree("evaluate", bin_dataset, write_results(tmp_path / "r.csv", "9" * 20))
    assert (ran.code, ran.out) == (2, "")
    assert "row 2, column scene_id: '99999999999999999999' is not a whole number" in ran.err


@pytest.mark.parametrize("content", ["a = " + "[" * 100_000, "x = " + "1" * 5000, "[[["])
def test_a_gripper_that_is_no_toml_is_refused(itree, paper_tree_file, tmp_path, content):
    (tmp_path / "g.toml").write_text(content)
    ran = itree("clear-bin", paper_tree_file, "-o", tmp_path / "out", "--gripper", tmp_path / "g.toml")
    assert (ran.code, ran.out) == (2, "")
    assert "g.toml: this is not TOML" in ran.err
    assert not (tmp_path / "out").exists()
