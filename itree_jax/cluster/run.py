"""Doing the units that a folder does not hold yet."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole

from itree_jax.cluster.finished_units import FinishedUnit, FinishedUnits
from itree_jax.cluster.unit import Failed, Unit, Work
from itree_jax.cluster.workers import Workers

FAILURES = "failures.json"
LISTED = 10  # failures told one by one; the file has all
Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class Ran:
    """What a run left behind."""

    done: tuple[FinishedUnit, ...]  # in the order of the units
    resumed: int  # of them finished by an earlier run
    failures: dict[str, str]  # reason by name, in the order of the units

    @property
    def seconds(self) -> float:
        """Spent on the finished units, by earlier runs too, one after the other."""
        return sum(one.seconds for one in self.done)


def run_units(units: Sequence[Unit], work: Work, folder: Path, workers: Workers, tell: Tell) -> Ran:
    """Does every unit that `folder` doesn't hold, keeps each result when it comes, and goes on past failures.

    A run that was stopped, killed or interrupted is gone on with by calling this again. The folder gets `failures.json`
    (reason by name) when there are failures, and loses that of an earlier run otherwise.

    Raises ItreeError when the folder can't be written to, or the cluster is lost.
    """
    check_names(units)
    kept = FinishedUnits(folder)
    done = {unit.name: found for unit in units if (found := kept.finished(unit)) is not None}
    left = [unit for unit in units if unit.name not in done]
    resumed, failures = len(done), {}
    for unit, outcome in workers.outcomes(work, left):
        if isinstance(outcome.result, Failed):
            failures[unit.name] = outcome.result.reason
        else:
            done[unit.name] = kept.keep(unit, outcome.result, outcome)
        tell(f"{len(done)} of {len(units)} done, last {unit.name}", (len(done) + len(failures)) / len(units))
    in_order = {unit.name: failures[unit.name] for unit in units if unit.name in failures}
    if in_order:
        write_whole(folder / FAILURES, (json.dumps(in_order, indent=1) + "\n").encode())
    else:
        (folder / FAILURES).unlink(missing_ok=True)
    return Ran(tuple(done[unit.name] for unit in units if unit.name in done), resumed, in_order)


def check_names(units: Sequence[Unit]) -> None:
    """Raises ItreeError when two units would be kept under one name."""
    seen = set()
    for unit in units:
        if unit.name in seen:
            raise ItreeError(f"there are two of the name {unit.name}: their results could not be told apart")
        seen.add(unit.name)


def check_failures(ran: Ran, of_what: str, folder: Path, more_to_say: str = "") -> None:
    """Raises ItreeError that names what failed and why, if anything did."""
    if not ran.failures:
        return
    every = len(ran.failures) + len(ran.done)
    shown = [f"\n  {name}: {reason}" for name, reason in list(ran.failures.items())[:LISTED]]
    more = len(ran.failures) - len(shown)
    rest = f"\n  and {more} more, see {folder / FAILURES}" if more else ""
    raise ItreeError(
        f"{len(ran.failures)} of {every} {of_what} failed. What the others gave is in {folder}; the same command does "
        f"only the failed ones again. {more_to_say}{''.join(shown)}{rest}"
    )
