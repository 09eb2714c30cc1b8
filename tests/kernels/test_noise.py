"""Sensor noise has the mean, variance and levels of its closed form."""

import numpy as np
import pytest
from itree_kernels.errors import ItreeError
from itree_kernels.noise import sensor_noise

COUNT = 200_000


@pytest.mark.parametrize("intensity", [0.02, 0.2, 0.7])
@pytest.mark.parametrize(
    ("full_well_e", "read_noise_e", "bits"), [(12000.0, 6.0, 12), (4000.0, 3.0, 10), (5e5, 40.0, 14)]
)
def test_mean_and_variance(intensity, full_well_e, read_noise_e, bits):
    """Variance = shot + read + quantisation, within five standard errors of the sample."""
    noisy = sensor_noise(np.full(COUNT, intensity), full_well_e, read_noise_e, bits, seed=7).astype(float)
    variance = intensity / full_well_e + (read_noise_e / full_well_e) ** 2 + (2**bits - 1) ** -2 / 12
    assert noisy.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / COUNT))
    assert noisy.mean() == pytest.approx(intensity, abs=5 * np.sqrt(variance / COUNT))


def test_pixels_are_independent():
    noisy = sensor_noise(np.full((2, COUNT), 0.5), 12000.0, 6.0, 12, seed=1).astype(float)
    assert abs(np.corrcoef(noisy)[0, 1]) < 5 / np.sqrt(COUNT)
    assert abs(np.corrcoef(noisy[0, :-1], noisy[0, 1:])[0, 1]) < 5 / np.sqrt(COUNT)


@pytest.mark.parametrize("bits", [1, 8, 12, 16])
def test_levels_and_range(bits):
    noisy = sensor_noise(np.linspace(-0.5, 2.0, 5001), 100.0, 5.0, bits, seed=2)
    assert noisy.dtype == np.float32
    levels = noisy.astype(float) * (2**bits - 1)
    np.testing.assert_allclose(levels, np.round(levels), rtol=0, atol=2.0**bits * 1e-7)
    assert noisy.min() == 0.0
    assert noisy.max() == 1.0
    assert (noisy[np.linspace(-0.5, 2.0, 5001) > 1.8] == 1.0).all()  # saturation, eight standard deviations away


def test_a_perfect_sensor_only_quantises():
    ideal = np.linspace(0.0, 1.0, 1001)
    assert np.abs(sensor_noise(ideal, 1e15, 0.0, 8, seed=0) - ideal).max() <= 0.5 / 255 + 1e-6


def test_the_seed_decides():
    images = np.full((3, 40, 50), 0.4)
    a, b = (sensor_noise(images, 12000.0, 6.0, 12, seed=5) for _ in range(2))
    assert a.tobytes() == b.tobytes()
    assert a.shape == images.shape
    assert a.tobytes() != sensor_noise(images, 12000.0, 6.0, 12, seed=6).tobytes()


@pytest.mark.parametrize(
    "parameters", [(0.0, 6.0, 12), (-1.0, 6.0, 12), (np.nan, 6.0, 12), (1e4, -1.0, 12), (1e4, 6.0, 0)]
)
def test_wrong_parameters(parameters):
    with pytest.raises(ItreeError, match="sensor noise needs"):
        sensor_noise(np.zeros(3), *parameters, seed=0)


def test_images_must_be_finite():
    with pytest.raises(ItreeError, match="not finite"):
        sensor_noise(np.array([0.1, np.nan]), 1e4, 6.0, 12, seed=0)
