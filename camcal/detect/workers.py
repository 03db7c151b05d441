"""Processing of many pictures in several processes, which end with the program and on Ctrl-C."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from itertools import islice
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from camcal.system.processes import THREADS, start_worker

if TYPE_CHECKING:  # the modules that start processes are imported when the first is started
    from concurrent.futures import Future

T = TypeVar("T")
R = TypeVar("R")

ALONE = 0.4  #: s; time that one process works before others are started
WORTH_IT = 1.5  #: s; least remaining work; starting processes costs about a third of it
AHEAD = 3  #: items per process that are queued or in progress; each may hold a picture
MANY = 10**6  #: stands for an unknown number of items
ENDED = 5.0  #: s; time allowed for a process to end when requested


def map_unordered(
    function: Callable[[T], R],
    items: Iterable[T],
    jobs: int | None,
    crashed: Callable[[T], R],
    count: int | None = None,
) -> Iterator[tuple[int, R]]:
    """Apply a function to items, in other processes if there is enough work.

    Items are taken as they are needed, so that only a few are held at a time.

    Parameters
    ----------
    function : callable
        Must be importable, as the processes are new interpreters.
    items : iterable
    jobs : int or None
        Number of processes; None for one per processor.
    crashed : callable
        Returns the result to use for an item that has killed its process.
    count : int, optional
        Number of items, if `items` has no length.

    Yields
    ------
    index, result : in the order of completion
    """
    jobs = jobs or usable_processors()
    total = count if count is not None else len(items) if isinstance(items, Sized) else MANY
    numbered = enumerate(items)
    began, done = time.perf_counter(), 0
    while not (jobs > 1 and _worth_others(time.perf_counter() - began, done, total)):
        index, item = next(numbered, (-1, None))
        if index < 0:
            return
        yield index, function(item)  # type: ignore[arg-type]
        done = index + 1
    while True:
        lost = yield from _in_pool(function, numbered, min(jobs, max(1, total - done)))
        if lost is None:
            return
        for (
            index,
            item,
        ) in lost:  # one of these killed its process: retried singly, so that no other is lost with it
            again = yield from _in_pool(function, iter([(index, item)]), 1)
            if again is not None:
                yield index, crashed(item)


def _worth_others(spent: float, done: int, count: int) -> bool:
    """Return whether the remaining work justifies other processes, judging by the time of the first items."""
    left = spent / max(done, 1) * (count - done)
    return count - done > 1 and spent > ALONE and left > WORTH_IT


def usable_processors() -> int:
    """The number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _in_pool(function: Callable[[T], R], numbered: Iterator[tuple[int, T]], jobs: int) -> Any:
    """Yield (index, result); return the items lost in a broken pool, or None if all are done."""
    import multiprocessing
    from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
    from concurrent.futures.process import BrokenProcessPool

    before = set(multiprocessing.active_children())
    try:
        pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), start_worker)
    except (ImportError, OSError):  # no shared memory for its locks (/dev/shm): all work is done here
        for index, item in numbered:
            yield index, function(item)
        return None
    running: dict[Future, tuple[int, T]] = {}
    finished = False
    main: bool | None = None
    try:
        while True:
            for index, item in islice(numbered, AHEAD * jobs - len(running)):
                main = _of_main((function, item)) if main is None else main  # all items are of one kind
                with one_thread_each(), contextlib.nullcontext() if main else _without_main():
                    try:
                        running[pool.submit(function, item)] = index, item
                    except BrokenProcessPool:
                        return [*running.values(), (index, item)]
            if not running:
                finished = True
                return None
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                try:
                    result = future.result()
                except BrokenProcessPool:
                    return sorted(running.values(), key=lambda numbered: numbered[0])
                yield running.pop(future)[0], result
    finally:
        pool.shutdown(wait=finished, cancel_futures=True)
        if not finished:  # Ctrl-C, a broken pool, or the caller has stopped: leave nothing running
            _end_children(before)


def _end_children(before: set[Any]) -> None:
    """End the processes that were started since, and wait until they have exited.

    The pool's own thread waits for the same processes. Whichever of the two notices the end first, the other may
    briefly regard a process as alive that has ended, so that `join` alone is not sufficient.
    """
    import multiprocessing

    for child in set(multiprocessing.active_children()) - before:
        child.terminate()
    until = time.monotonic() + ENDED
    while set(multiprocessing.active_children()) - before and time.monotonic() < until:
        time.sleep(0.01)


def _of_main(work: object) -> bool:
    """Return whether the work needs objects that the user's script defines, such as a target of its own class."""
    import pickle

    return b"__main__" in pickle.dumps(work)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Prevent processes that start meanwhile from running the user's script again.

    A new process imports the script that started it. A script that calls camcal at its top level, without checking
    `__name__ == "__main__"`, would search the pictures there as well.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def one_thread_each() -> Iterator[None]:
    """Limit processes that start meanwhile to one thread each for linear algebra, since they fill the machine."""
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
