"""Executors of jobs: processes of this machine, or a running Dask cluster, as `concurrent.futures` executors."""

from __future__ import annotations

import contextlib
import multiprocessing
import re
import sys
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.context import BaseContext

from camcal.errors import UsageError
from camcal.system.processes import start_worker

#: s; a cluster that does not answer within this time is not there
CONNECT = 10
#: what Dask takes for an address; of another text its client cannot even be taken down without a traceback
ADDRESS = re.compile(r"[a-z]+://.+|[^/]+:\d+")
#: What a worker needs for its first job. A server process imports it once, and workers are copies of that process that
#: share its memory: one or two start in .9 s of processor time, where each with an import of its own takes .6 s more.
NEEDED = (
    "camcal.batch.work",
    "camcal.plan.calibrate",
    "camcal.data.formats.camcal",
    "camcal.data.points",
    "camcal.report.rig",
    "camcal.report.yaml",
    "camcal.start.zhang",
)
#: how often Dask gives a job to another worker after its worker was lost
RETRIES = 3


class Local:
    """Worker processes with one thread each.

    Parameters
    ----------
    count : int
    """

    lost: tuple[type[BaseException], ...] = (BrokenExecutor,)

    def __init__(self, count: int):
        self.count = count
        self.executor: Executor = self._start()

    def _start(self) -> Executor:
        try:
            return ProcessPoolExecutor(self.count, _context(), start_worker)
        except (ImportError, OSError):  # no shared memory for its locks (/dev/shm): all is done here
            self.count = 1
            return ThreadPoolExecutor(1)

    def restart(self) -> None:
        """Start new processes after one was lost, which breaks the pool."""
        self.close(done=False)
        self.executor = self._start()

    def close(self, done: bool) -> None:
        """End the processes; immediately if the work is not `done`."""
        processes = list((getattr(self.executor, "_processes", None) or {}).values())
        self.executor.shutdown(wait=done, cancel_futures=True)
        if not done:
            for process in processes:
                process.terminate()
            for process in processes:
                process.join(5)
                if process.is_alive():
                    process.kill()


def _context() -> BaseContext:
    """How processes are started: by a server process on Linux.

    Windows has no fork, and the frameworks of macOS do not survive one. The server is reached by a socket in the folder
    of temporary files, the path of which may be too long for one.
    """
    if sys.platform != "linux" or "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(NEEDED))
    from multiprocessing.forkserver import ensure_running

    try:
        ensure_running()
    except OSError:
        return multiprocessing.get_context("spawn")
    return context


class Cluster:
    """A running Dask cluster.

    Parameters
    ----------
    address : str
        Such as tcp://host:8786.

    Raises
    ------
    UsageError
        If dask.distributed is not installed or no scheduler answers at the address.
    """

    def __init__(self, address: str):
        try:
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise UsageError(
                "--scheduler needs dask.distributed, which is not installed.",
                "Try: pip install 'camcal[cluster]'",
            ) from None
        if not ADDRESS.fullmatch(address):
            raise UsageError(f"'{address}' is not the address of a Dask scheduler.", "Try: tcp://HOST:8786")
        try:
            self.client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(
                f"no Dask scheduler answers at '{address}' ({type(error).__name__}).",
                "Start one with: dask scheduler",
            ) from None
        self.lost: tuple[type[BaseException], ...] = (BrokenExecutor, KilledWorker)
        self.executor: Executor = self.client.get_executor(pure=False, retries=RETRIES)

    @property
    def count(self) -> int:
        """The current number of workers, which may vary."""
        return max(1, sum(self.client.nthreads().values()))

    def restart(self) -> None:
        """Do nothing: the cluster recovers by itself."""

    def close(self, done: bool) -> None:
        """Disconnect from the cluster; submitted jobs that are not finished are cancelled."""
        with contextlib.suppress(Exception):
            self.executor.shutdown(wait=done)
        self.client.close(timeout=CONNECT)


def open_pool(scheduler: str | None, count: int) -> Local | Cluster:
    """Processes of this machine, or the cluster at an address."""
    return Local(count) if scheduler is None else Cluster(scheduler)
