"""Parts of images: they hold what is shown, and see it where the whole image does."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from itree_kernels.camera import Camera

from itree_jax.sensing.box import Box, box_of, in_image
from itree_jax.sensing.pixel_row import as_map, as_row

HEIGHT, WIDTH = 120, 200
CAMERA = Camera("pinhole", 400.0, 400.0, 99.5, 59.5, WIDTH, HEIGHT)


@given(
    st.lists(st.tuples(st.integers(0, HEIGHT - 1), st.integers(0, WIDTH - 1)), max_size=4), st.sampled_from([0, 7, 32]),
    st.sampled_from([1, 16, 64]),
)
def test_a_box_holds_all_that_is_shown_and_has_one_of_few_sizes(points, around, step):
    shown = np.zeros((HEIGHT, WIDTH), bool)
    shown[tuple(np.array(points, int).reshape(-1, 2).T)] = True
    box = box_of(shown, around, step)
    assert 0 <= box.top < box.bottom <= HEIGHT
    assert 0 <= box.left < box.right <= WIDTH
    for v, u in points:
        assert box.top <= max(v - around, 0)
        assert box.bottom >= min(v + 1 + around, HEIGHT)
        assert box.left <= max(u - around, 0)
        assert box.right >= min(u + 1 + around, WIDTH)
    for size, most in ((box.bottom - box.top, HEIGHT), (box.right - box.left, WIDTH)):
        assert size % step == 0 or size == most
    if not points:
        assert box == Box(0, HEIGHT, 0, WIDTH)
    elif step == 1:
        v, u = np.array(points).T
        assert box.bottom - box.top <= np.ptp(v) + 1 + 2 * around
        assert box.right - box.left <= np.ptp(u) + 1 + 2 * around


def test_a_part_of_an_image_goes_back_to_its_place_and_is_seen_along_the_same_rays():
    box = Box(20, 90, 35, 180)
    image = np.random.default_rng(0).random((HEIGHT, WIDTH))
    again = in_image(box.of(image), box, CAMERA, -1.0)
    inside = np.zeros(image.shape, bool)
    inside[20:90, 35:180] = True
    np.testing.assert_array_equal(again[inside], image[inside])
    assert (again[~inside] == -1.0).all()
    assert box.pixels == inside.sum()
    view = box.seen_by(CAMERA)
    assert (view.height, view.width) == box.of(image).shape
    uv, corner = np.array([[3.0, 5.0], [100.0, 60.0]]), np.array([box.left, box.top])
    np.testing.assert_allclose(view.viewing_ray(uv), CAMERA.viewing_ray(uv + corner))


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 20))
def test_a_row_of_pixels_is_the_same_map(height, width, more):
    maps = np.arange(2 * height * width).reshape(2, height, width)
    row = as_row(maps, height * width + more)
    assert row.shape == (2, 1, height * width + more)
    assert not row[..., height * width :].any()
    np.testing.assert_array_equal(as_map(row, height, width), maps)
