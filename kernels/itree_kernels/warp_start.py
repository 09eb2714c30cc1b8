"""Starting Warp, and loading its kernels, without a word on the terminal and one thread at a time."""

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import warp as wp

from itree_kernels.errors import ItreeError

NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"  # not a warning to someone who has no GPU

_warp_lock = threading.RLock()  # Warp loads a module without a lock of its own; two threads at once would load it twice


@contextmanager
def quiet_warp() -> Iterator[None]:
    """Holds back Warp's notices (not its warnings) inside the block. A log level that the user has set is kept."""
    with _warp_lock:
        level = wp.config.log_level
        if level == wp.LOG_INFO:
            wp.config.log_level = wp.LOG_WARNING
        try:
            yield
        finally:
            wp.config.log_level = level


def warp_device(device: str | None = None) -> str:
    """Name of a Warp device, such as "cpu" or "cuda:0"; `None` is Warp's default. Starts Warp.

    Raises ItreeError when this machine has no such device.
    """
    _start_warp()
    try:
        return str(wp.get_device(device))
    except (ValueError, RuntimeError) as error:
        known = ", ".join(str(known_device) for known_device in wp.get_devices())
        raise ItreeError(f"Warp has no device {device!r} on this machine; choose one of: {known}") from error


def load_kernel(kernel: wp.Kernel, device: str) -> None:
    """Compiles (or takes from the cache) and loads the module of `kernel`, so that threads may launch it together."""
    with quiet_warp():
        wp.load_module(kernel.module, device=device, block_dim=1 if device == "cpu" else 256)


@cache
def _start_warp() -> None:
    with quiet_warp(), _without_driver_warning():
        wp.init()


@contextmanager
def _without_driver_warning() -> Iterator[None]:
    """Passes on what the block writes to the process's standard error, but for the lines about a missing driver.

    Warp writes that line from C, out of reach of its log level.
    """
    try:
        stderr = os.dup(2)
    except OSError:  # a process without standard error
        yield
        return
    with tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            held.seek(0)
            for line in held.readlines():
                if NO_DRIVER not in line:
                    os.write(2, line)
