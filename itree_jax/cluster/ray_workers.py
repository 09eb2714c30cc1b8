"""Units on a Ray cluster (extra `cluster`; Moritz et al. 2018).

Ray reports nothing to its makers, and its files go to a temporary folder that is removed at the end. A task whose
worker dies is done again by another one.
"""

import os
import secrets
import shutil
import signal
import socket
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from itree_kernels.errors import ItreeError

from itree_jax.cluster.unit import Failed, Outcome, Unit, Work, attempt

LOCAL = "local"
AGAIN = 3  # times that a unit is done again after its worker died: more often, and the unit is what kills them
WAITING = 2  # units per core that are handed over before they are asked for, so that no worker waits
REACHED_IN = 10.0  # [s]: a cluster that does not answer a connection within it is not there
ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",  # Ray reports to its makers unless told not to
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # workers see the GPUs of their machine, as this process does
}


class RayWorkers:
    """The workers of a cluster that this process has joined."""

    def __init__(self, ray: Any, at_once: int | None = None) -> None:
        self.ray = ray
        self.at_once = at_once or WAITING * max(1, int(ray.cluster_resources().get("CPU", 1)))

    def outcomes(self, work: Work, units: Sequence[Unit]) -> Iterator[tuple[Unit, Outcome]]:
        task = self.ray.remote(max_retries=AGAIN, num_cpus=1)(attempt)
        waiting, running = iter(units), {}
        while True:
            while len(running) < self.at_once and (unit := next(waiting, None)) is not None:
                running[task.remote(work, unit.task)] = unit
            if not running:
                return
            ready, _ = self.ray.wait(list(running), num_returns=1)
            for reference in ready:
                yield running.pop(reference), self._outcome(reference)

    def _outcome(self, reference: Any) -> Outcome:
        """An exception of the work itself is an outcome already: what is raised here is the worker's end."""
        try:
            return self.ray.get(reference)
        except self.ray.exceptions.WorkerCrashedError:
            return Outcome(Failed(f"its worker process died {AGAIN + 1} times: out of memory, or killed"))
        except self.ray.exceptions.RayError as error:
            return Outcome(Failed(f"the cluster could not do it: {str(error).strip().splitlines()[-1]}"))


@contextmanager
def ray_workers(address: str, cores: int | None = None) -> Iterator[RayWorkers]:
    """Joins the cluster at `address`, or starts one of `cores` workers (default: all cores) here for "local".

    Raises ItreeError when Ray is not installed, the address can't be reached, or its cluster can't be joined.
    """
    # a token of its own, or Ray would make one and keep it in the user's home
    environment = ENVIRONMENT | ({"RAY_AUTH_TOKEN": secrets.token_hex(32)} if address == LOCAL else {})
    with unless_told(environment):
        ray = _ray()
        if address not in (LOCAL, "auto"):
            check_reachable(address)
        temporary = tempfile.mkdtemp(prefix="itree-ray-")
        here = {"address": LOCAL, "num_cpus": cores, "include_dashboard": False, "_temp_dir": temporary}
        where = here if address == LOCAL else {"address": address}
        try:
            _join(ray, address, where)
            yield RayWorkers(ray)
        finally:
            with undisturbed():
                ray.shutdown()
                shutil.rmtree(temporary, ignore_errors=True)


def _join(ray: Any, address: str, where: dict[str, Any]) -> None:
    try:
        ray.init(**where, logging_level="ERROR", log_to_driver=False)
    except Exception as error:  # Ray raises many kinds
        started = "a local cluster cannot be started" if address == LOCAL else f"--cluster {address}: cannot be joined"
        raise ItreeError(f"{started}: {' '.join(str(error).split())}") from error


@contextmanager
def unless_told(environment: dict[str, str]) -> Iterator[None]:
    """The process's environment with these variables for a block; those that are set already stay."""
    added = {name: value for name, value in environment.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def check_reachable(address: str) -> None:
    """Raises ItreeError unless something listens at HOST:PORT; Ray itself would try for a minute."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():
        raise ItreeError(f"--cluster {address}: give `local`, `auto`, or the HOST:PORT that `ray start --head` printed")
    try:
        socket.create_connection((host, int(port)), REACHED_IN).close()
    except (OSError, OverflowError) as error:
        raise ItreeError(
            f"--cluster {address}: nothing answers there ({error}). Start the cluster (`ray start --head`), or use "
            "`--cluster local`."
        ) from error


@contextmanager
def undisturbed() -> Iterator[None]:
    """A block that Ctrl-C doesn't break off."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.default_int_handler)


def _ray() -> Any:
    try:
        return import_module("ray")
    except ImportError as error:
        raise ItreeError(
            'a cluster needs Ray, which is not installed: pip install "itree-jax[cluster]" (or leave --cluster out)'
        ) from error
