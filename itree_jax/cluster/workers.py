"""Who does the work: this process, or the workers of a Ray cluster."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol

from itree_jax.cluster.unit import Outcome, Unit, Work, attempt


class Workers(Protocol):
    """Does units and gives their outcomes as they come, in any order."""

    def outcomes(self, work: Work, units: Sequence[Unit]) -> Iterator[tuple[Unit, Outcome]]: ...


class ThisMachine:
    """One unit after the other, in this process."""

    def outcomes(self, work: Work, units: Sequence[Unit]) -> Iterator[tuple[Unit, Outcome]]:
        for unit in units:
            yield unit, attempt(work, unit.task)


def workers_at(address: str | None) -> AbstractContextManager[Workers]:
    """The workers of a cluster for the time of a block: "local" starts one on this machine for as long, None is this
    process, else the address is Ray's (`HOST:PORT`, or "auto" for the cluster that this machine belongs to).

    Raises ItreeError when Ray is not installed or there is no such cluster.
    """
    if address is None:
        return nullcontext(ThisMachine())
    from itree_jax.cluster.ray_workers import ray_workers

    return ray_workers(address)
