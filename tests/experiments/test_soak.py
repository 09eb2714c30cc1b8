"""One process, many scenes: after a first pass nothing is traced, compiled or loaded, and answers are the same bits."""

import jax
import jax.numpy as jnp
import warp as wp
from soak import bins, memory_mb, small_sensor
from soaking.compilations import counted
from soaking.digest import digest

from itree_jax.prepared import prepare, prepare_forest
from itree_jax.recognition import recognize_one
from itree_jax.region_measures import REGION_BATCH


@wp.kernel(module="unique", enable_backward=False)
def never_launched(a_out: wp.array(dtype=wp.float32)):
    a_out[wp.tid()] = wp.float32(1.0)


def test_what_is_compiled_or_loaded_is_counted():
    double = jax.jit(lambda x: 2.0 * x + 3.25)
    with counted() as count:
        double(jnp.ones(3, jnp.float32))
        first = (count.traced, count.compiled)
        double(jnp.ones(3, jnp.float32))
        assert (count.traced, count.compiled) == first
        double(jnp.ones(5, jnp.float32))  # another shape
        assert (count.traced > first[0], count.compiled > first[1], count.loaded) == (True, True, 0)
        wp.load_module(never_launched.module, device="cpu", block_dim=1)
        wp.load_module(never_launched.module, device="cpu", block_dim=1)
        assert count.loaded == 1
    total = count.total
    double(jnp.ones(7, jnp.float32))
    assert count.total == total


def test_nothing_is_compiled_after_the_first_pass_and_answers_repeat_to_the_bit(paper_tree):
    forest, scenes = prepare_forest([prepare(paper_tree)]), bins(2, seed=0)
    assert scenes[0].sensor.camera == small_sensor().camera

    def answers(order: list[int]) -> list[str]:
        some = [scenes[k] for k in order]
        return [digest(recognize_one(forest, s.images, s.sensor, s.depth, s.R_w2c)) for s in some]

    first, other = answers([0, 1])
    assert first != other
    with counted() as count:
        assert answers([1, 0]) == [other, first]  # neither follows what it followed before
    assert count.total == 0, count
    assert memory_mb() > 100.0


def test_other_scenes_compile_nothing_after_one(paper_tree):
    """Other seeds, other numbers of parts, and regions that fill other numbers of batches than the warm-up's."""
    forest = prepare_forest([prepare(paper_tree)])
    warm_up, *others = [
        s for seed, parts, scenes in ((0, 3, 1), (1, 2, 1), (2, 1, 2), (3, 3, 1), (4, 4, 1))
        for s in bins(scenes, seed, parts)
    ]  # fmt: skip

    def regions(s) -> int:
        found = recognize_one(forest, s.images, s.sensor, s.depth, s.R_w2c)
        return int(found.labels.max()) + 1

    first = regions(warm_up)
    with counted() as count:
        seen = [regions(s) for s in others]
    batches = {-(-found // REGION_BATCH) for found in seen}
    assert batches - {-(-first // REGION_BATCH)}, (first, seen)
    assert len(batches) > 1, seen
    assert count.total == 0, (count, seen)
