"""Batches on all cores: a compiled function runs on one core of a CPU, but releases the interpreter's lock."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

import jax
import numpy as np

Item = TypeVar("Item")
Result = TypeVar("Result")
Other = TypeVar("Other")


def on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """`[function(item) for item in items]`, several at a time; in their order, whatever the number of cores.

    An error of one is raised when its turn comes. Items must not share a random generator.
    """
    return list(streamed(function, items))


def at_once(first: Callable[[], Result], second: Callable[[], Other]) -> tuple[Result, Other]:
    """The results of two computations that don't wait for each other."""
    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(second)
        return first(), beside.result()


def streamed(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """The same one after the other: no more results than cores wait to be taken, and items are asked for as late."""
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as pool:
        running: deque[Future[Result]] = deque()
        for item in items:
            running.append(pool.submit(function, item))
            if len(running) > cores:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()


def groups_of(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Lists of `size` items in their order, the last one shorter; one empty list where there are no items."""
    rest = iter(items)
    group = list(islice(rest, size))
    yield group
    while group := list(islice(rest, size)):
        yield group


def filled(arrays: Item, size: int) -> Item:
    """Arrays of one leading axis, filled up to `size` with their last entry: a function compiled for a few sizes."""

    def fill(array: np.ndarray) -> np.ndarray:
        return np.asarray(array)[np.minimum(np.arange(size), len(array) - 1)]

    return jax.tree.map(fill, arrays)


def multiple_above(count: int, step: int) -> int:
    """The least multiple of `step` that is no smaller than `count`, and than `step`."""
    return step * max(1, -(-count // step))


def power_of_two_above(count: int) -> int:
    """The least power of two that is no smaller."""
    return 1 << max(count - 1, 0).bit_length()
