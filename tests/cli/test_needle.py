"""`itree needle`: photometric stereo alone, on scene folders, photographs and lights told in several ways."""

import json

import cv2
import numpy as np
import pytest

from itree_jax.sensing.needle_files import decoded_normals

from ..sensing.conftest import light_ring
from ..sensing.rendered_spheres import BY_ORTHOGRAPHIC, degrees_between, mask_of, matte, pixels, write_photographs

L, E = light_ring(4), np.array([0.7, 0.8, 0.9, 0.6])
FILES = {"normals.npy", "albedo.npy", "uncertainty.npy", "mask.png", "normals.png", "needles.png"}


@pytest.fixture
def photographs(tmp_path):
    images = matte(BY_ORTHOGRAPHIC, L, E)
    write_photographs(tmp_path / "images", images, mask_of(BY_ORTHOGRAPHIC))
    lights = {"directions": L.tolist(), "intensities": E.tolist()}
    (tmp_path / "lights.json").write_text(json.dumps(lights))
    return tmp_path


@pytest.mark.parametrize("method", ["robust", "least-squares"])
def test_a_sphere_comes_back_as_files(itree, photographs, method):
    out = photographs / "out"
    words = [photographs / "images", "--lights", photographs / "lights.json", "-o", out]
    ran = itree("needle", *words, "--method", method)
    assert (ran.code, ran.err) == (0, "")
    assert {path.name for path in out.iterdir()} == FILES
    normals, albedo = np.load(out / "normals.npy"), np.load(out / "albedo.npy")
    assert (normals.dtype, normals.shape, albedo.dtype) == (np.float32, (240, 320, 3), np.float32)
    there = cv2.imread(str(out / "mask.png"), cv2.IMREAD_UNCHANGED) > 0
    for values in (normals[..., 0], albedo, np.load(out / "uncertainty.npy")):
        np.testing.assert_array_equal(np.isfinite(values), there)
    assert not there[~mask_of(BY_ORTHOGRAPHIC)].any()
    truth = BY_ORTHOGRAPHIC.at(pixels(BY_ORTHOGRAPHIC.camera))[1]
    lit = np.nan_to_num(-truth[..., 2]) > np.cos(np.radians(40.0))  # within the slant limit
    assert there[lit].all()
    assert degrees_between(normals, truth)[lit].max() < 0.05
    np.testing.assert_allclose(np.linalg.norm(normals[there], axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(albedo[lit], 1.0, rtol=1e-3)
    encoded = cv2.imread(str(out / "normals.png"), cv2.IMREAD_UNCHANGED)
    assert encoded.dtype == np.uint16
    np.testing.assert_allclose(decoded_normals(encoded[..., ::-1])[there], normals[there], atol=3e-5)


def test_a_scene_folder_brings_its_lights(itree, bin_dataset, tmp_path):
    assert itree("needle", bin_dataset / "test" / "000042", "-o", tmp_path / "out").code == 0
    assert np.isfinite(np.load(tmp_path / "out" / "normals.npy")).any()


def test_an_ambient_frame_is_subtracted(itree, photographs):
    lit, ambient = matte(BY_ORTHOGRAPHIC, L, E), np.full((240, 320), 0.08)
    write_photographs(photographs / "lit", np.minimum(lit + ambient, 1.0), mask_of(BY_ORTHOGRAPHIC))
    cv2.imwrite(str(photographs / "dark.png"), np.round(65535 * ambient).astype(np.uint16))
    words = ["needle", photographs / "lit", "--lights", photographs / "lights.json", "-o", photographs / "out"]
    assert itree(*words, "--ambient", photographs / "dark.png").code == 0
    truth = BY_ORTHOGRAPHIC.at(pixels(BY_ORTHOGRAPHIC.camera))[1]
    inside = (np.nan_to_num(truth @ L.T).min(-1) > 0.2) & (lit.max(0) < 0.9)
    assert degrees_between(np.load(photographs / "out" / "normals.npy"), truth)[inside].max() < 0.1


def test_another_material_is_left_out_if_asked(itree, photographs):
    images = matte(BY_ORTHOGRAPHIC, L, E)
    images[:, 90:110, 150:170] *= 0.5
    write_photographs(photographs / "two", images, mask_of(BY_ORTHOGRAPHIC))
    words = ["needle", photographs / "two", "--lights", photographs / "lights.json", "-o", photographs / "out"]
    assert itree(*words).code == 0
    assert np.isfinite(np.load(photographs / "out" / "albedo.npy")[95:105, 155:165]).all()
    assert itree(*words, "--albedo-tolerance", 0.2).code == 0
    assert np.isnan(np.load(photographs / "out" / "albedo.npy")[95:105, 155:165]).all()


def test_errors_are_told_and_nothing_is_written(itree, photographs):
    images, lights, out = photographs / "images", photographs / "lights.json", photographs / "out"
    write_photographs(photographs / "colour", np.zeros((4, 10, 10)))
    for k in range(4):
        colour = np.roll(np.arange(300, dtype=np.uint8), k).reshape(10, 10, 3)
        cv2.imwrite(str(photographs / "colour" / f"photo.{k}.png"), colour)
    write_photographs(photographs / "two", np.zeros((2, 10, 10)))
    write_photographs(photographs / "mask", np.zeros((4, 10, 10)), np.ones((9, 10)))
    wrong = {
        "tells no lights": [images],
        "no such file or folder of lights": [images, "--lights", photographs / "gone.json"],
        "2 images for 4 lights": [photographs / "two", "--lights", lights],
        "has colour": [photographs / "colour", "--lights", lights],
        "the mask is 10 x 9 px": [photographs / "mask", "--lights", lights],
        "no such folder of images": [photographs / "gone", "--lights", lights],
        "cannot be read": [images, "--lights", lights, "--ambient", photographs / "gone.png"],
        "positive share": [images, "--lights", lights, "--albedo-tolerance", "-1"],
        "goes with --method robust": [images, "--albedo-tolerance", "0.2", "--method", "least-squares"],
    }
    for message, words in wrong.items():
        ran = itree("needle", *words, "-o", out)
        assert (ran.code, ran.out) == (2, "")
        assert message in ran.err
        assert not out.exists()
    assert itree("needle", photographs / "colour", "--lights", lights, "-o", out, "--channel", "green").code == 0
