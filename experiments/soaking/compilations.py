"""Counts what JAX traces and compiles and what Warp loads."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import jax.monitoring
from warp._src.context import Module  # Warp counts loads nowhere in public

TRACED, COMPILED = "/jax/core/compile/jaxpr_trace_duration", "/jax/core/compile/backend_compile_duration"


@dataclass
class Compilations:
    """So many since counting began."""

    traced: int = 0  # functions that JAX traced
    compiled: int = 0  # programs that XLA compiled, or took from the cache on disk
    loaded: int = 0  # modules that Warp compiled, or took from its cache

    @property
    def total(self) -> int:
        return self.traced + self.compiled + self.loaded


@contextmanager
def counted() -> Iterator[Compilations]:
    """Counts while the block runs, in all threads."""
    count, load = Compilations(), Module.load

    def heard(event: str, seconds: float, **more: object) -> None:
        count.traced += event == TRACED
        count.compiled += event == COMPILED

    def counted_load(self: Module, *given: object, **options: object) -> object:
        before = set(map(id, self.execs.values()))
        loaded = load(self, *given, **options)
        count.loaded += loaded is not None and id(loaded) not in before
        return loaded

    jax.monitoring.register_event_duration_secs_listener(heard)
    Module.load = counted_load
    try:
        yield count
    finally:
        Module.load = load
        jax.monitoring.unregister_event_duration_listener(heard)
