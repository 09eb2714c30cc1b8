"""Scenes over four devices of one CPU: the numbers are those of one device."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from itree_kernels.errors import ItreeError

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.photometric import needle_map
from itree_jax.sharding import sharded_needle_maps

FOUR_DEVICES = """
import sys
import jax
import numpy as np
from test_sharding import small_sensor, some_scenes
from itree_jax import sharded_needle_maps

assert len(jax.devices()) == 4
found = {}
for count in (1, 6, 8):
    needles = sharded_needle_maps(some_scenes(count), small_sensor())
    if count == 8:
        shards = needles.normals.addressable_shards
        assert len({shard.device for shard in shards}) == 4
        assert {shard.data.shape[0] for shard in shards} == {2}
    found |= {f"{field}_{count}": np.asarray(value) for field, value in needles._asdict().items()}
np.savez(sys.argv[1], **found)
"""


def small_sensor():
    sensor = bundled_sensor("bench")
    return replace(sensor, camera=replace(sensor.camera, width=40, height=32))


def some_scenes(count):
    sensor = small_sensor()
    shape = (count, sensor.light_count, sensor.camera.height, sensor.camera.width)
    return np.random.default_rng(0).uniform(0.0, 0.9, shape).astype(np.float32)


def test_four_devices_give_what_one_gives(tmp_path):
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=4"
    path = os.pathsep.join([os.path.dirname(__file__), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", FOUR_DEVICES, tmp_path / "four.npz"], capture_output=True, text=True, check=False,
        env={**os.environ, "XLA_FLAGS": flags, "PYTHONPATH": path}, timeout=300,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    four = np.load(tmp_path / "four.npz")
    for count in (1, 6, 8):
        one = sharded_needle_maps(some_scenes(count), small_sensor())
        for field, value in one._asdict().items():
            if field == "confidence":  # rounded by how the loop over a share is compiled
                np.testing.assert_allclose(four[f"{field}_{count}"], np.asarray(value), atol=1e-6)
            else:
                np.testing.assert_array_equal(four[f"{field}_{count}"], np.asarray(value), err_msg=field)


def test_a_batch_is_its_scenes_one_by_one():
    scenes, sensor = some_scenes(3), small_sensor()
    batch = sharded_needle_maps(scenes, sensor)
    for k, scene in enumerate(scenes):
        for field, value in needle_map(scene, sensor)._asdict().items():
            own = np.asarray(getattr(batch, field))[k]
            np.testing.assert_allclose(own, np.asarray(value), atol=1e-5, err_msg=field)


@pytest.mark.parametrize("shape", [(0, 3, 32, 40), (3, 32, 40), (2, 4, 32, 40), (2, 3, 40, 32)])
def test_images_that_do_not_fit_the_sensor_are_refused(shape):
    with pytest.raises(ItreeError, match="images have shape"):
        sharded_needle_maps(np.zeros(shape, np.float32), small_sensor())
