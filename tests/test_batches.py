"""Batches: in their order on any number of cores, few of them in memory, and of few sizes."""

import threading

import numpy as np
import pytest

from itree_jax.batches import filled, groups_of, multiple_above, on_all_cores, power_of_two_above, streamed
from itree_jax.tree import appearances


def test_results_come_in_the_order_of_the_items():
    assert on_all_cores(lambda k: k * k, range(100)) == [k * k for k in range(100)]
    assert on_all_cores(lambda k: k, []) == []


@pytest.mark.parametrize("cores", [1, 3])
def test_items_are_asked_for_only_as_they_are_needed(monkeypatch, cores):
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    asked = []

    def items():
        for k in range(50):
            asked.append(k)
            yield k

    for done, result in enumerate(streamed(lambda k: k, items())):
        assert result == done
        assert len(asked) <= done + cores + 1


def test_an_error_is_raised_in_its_turn_and_the_threads_end():
    before = threading.active_count()
    results = streamed(lambda k: 1 // (k - 5), range(20))
    assert [next(results) for _ in range(5)] == [1 // (k - 5) for k in range(5)]
    with pytest.raises(ZeroDivisionError):
        next(results)
    assert threading.active_count() == before


def test_groups_hold_every_item_once():
    for count in (0, 1, 4, 5, 8):
        groups = list(groups_of(range(count), 4))
        assert [k for group in groups for k in group] == list(range(count))
        assert len(groups) == max(1, -(-count // 4))


def test_filled_arrays_keep_what_they_had():
    array, (other,) = filled((np.arange(3), (np.eye(3),)), 5)
    assert array.tolist() == [0, 1, 2, 2, 2]
    assert np.array_equal(other[:3], np.eye(3))
    assert filled(np.arange(3), 3).tolist() == [0, 1, 2]


def test_sizes_are_few_and_large_enough():
    assert [multiple_above(n, 4) for n in (0, 1, 4, 5)] == [4, 4, 4, 8]
    assert [power_of_two_above(n) for n in (1, 2, 3, 16, 17, 200)] == [1, 2, 4, 16, 32, 256]


def test_windows_are_measured_as_they_are_made(monkeypatch):
    """However many there are, no more than a few batches of pixels are there at once."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(appearances, "BATCH", 8)
    made, measured_so_far, most = 0, 0, 0
    lock = threading.Lock()

    def measure_batch(window, line, needle_std):
        nonlocal measured_so_far, most
        with lock:
            most = max(most, made - measured_so_far)
            measured_so_far += len(window.mask)
        return window.mask.sum(axis=(1, 2))

    def windows():
        nonlocal made
        for k in range(400):
            made += 1
            mask = np.zeros((48, 48), bool)
            mask.flat[:k] = True
            yield appearances.pixels_of(mask, np.ones((48, 48, 3), np.float32), np.zeros((48, 48, 2), np.float32))

    monkeypatch.setattr(appearances, "measure_batch", measure_batch)
    assert appearances.measured(windows(), 1.0, 0.02).tolist() == list(range(400))
    assert most <= 5 * 8
