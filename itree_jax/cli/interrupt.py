"""Ctrl-C that is heard wherever it falls."""

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

AGAIN_AFTER = 0.5  # [s]: time to clean up after the first one


@contextmanager
def heard_everywhere() -> Iterator[None]:
    """Repeats an interrupt inside the block until the block ends.

    One may be lost: JAX has a callback in the garbage collector, often the first line of Python to run after a long
    call into a library, and what is raised there is dropped; other libraries wrap their optional imports in an `except`
    that catches everything. One that falls into the loading of an extension module waits for the next: many of them
    crash when an exception comes out of their own initialisation. A process that ignores interrupts (started with `&`
    in a script) goes on ignoring them.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (None, signal.SIG_IGN):
        yield
        return
    done, repeater = threading.Event(), threading.Thread(target=lambda: _repeat(done), daemon=True)
    report = sys.unraisablehook

    def on_interrupt(_: int, frame: FrameType | None) -> None:
        if repeater.ident is None:
            repeater.start()
        if not _loads_an_extension(frame):
            raise KeyboardInterrupt

    def hook(unraisable: Any) -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            report(unraisable)

    signal.signal(signal.SIGINT, on_interrupt)
    sys.unraisablehook = hook
    try:
        yield
    except Exception:
        if repeater.ident is not None:  # a library turned the interrupt into an error of its own
            raise KeyboardInterrupt from None
        raise
    finally:
        done.set()
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = report


def _loads_an_extension(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_qualname.startswith("ExtensionFileLoader."):
            return True
        frame = frame.f_back
    return False


def _repeat(done: threading.Event) -> None:
    while not done.wait(AGAIN_AFTER):
        _thread.interrupt_main()
