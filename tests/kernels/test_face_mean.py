"""The mean over a face against a plain loop."""

import numpy as np
from itree_kernels.face_mean import face_mean

REACH, ONE_FACE = 2, 0.9


def plain(images, instance, normal):
    out = np.zeros_like(images)
    for i, j in np.ndindex(instance.shape):
        if instance[i, j] >= 0:
            around = np.s_[max(0, i - REACH) : i + REACH + 1, max(0, j - REACH) : j + REACH + 1]
            same = (instance[around] == instance[i, j]) & (normal[around] @ normal[i, j] > ONE_FACE)
            out[:, i, j] = images[:, *around][:, same].mean(axis=1)
    return out


def test_the_mean_is_over_the_same_face_of_the_same_part():
    rng = np.random.default_rng(3)
    images = rng.uniform(size=(2, 9, 11)).astype(np.float32)
    instance = rng.integers(-1, 2, size=(9, 11)).astype(np.int16)
    axes = np.eye(3, dtype=np.float32)
    normal = axes[rng.integers(0, 3, size=(9, 11))]
    found = face_mean(images, instance, normal, REACH, ONE_FACE)
    np.testing.assert_allclose(found, plain(images, instance, normal), atol=1e-6)


def test_one_pixel_of_its_kind_keeps_its_value():
    images = np.full((1, 3, 3), 0.5, np.float32)
    images[0, 1, 1] = 1.0
    instance = np.zeros((3, 3), np.int16)
    instance[1, 1] = 1
    found = face_mean(images, instance, np.tile(np.float32([0, 0, -1]), (3, 3, 1)), 1, 0.5)
    np.testing.assert_array_equal(found, images)
