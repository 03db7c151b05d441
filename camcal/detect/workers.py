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

from camcal.system.processes import THREADS, copies_itself, start_worker

if TYPE_CHECKING:  # the modules that start processes are imported when the first is started
    from concurrent.futures import Future, ProcessPoolExecutor

T = TypeVar("T")
R = TypeVar("R")

#: s; time that one process works before new interpreters are started, and least remaining work for them; their start
#: takes about a third of it
ALONE, WORTH_IT = 0.4, 1.5
#: s; the same for copies of this process, whose start takes .01 to .02 s
ALONE_BEFORE_COPIES, WORTH_COPIES = 0.02, 0.06
AHEAD = 3  #: items per process that are queued or in progress; each may hold a picture
MANY = 10**6  #: stands for an unknown number of items
ENDED = 5.0  #: s; time allowed for a process to end when requested


class Workers:
    """The processes of one search, or of a second pass over its pictures; they are started when there is enough work.

    A context: outside it none are started, as they would be left running.

    Parameters
    ----------
    jobs : int or None
        Number of processes; None for one per processor.
    waiting : callable, optional
        Called once, when other processes have begun to work and this one would wait for them.
    """

    def __init__(self, jobs: int | None, waiting: Callable[[], None] | None = None):
        self.jobs = jobs or usable_processors()
        self.waiting = waiting
        self.seconds, self.items = 0.0, 0  # what this process has spent on how many items
        self._pool: ProcessPoolExecutor | None = None
        self._open = self._busy = False
        self._before: set[Any] = set()

    def __enter__(self) -> Workers:
        self._open = True
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        """End the processes: at once if they have work left, on Ctrl-C for example."""
        self._open = False
        self._end(not self._busy)

    def map_unordered(
        self,
        function: Callable[[T], R],
        items: Iterable[T],
        crashed: Callable[[T], R],
        count: int | None = None,
    ) -> Iterator[tuple[int, R]]:
        """Apply a function to items, in other processes if there is enough work.

        Items are taken as they are needed, so that only a few are held at a time.

        Parameters
        ----------
        function : callable
            Must be importable, as the processes may be new interpreters.
        items : iterable
        crashed : callable
            Returns the result to use for an item that has killed its process.
        count : int, optional
            Number of items, if `items` has no length.

        Yields
        ------
        index, result : in the order of completion
        """
        total = count if count is not None else len(items) if isinstance(items, Sized) else MANY
        numbered, done = enumerate(items), 0
        while not self._worth_others(total - done):
            index, item = next(numbered, (-1, None))
            if index < 0:
                return
            began = time.perf_counter()
            result = function(item)  # type: ignore[arg-type]
            self.seconds, self.items = self.seconds + time.perf_counter() - began, self.items + 1
            yield index, result
            done = index + 1
        while True:
            lost = yield from self._in_pool(function, numbered)
            if lost is None:
                return
            for index, item in lost:
                # one of these killed its process: retried singly, so that no other is lost with it
                with Workers(1) as single:
                    again = yield from single._in_pool(function, iter([(index, item)]))
                if again is not None:
                    yield index, crashed(item)

    def _worth_others(self, left: int) -> bool:
        """Return whether the remaining items justify other processes, judging by the time of the first ones."""
        if not self._open or self.jobs < 2 or left < 2:
            return False
        if self._pool is not None:
            return True
        alone, least = (ALONE_BEFORE_COPIES, WORTH_COPIES) if copies_itself() else (ALONE, WORTH_IT)
        return self.seconds > alone and self.seconds / max(self.items, 1) * left > least

    def _started(self) -> ProcessPoolExecutor | None:
        """The pool of processes, started if there is none yet; None if the system does not provide its locks."""
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        if self._pool is None:
            self._before = set(multiprocessing.active_children())
            method = "fork" if copies_itself() else "spawn"
            try:
                self._pool = ProcessPoolExecutor(self.jobs, multiprocessing.get_context(method), start_worker)
            except (ImportError, OSError):  # /dev/shm is missing
                return None
        return self._pool

    def _in_pool(self, function: Callable[[T], R], numbered: Iterator[tuple[int, T]]) -> Any:
        """Yield (index, result); return the items lost in a broken pool, or None if all are done."""
        from concurrent.futures import FIRST_COMPLETED, wait
        from concurrent.futures.process import BrokenProcessPool

        pool = self._started()
        if pool is None:  # all work is done here
            for index, item in numbered:
                yield index, function(item)
            return None
        running: dict[Future, tuple[int, T]] = {}
        main: bool | None = None
        self._busy = True
        try:
            while True:
                for index, item in islice(numbered, AHEAD * self.jobs - len(running)):
                    main = _of_main((function, item)) if main is None else main  # all items are of one kind
                    with one_thread_each(), contextlib.nullcontext() if main else _without_main():
                        try:
                            running[pool.submit(function, item)] = index, item
                        except BrokenProcessPool:
                            return [*running.values(), (index, item)]
                if not running:
                    self._busy = False
                    return None
                self._wait()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        return sorted(running.values(), key=lambda numbered: numbered[0])
                    yield running.pop(future)[0], result
        finally:
            if self._busy:  # Ctrl-C, a broken pool, or the caller has stopped: leave nothing running
                self._end(False)

    def _wait(self) -> None:
        """Use the first wait for other processes."""
        waiting, self.waiting = self.waiting, None
        if waiting is not None:
            waiting()

    def _end(self, finished: bool) -> None:
        pool, self._pool, self._busy = self._pool, None, False
        if pool is None:
            return
        thread = getattr(pool, "_executor_manager_thread", None)
        pool.shutdown(wait=finished, cancel_futures=True)
        if not finished:
            _end_children(self._before)
            if thread is not None:  # the interpreter's end would use what this thread is about to close
                thread.join(ENDED)


def usable_processors() -> int:
    """The number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    """Limit processes that start meanwhile to one thread each for linear algebra, since they use all processors."""
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
