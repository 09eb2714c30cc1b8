"""A piece of work that depends on nothing but its inputs, and what comes out of it."""

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from itree_kernels.errors import ItreeError


@dataclass(frozen=True)
class Unit:
    """One part to compile, or one scene to recognise. Everything in it can be sent to another process."""

    name: str  # of its record, unique in its folder
    key: str  # of all that its result depends on, see `key_of`
    task: Any  # what the work is given


@dataclass(frozen=True)
class Product:
    """What a unit gives. The same unit gives the same product."""

    files: dict[str, bytes] = field(repr=False)  # by their names in the folder of the results
    record: dict[str, Any] = field(default_factory=dict)  # plain JSON data, a few lines


@dataclass(frozen=True)
class Failed:
    """Why a unit gives nothing, in words."""

    reason: str


@dataclass(frozen=True)
class Outcome:
    """What became of a unit."""

    result: Product | Failed
    seconds: float = 0.0  # spent on it by the clock
    cpu_seconds: float = 0.0  # of all cores: what other programs on the machine change less


Work = Callable[[Any], Product]


def attempt(work: Work, task: Any) -> Outcome:
    """What the work makes of a task. An error becomes a `Failed`, whatever it is, so that other units go on."""
    start, cpu_start = time.perf_counter(), time.process_time()
    try:
        result = work(task)
    except ItreeError as error:
        result = Failed(str(error))
    except Exception as error:
        where = "".join(traceback.format_tb(error.__traceback__)[-1:]).strip()
        result = Failed(f"a mistake of this program, not of the input: {type(error).__name__}: {error} ({where})")
    return Outcome(result, time.perf_counter() - start, time.process_time() - cpu_start)
