"""Launches on all cores: one Warp launch on the CPU uses one core, but releases the interpreter's lock."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from itertools import pairwise
from typing import Any

RAYS_WORTH_A_THREAD = 4096  # below this a thread costs more than it brings


def launch_in_chunks(
    launch: Callable[[int, int], None], count: int, rays_each: int, device: object, chunks_each: int = 4
) -> None:
    """Calls `launch(first, last)` on ranges that cover `range(count)`, one thread per core on a CPU.

    Every element is computed alone, so the result doesn't depend on the number of threads.
    """
    cores = os.cpu_count() or 1
    threads = min(cores, count, max(1, count * rays_each // RAYS_WORTH_A_THREAD))
    if count == 0:
        return
    if not str(device).startswith("cpu") or threads == 1:
        launch(0, count)
        return
    # several chunks a thread: windows differ in how many of their rays hit
    chunks = min(count, chunks_each * threads)
    bounds = [count * k // chunks for k in range(chunks + 1)]
    launched = [_workers(cores).submit(launch, a, b) for a, b in pairwise(bounds)]
    try:
        for done in launched:
            done.result()
    except BaseException:
        wait_for_all(launched)
        raise


def wait_for_all(launched: Sequence[Future[Any]]) -> None:
    """Cancels what has not begun and waits for what has, however often that is interrupted.

    A kernel in flight writes into arrays that are freed when the exception leaves the function that made them.
    """
    for one in launched:
        one.cancel()
    while not all(one.done() for one in launched):
        with suppress(KeyboardInterrupt):
            wait(launched)


@cache
def _workers(cores: int) -> ThreadPoolExecutor:
    """Threads that wait for work: to start them anew costs as much as a small launch."""
    return ThreadPoolExecutor(cores, thread_name_prefix="kernels")
