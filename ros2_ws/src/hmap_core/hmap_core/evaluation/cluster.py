"""A Dask cluster for trials: connecting to it, and what is checked before its first trial."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING

from hmap_core import __version__
from hmap_core.evaluation.table.machine import describe
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.planner import plugins

if TYPE_CHECKING:
    from distributed import Client

CONNECTION_TIMEOUT = 20.0  # s for a scheduler to respond
WORKER_TIMEOUT = 20.0  # s for a first worker after that
POLL = 0.1  # s between two looks for a worker

Wanted = Sequence[tuple[str, str]]  # groups and names of plug-ins that the trials use
OnMachines = Callable[[list[str]], None]


@contextlib.contextmanager
def backend(address: str | None, wanted: Wanted = (), on_machines: OnMachines | None = None) -> Iterator[None]:
    """Selects a Dask cluster as joblib's backend if an address is given.

    Args:
        address: of the scheduler; None for this machine alone.
        wanted: groups and names of the plug-ins that the work uses.
        on_machines: called with the machines of the workers.

    Raises:
        InputError: Dask is not installed, the scheduler does not respond, or a worker cannot do the work.
        PlannerError: SERVICE_UNAVAILABLE; the cluster was lost.
    """
    if address is None:
        yield
        return
    from joblib import parallel_config  # slow to import, and needed by benchmarks only

    with connected(address) as client:
        found = machines(client, address, wanted)
        if on_machines:
            on_machines(found)
        with parallel_config(backend="dask", client=client):
            yield


@contextlib.contextmanager
def connected(address: str) -> Iterator["Client"]:
    """Connects to a Dask scheduler that has workers.

    Raises:
        InputError: Dask is not installed, the scheduler does not respond, or it has no workers.
        PlannerError: SERVICE_UNAVAILABLE; the cluster was lost while it was used.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise InputError("--dask needs Dask, which is not here: pip install 'dask[distributed]'") from error
    try:
        client = Client(address, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at '{address}': {error}") from error
    with client:
        _wait_for_worker(client, address)
        try:
            yield client
        except (KilledWorker, CommClosedError, CancelledError) as error:
            raise PlannerError(
                f"the Dask cluster at '{address}' was lost ({type(error).__name__}: {error}); what it finished is kept "
                "by commands with a log, and the same command resumes",
                Code.SERVICE_UNAVAILABLE,
            ) from error


def machines(client: "Client", address: str, wanted: Wanted) -> list[str]:
    """The machines of all workers, each once, after a check that all can run the trials.

    Args:
        client: of the cluster.
        address: of its scheduler.
        wanted: the plug-ins that the trials use.

    Raises:
        InputError: a worker has another version of hmap, or a plug-in cannot be used there.
    """
    own, found = __version__, list[str]()
    for worker, answer in sorted(client.run(_probe, tuple(wanted), on_error="return").items()):
        place = f"the Dask worker {worker} of '{address}'"
        if isinstance(answer, BaseException):
            raise InputError(f"{place} has no hmap_core {own} ({answer}); install the same version on all hosts")
        machine, version, refused = answer
        if version != own:
            raise InputError(f"{place} has hmap_core {version}, not {own}; install the same version on all hosts")
        if refused:
            raise InputError(f"{place}: {refused}; install it on all hosts")
        found.append(machine)
    return list(dict.fromkeys(found))


def _probe(wanted: Wanted) -> tuple[str, str, str]:
    """Runs on a worker: its machine, its version, and why a plug-in cannot be used there; empty if all can."""
    for group, name in wanted:
        try:
            plugins.create(group, name)
        except InputError as error:
            return describe(), __version__, error.reason
    return describe(), __version__, ""


def _wait_for_worker(client: "Client", address: str) -> None:
    deadline = time.monotonic() + WORKER_TIMEOUT
    while not client.scheduler_info(n_workers=-1)["workers"]:
        if time.monotonic() > deadline:
            raise InputError(
                f"the Dask scheduler at '{address}' has no workers; start some on each host: dask worker {address}"
            )
        time.sleep(POLL)
