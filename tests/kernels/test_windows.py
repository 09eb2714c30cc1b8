"""Windows cast by one thread each, as on a CPU, and pixel by pixel and row by row, as on a GPU, are the same."""

import numpy as np
import pytest
import warp as wp
from itree_kernels.windows import Rays, Windows, cast_kernel, contour_kernel, window_kernel, windows

from .solids import ORTHOGRAPHIC, PINHOLE, random_poses, small_solids

SIZE, STRIDE, COUNT = 32, 2, 4
MESH = small_solids()["torus"]
REACH = float(np.linalg.norm(MESH.vertices, axis=1).max())
NAMES = ("depth", "triangle", "contour_uv", "contour_depth")


def empty_windows() -> Windows:
    R, t = random_poses(COUNT, seed=5)
    seen = windows(R, t, np.zeros((COUNT, 2)), SIZE, STRIDE, "cpu")
    seen.clear_contours()
    for array in (seen.depth, seen.triangle):
        array.fill_(-7)
    return seen


@pytest.mark.parametrize("camera", [PINHOLE, ORTHOGRAPHIC])
@pytest.mark.parametrize("crease", [None, 0.3])
def test_window_by_window_is_pixel_by_pixel(camera, crease):
    rays = Rays(MESH, camera, REACH, 2.0, crease)
    whole, parts = empty_windows(), empty_windows()
    for seen in (whole, parts):
        seen.stale.numpy()[1] = 0  # stays as it is
    how = rays.into(whole)
    how.fills = 0
    wp.launch(cast_kernel, dim=COUNT, inputs=[how, 0, wp.empty(0, dtype=wp.vec3)], outputs=[whole.arrays], device="cpu")
    wp.launch(window_kernel, dim=(COUNT, SIZE, SIZE), inputs=[how, 0], outputs=[parts.arrays], device="cpu")
    wp.launch(contour_kernel, dim=(COUNT, SIZE), inputs=[how, 0], outputs=[parts.arrays], device="cpu")
    for name in NAMES:
        np.testing.assert_array_equal(getattr(whole, name).numpy(), getattr(parts, name).numpy())
    there = whole.contour_depth.numpy() > 0.0
    assert there.any(axis=(1, 2, 3)).tolist() == [True, False, True, True]
    assert (whole.depth.numpy()[1] == -7.0).all()
    columns = whole.contour_column.numpy()
    for h, side, i in np.argwhere(there.any(axis=-1)):
        listed = columns[h, side, i, : int(np.argmax(columns[h, side, i] < 0))]
        assert listed.tolist() == np.flatnonzero(there[h, side, i]).tolist()


@pytest.mark.parametrize("halfway", [False, True])
def test_what_is_told_once_serves_every_launch(halfway):
    rays = Rays(MESH, PINHOLE, REACH, 2.0, None, halfway)
    one, other = empty_windows(), empty_windows()
    rays.cast_all(one)
    rays.load()
    for k in range(COUNT):
        rays.cast(other, k, k + 1)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(one, name).numpy(), getattr(other, name).numpy())
