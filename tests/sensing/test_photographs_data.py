"""Real photographs of DiLiGenT under 16 lights, against measured normals."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise

REPOSITORY = Path(__file__).resolve().parents[2]
PHOTOGRAPHS = Path(os.environ.get("ITREE_DATA", REPOSITORY.parent / "shared" / "data")) / "photometric"
TO_CAMERA = np.array([1.0, -1.0, -1.0])  # from x right, y up, z toward the viewer
EVERY = 4  # pixels, to be quick

pytestmark = pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason=f"no photographs at {PHOTOGRAPHS} (set ITREE_DATA)")


@pytest.mark.parametrize("name", ["ball", "cat"])
def test_leaving_out_shadows_and_highlights_beats_plain_least_squares(name, angle_between):
    folder = PHOTOGRAPHS / name
    L = np.loadtxt(folder / "light_directions.txt") * TO_CAMERA
    e = np.loadtxt(folder / "light_intensities.txt")
    names = (folder / "filenames.txt").read_text().split()
    colour = np.stack([cv2.imread(str(folder / file), cv2.IMREAD_UNCHANGED)[::EVERY, ::EVERY, ::-1] for file in names])
    images = (colour / 65535.0 / e[:, None, None, :]).mean(-1)
    images /= 1.01 * images.max()
    truth = scipy.io.loadmat(folder / "Normal_gt.mat")["Normal_gt"][::EVERY, ::EVERY] * TO_CAMERA
    mask = cv2.imread(str(folder / "mask.png"), cv2.IMREAD_GRAYSCALE)[::EVERY, ::EVERY] > 0

    needle = photometric_stereo(images.astype(np.float32), L, np.ones(len(L)), Noise())
    there = np.asarray(needle.interpretable) & mask
    plain = np.moveaxis(np.tensordot(np.linalg.pinv(L), images, 1), 0, -1)
    plain /= np.maximum(np.linalg.norm(plain, axis=-1, keepdims=True), 1e-9)
    ours, theirs = (np.degrees(angle_between(n, truth)[there].mean()) for n in (needle.normals, plain))
    assert there.sum() > 0.95 * mask.sum()
    assert ours < 0.85 * theirs
    assert ours < {"ball": 2.5, "cat": 7.5}[name]
