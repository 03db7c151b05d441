"""Many pictures over several processes, which end with the program and on ^C."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")

ALONE = 0.4  #: s; work of one process before others are thought of
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  #: read once, at the start
WORTH_IT = 1.5  #: s; starting processes costs about a third of that
ENDED = 5.0  #: s; a process that was told to end is waited for no longer


def map_unordered(
    function: Callable[[T], R], items: Sequence[T], jobs: int | None, crashed: Callable[[T], R]
) -> Iterator[tuple[int, R]]:
    """Apply a function to items, in other processes where there is enough to do.

    Parameters
    ----------
    function : callable
        Importable, as the processes are started afresh.
    jobs : int or None
        Number of processes; None for one per processor.
    crashed : callable
        What stands for the result of an item that kills its process.

    Yields
    ------
    index, result : in the order in which they are done
    """
    jobs = jobs or usable_processors()
    began, index = time.perf_counter(), 0
    for index, item in enumerate(items):
        if jobs > 1 and _worth_others(time.perf_counter() - began, index, len(items)):
            break
        yield index, function(item)
    else:
        return
    rest = range(index, len(items))
    lost = yield from _in_pool(function, items, rest, min(jobs, len(rest)))
    for (
        number
    ) in lost:  # one of these killed its process: each alone, so that the others are not lost with it
        again = yield from _in_pool(function, items, [number], 1)
        if again:
            yield number, crashed(items[number])


def _worth_others(spent: float, done: int, count: int) -> bool:
    """Whether what is left is worth starting other processes, by the time that the first items took."""
    left = spent / max(done, 1) * (count - done)
    return count - done > 1 and spent > ALONE and left > WORTH_IT


def usable_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _in_pool(function: Callable[[T], R], items: Sequence[T], rest: Sequence[int], jobs: int) -> Any:
    """Yield (index, result); return the indices that a broken pool has lost."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _start_worker)
    lost: list[int] = []
    finished = False
    try:
        with _one_thread_each():
            futures: dict[Future, int] = {pool.submit(function, items[i]): i for i in rest}
        for future in as_completed(futures):
            try:
                result = future.result()
            except BrokenProcessPool:
                lost.append(futures[future])
                continue
            yield futures[future], result
        finished = True
    finally:
        pool.shutdown(wait=finished, cancel_futures=True)
        if not finished:  # ^C, or the caller has stopped: nothing is left running
            _end_children(before)
    return sorted(lost)


def _end_children(before: set[Any]) -> None:
    """End the processes that were not there before, and see that they are gone.

    The pool's own thread waits for the same processes: whichever of the two sees the end first, the other may
    for a moment hold a process for alive that is not, so that `join` alone does not tell.
    """
    for child in set(multiprocessing.active_children()) - before:
        child.terminate()
    until = time.monotonic() + ENDED
    while set(multiprocessing.active_children()) - before and time.monotonic() < until:
        time.sleep(0.01)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start meanwhile use one thread each for linear algebra, as they fill the machine."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start_worker() -> None:
    """Leave ^C to the parent, and the processors to the other workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    cv2.setNumThreads(1)
