"""Scenes of a batch over several devices: what is computed of each scene alone, each device does of its share.

The needle map of a scene needs no other scene: the axis of scenes is laid over the devices (`jax.sharding`), each of
which runs the compiled single-scene function on its share, one scene after the other, and nothing is exchanged. A
scene's result is the one that a single device gives. (XLA compiles a share's loop by its length, which can change the
last bit of a number: of the needle map's fields, that of `confidence`.)
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from itree_kernels.errors import ItreeError
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float

from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensor import Sensor

SCENES = "scenes"
Tree = TypeVar("Tree")


def sharded_needle_maps(
    images: Float[np.ndarray, "scenes lights height width"], sensor: Sensor,
    devices: Sequence[Any] | None = None,
) -> NeedleMap:
    """Needle maps of a batch of scenes, computed on several devices (default: all that JAX has).

    Arrays of the result have a leading axis of scenes; where the devices divide the scenes evenly, they stay where they
    were computed, a share on each device. `images` are linear, 1.0 = full scale. Raises ItreeError when there is no
    scene, or shapes don't fit the sensor.
    """
    images = np.asarray(images, np.float32)
    expected = (sensor.light_count, sensor.camera.height, sensor.camera.width)
    if images.ndim != 4 or images.shape[1:] != expected or not len(images):
        raise ItreeError(
            f"images have shape {images.shape}; give one scene or more of [lights, height, width] = {list(expected)}"
        )
    return over_devices(lambda one: needle_map(one, sensor), images, devices)


def over_devices(
    of_scene: Callable[[Any], Tree], scenes: Float[np.ndarray, "scenes *rest"],
    devices: Sequence[Any] | None = None,
) -> Tree:
    """`of_scene` of every scene, each device doing its share of them.

    Where the devices don't divide the scenes evenly, the last scene is computed again to fill up. `of_scene` must be a
    function that JAX can compile.
    """
    mesh = Mesh(np.array(devices or jax.devices()), (SCENES,))
    count, each = len(scenes), -(-len(scenes) // mesh.size)
    index = np.minimum(np.arange(each * mesh.size), count - 1)
    placed = jax.device_put(np.asarray(scenes)[index], NamedSharding(mesh, PartitionSpec(SCENES)))
    share = jax.shard_map(
        lambda own: jax.lax.map(of_scene, own), mesh=mesh, in_specs=PartitionSpec(SCENES),
        out_specs=PartitionSpec(SCENES), check_vma=False,
    )  # fmt: skip
    found = jax.jit(share)(placed)
    return found if count == len(index) else jax.tree.map(lambda a: a[:count], found)
