"""Launches on several threads: all of them, and none left behind."""

import threading
import time

import pytest
from itree_kernels import threads
from itree_kernels.threads import RAYS_WORTH_A_THREAD, launch_in_chunks


@pytest.mark.parametrize("count", [0, 1, 7, 1000])
def test_every_element_is_launched_once(count):
    seen, lock = [], threading.Lock()

    def launch(first, last):
        with lock:
            seen.extend(range(first, last))

    launch_in_chunks(launch, count, RAYS_WORTH_A_THREAD, "cpu")
    assert sorted(seen) == list(range(count))


def test_no_launch_is_in_flight_when_an_interrupt_leaves(monkeypatch):
    """However often it is repeated: the arrays that a launch writes into are freed then."""
    running, waits = [], []
    wait = threads.wait

    def launch(first, last):
        running.append(first)
        time.sleep(0.05)
        running.remove(first)
        if first == 0:
            raise KeyboardInterrupt

    def interrupted(launched):
        waits.append(len(launched))
        if len(waits) < 3:
            raise KeyboardInterrupt
        return wait(launched)

    monkeypatch.setattr(threads, "wait", interrupted)
    monkeypatch.setattr(threads.os, "cpu_count", lambda: 4)
    with pytest.raises(KeyboardInterrupt):
        launch_in_chunks(launch, 64, RAYS_WORTH_A_THREAD, "cpu")
    assert running == []
    assert len(waits) >= 3
