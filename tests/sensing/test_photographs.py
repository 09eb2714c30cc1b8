"""Folders of photographs: order, colour, masks, lights told in other frames, ambient light."""

import cv2
import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.sensing.ambient import subtract_ambient
from itree_jax.sensing.image_file import chunks_fit
from itree_jax.sensing.light_source import light_source
from itree_jax.sensing.needle_files import decoded_normals, encoded_normals
from itree_jax.sensing.needle_input import load_needle_input
from itree_jax.sensing.photographs import photograph_folder, read_mask, read_photograph
from itree_jax.sensing.sensor_file import save_sensor
from itree_jax.sensor import Noise, Sensor

from .conftest import light_ring
from .rendered_spheres import BY_ORTHOGRAPHIC, ORTHOGRAPHIC, mask_of, matte, write_photographs

L = light_ring(4)
RGB = np.array([[0.5, 0.6, 0.7], [0.8, 0.7, 0.6], [0.4, 0.4, 0.4], [0.9, 0.5, 0.7]])
SURFACE = np.array([0.9, 0.5, 0.3])  # red


def diligent_folder(folder):
    """A red sphere under coloured lights, in the layout and the frame of the data set; images listed backwards."""
    shade = matte(BY_ORTHOGRAPHIC, L, np.ones(4))
    write_photographs(folder, shade[:0], mask_of(BY_ORTHOGRAPHIC))
    for k, image in enumerate(shade):
        rgb = image[..., None] * RGB[k] * SURFACE
        cv2.imwrite(str(folder / f"{9 - k:03d}.png"), np.round(65535 * rgb[..., ::-1]).astype(np.uint16))
    (folder / "filenames.txt").write_text("009.png\n008.png\n007.png\n006.png\n")
    np.savetxt(folder / "light_directions.txt", L * [1.0, -1.0, -1.0])
    np.savetxt(folder / "light_intensities.txt", RGB)
    return folder


def test_images_come_in_the_order_of_their_numbers(tmp_path):
    write_photographs(tmp_path / "a", np.zeros((12, 4, 5)), np.ones((4, 5)))
    found = photograph_folder(tmp_path / "a")
    assert [path.name for path in found.images] == [f"photo.{k}.png" for k in range(12)]
    assert found.mask == tmp_path / "a" / "mask.png"


def test_a_list_of_names_gives_the_order(tmp_path):
    found = photograph_folder(diligent_folder(tmp_path / "a"))
    assert [path.name for path in found.images] == ["009.png", "008.png", "007.png", "006.png"]


def test_folders_without_images_or_with_two_masks_are_told(tmp_path):
    with pytest.raises(ItreeError, match="no such folder"):
        photograph_folder(tmp_path / "nowhere")
    with pytest.raises(ItreeError, match="no image is in it"):
        photograph_folder(tmp_path)
    folder = write_photographs(tmp_path / "a", np.zeros((3, 4, 5)), np.ones((4, 5)))
    cv2.imwrite(str(folder / "other_mask.png"), np.zeros((4, 5), np.uint8))
    with pytest.raises(ItreeError, match="several masks"):
        photograph_folder(folder)
    (folder / "other_mask.png").unlink()
    (folder / "filenames.txt").write_text("gone.png")
    with pytest.raises(ItreeError, match=r"gone\.png that it lists is missing"):
        photograph_folder(folder)


def test_a_mask_of_another_size_is_told(tmp_path):
    folder = write_photographs(tmp_path / "a", np.zeros((3, 4, 5)), np.ones((4, 6)))
    with pytest.raises(ItreeError, match=r"mask\.png: the mask is 6 x 4 px, the images are 5 x 4 px"):
        read_mask(folder / "mask.png", (4, 5))


def test_what_becomes_of_colour(tmp_path):
    path = tmp_path / "x.png"
    rgb = np.array([[[100, 50, 10], [255, 60, 20]]], np.uint8)
    cv2.imwrite(str(path), rgb[..., ::-1])
    np.testing.assert_allclose(read_photograph(path, "red"), rgb[..., 0] / 255, rtol=1e-6)
    np.testing.assert_allclose(read_photograph(path, "blue"), rgb[..., 2] / 255, rtol=1e-6)
    mean = read_photograph(path, "mean")
    np.testing.assert_allclose(mean[0, 0], 160 / 3 / 255, rtol=1e-6)
    assert mean[0, 1] == 1.0  # red is saturated
    white = read_photograph(path, "mean", colour_intensity=np.array([2.0, 1.0, 0.5]))
    np.testing.assert_allclose(white[0, 0], np.mean([50, 50, 20]) * (3.5 / 3) / 255, rtol=1e-6)
    with pytest.raises(ItreeError, match="has colour"):
        read_photograph(path, None)


@pytest.mark.parametrize("channel", [None, "green"])
def test_coloured_lights_in_another_frame_are_converted(channel, tmp_path):
    given = load_needle_input(diligent_folder(tmp_path / "a"), channel=channel)
    np.testing.assert_allclose(given.sensor.light_directions, L, atol=1e-7)
    np.testing.assert_array_equal(given.mask, mask_of(BY_ORTHOGRAPHIC))
    albedo = SURFACE.mean() if channel is None else SURFACE[1]
    shown = given.images / given.sensor.light_intensities[:, None, None]
    np.testing.assert_allclose(shown, albedo * matte(BY_ORTHOGRAPHIC, L, np.ones(4)), atol=5e-5)


def test_lights_may_be_a_sensor_and_its_camera_must_fit(tmp_path):
    folder = write_photographs(tmp_path / "a", matte(BY_ORTHOGRAPHIC, L, np.full(4, 0.7)))
    sensor = Sensor(ORTHOGRAPHIC, L, np.ones(4), Noise(bits=9), 0.7, 60.0, 400.0)
    save_sensor(sensor, tmp_path / "sensor.json")
    given = load_needle_input(folder, tmp_path / "sensor.json")
    assert given.sensor.noise == Noise(bits=9)
    assert given.mask.all()
    small = write_photographs(tmp_path / "b", np.zeros((4, 10, 10)))
    with pytest.raises(ItreeError, match="images are 10 x 10 px, the sensor's camera has 320 x 240"):
        load_needle_input(small, tmp_path / "sensor.json")
    with pytest.raises(ItreeError, match="3 images for 4 lights"):
        load_needle_input(write_photographs(tmp_path / "c", np.zeros((3, 10, 10))), tmp_path / "sensor.json")


def test_lights_that_are_not_there_are_told(tmp_path):
    with pytest.raises(ItreeError, match="tells no lights"):
        light_source(tmp_path)
    with pytest.raises(ItreeError, match="no such file"):
        light_source(tmp_path / "lights.json")
    path = tmp_path / "lights.json"
    path.write_text('{"positions_mm": [[0, 0, 1], [0, 1, 1], [1, 0, 1]]}')
    with pytest.raises(ItreeError, match="put them into a sensor JSON"):
        light_source(path)
    path.write_text('{"direction": []}')
    with pytest.raises(ItreeError, match="'direction' is not known here"):
        light_source(path)
    (tmp_path / "light_directions.txt").write_text("0 0 1\n0 1")
    with pytest.raises(ItreeError, match="cannot be read as a table of numbers"):
        light_source(tmp_path)


def test_ambient_light_is_taken_off_again():
    rng = np.random.default_rng(0)
    lit, ambient = rng.uniform(0.0, 0.6, (3, 8, 9)).astype(np.float32), rng.uniform(0.0, 0.2, (8, 9)).astype(np.float32)
    images = lit + ambient
    images[1, 2, 3] = 1.0
    less = subtract_ambient(images, ambient, Noise())
    kept = np.ones(images.shape, bool)
    kept[1, 2, 3] = False
    np.testing.assert_allclose(less[kept], lit[kept], atol=1e-6)
    assert less[1, 2, 3] == 1.0  # saturated, and still known as such
    ambient[5, 5] = images[:, 5, 5] = 1.0
    np.testing.assert_array_equal(subtract_ambient(images, ambient, Noise())[:, 5, 5], 1.0)
    with pytest.raises(ItreeError, match=r"the ambient frame has shape \(7, 9\)"):
        subtract_ambient(images, ambient[:7], Noise())
    with pytest.raises(ItreeError, match="brighter than image"):
        subtract_ambient(images, 0.0 * ambient + 0.9, Noise())


def test_normals_survive_16_bits():
    normals = np.array([[light_ring(7)[k] for k in range(7)]])
    normals[0, 3] = np.nan
    again = decoded_normals(encoded_normals(normals))
    assert np.isnan(again[0, 3]).all()
    np.testing.assert_allclose(again, normals, atol=2e-5)
    np.testing.assert_array_equal(encoded_normals(np.array([[[1.0, 0.0, -1.0]]])), [[[65535, 32768, 0]]])


def test_a_png_is_whole_when_its_chunks_end_with_the_file():
    ok, png = cv2.imencode(".png", np.arange(256, dtype=np.uint16).reshape(16, 16))
    assert ok
    content = png.tobytes()
    assert chunks_fit(content)
    assert chunks_fit(content + b"what a program put behind it")
    assert not any(chunks_fit(content[:size]) for size in range(8, len(content)))
    assert not chunks_fit(content[:33] + b"\xff\xff" + content[35:])  # 4 GB of data, which OpenCV would reserve
