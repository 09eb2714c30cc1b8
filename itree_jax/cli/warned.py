"""Warnings as a user reads them."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from itree_kernels.errors import ItreeWarning


@contextmanager
def warnings_shown() -> Iterator[None]:
    """Inside the block an `ItreeWarning` is one line on standard error, each only once; others stay as they are."""
    said: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *rest: Any) -> None:
        if not issubclass(category, ItreeWarning):
            before(message, category, *rest)
        elif str(message) not in said:
            said.add(str(message))
            print(f"itree: warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        before = warnings.showwarning
        warnings.simplefilter("always", ItreeWarning)
        warnings.showwarning = show
        yield
