"""Ctrl-C that is heard wherever it falls."""

import _thread
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

AGAIN_AFTER = 0.05  # [s]: long enough to leave the callback


@contextmanager
def heard_everywhere() -> Iterator[None]:
    """Raises a KeyboardInterrupt again that Python dropped.

    JAX has a callback in the garbage collector, which is often the first line of Python to run after a long call into a
    library; an interrupt raised there is reported as "ignored", and the work would go on to its end.
    """
    before = sys.unraisablehook

    def hook(unraisable: Any) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            threading.Timer(AGAIN_AFTER, _thread.interrupt_main).start()
        else:
            before(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
