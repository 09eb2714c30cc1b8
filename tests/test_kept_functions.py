"""Programs kept on disk: nothing is traced again, and nothing differs from the plain jitted function."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import sleep
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from itree_jax.kept_functions import FOLDER, KeptFunction, kept, programs_folder


class Inner(NamedTuple):
    total: Float[Array, ""]


class Outer(NamedTuple):
    scaled: Float[Array, "n"]
    inner: Inner
    both: tuple[Float[Array, "n"], ...]


traced: list[str] = []


def scale(x: Float[Array, "n"], by: float = 2.0, name: str = "a") -> Outer:
    traced.append(name)
    return Outer(x * by, Inner(jnp.sum(x)), (x, x + len(name)))


@pytest.fixture
def folder(tmp_path: Path):
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    traced.clear()
    yield tmp_path / FOLDER
    jax.config.update("jax_compilation_cache_dir", before)


def fresh() -> KeptFunction:
    """As another process has it: nothing in memory."""
    return kept("name")(scale)


def test_equals_the_function(folder: Path) -> None:
    x = np.arange(5, dtype=np.float32)
    for function in (fresh(), fresh()):
        found, expected = function(x, 3.0, name="abc"), scale(jnp.asarray(x), 3.0, name="abc")
        assert jax.tree.structure(found) == jax.tree.structure(expected)
        jax.tree.map(np.testing.assert_array_equal, found, expected)


def test_a_fresh_process_traces_nothing(folder: Path) -> None:
    x = np.ones(3, np.float32)
    fresh()(x)
    assert traced == ["a"]
    fresh()(x)
    fresh()(jnp.asarray(x), by=2.0)
    assert len(traced) == 2  # an argument that is left out is another program, an array on the device is not
    again = fresh()
    again(x)
    again(2 * x)
    assert len(traced) == 2


def test_threads_that_ask_at_once_trace_once(folder: Path) -> None:
    """The others wait for the first; unless they did, they would all be tracing while it sleeps."""

    def slow(x: Float[Array, "n"]) -> Float[Array, "n"]:
        traced.append("slow")
        sleep(0.3)
        return 2.0 * x

    function, x = kept()(slow), np.ones(3, np.float32)
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: np.asarray(function(x)), range(3)))
    assert traced == ["slow"]
    np.testing.assert_array_equal(found, np.full((3, 3), 2.0))


@pytest.mark.parametrize(
    "arguments",
    [(np.ones(4, np.float32),), (np.ones(3, np.float64),), (np.ones(3, np.float32), 2), (np.ones(3, np.float32), 2.0)],
)
def test_other_arguments_are_another_program(folder: Path, arguments) -> None:
    fresh()(np.ones(3, np.float32))
    fresh()(*arguments)
    assert len(list(folder.iterdir())) == 2


def test_other_static_arguments_are_another_program(folder: Path) -> None:
    x = np.zeros(2, np.float32)
    assert fresh()(x, name="a").both[1][0] == 1
    assert fresh()(x, name="bb").both[1][0] == 2


def test_a_damaged_program_is_traced_again(folder: Path) -> None:
    x = np.ones(3, np.float32)
    fresh()(x)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    for damaged in (b"", whole[:-7], whole[:100] + b"\0" + whole[101:]):
        path.write_bytes(damaged)
        traced.clear()
        assert fresh()(x).inner.total == 3
        assert traced == ["a"]
        fresh()(x)
        assert len(traced) == 1  # the file is whole again


def test_inside_other_functions_it_is_traced_with_them(folder: Path) -> None:
    function, x = fresh(), jnp.arange(3.0)
    np.testing.assert_array_equal(jax.jit(lambda x: function(x).scaled)(x), 2 * x)
    np.testing.assert_array_equal(jax.vmap(lambda x: function(x).inner.total)(jnp.ones((2, 3))), [3, 3])
    np.testing.assert_array_equal(jax.grad(lambda x: function(x, 5.0).scaled.sum())(x), [5, 5, 5])
    assert not folder.exists()


def test_nothing_is_kept_where_jax_keeps_nothing(folder: Path) -> None:
    jax.config.update("jax_compilation_cache_dir", None)
    assert programs_folder() is None
    assert fresh()(np.ones(3, np.float32)).inner.total == 3
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_costs_only_time(folder: Path) -> None:
    folder.parent.mkdir(exist_ok=True)
    folder.write_text("no folder")
    assert fresh()(np.ones(3, np.float32)).inner.total == 3
