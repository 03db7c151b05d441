"""Signals that end the program, and worker processes that end with it."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

#: the signals that ask a program to end, and exit codes of a shell for them: 128 + number
ENDING = ("SIGTERM", "SIGHUP")


#: environment variables that linear algebra and OpenCV read once, when they are loaded
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_OF_OPENCV = "OPENCV_FOR_THREADS_NUM"


def use_one_thread() -> None:
    """Limit libraries that are not loaded yet, here and in worker processes, to one thread."""
    os.environ.update(dict.fromkeys((*THREADS, _OF_OPENCV), "1"))


def limit_linear_algebra() -> None:
    """Limit linear algebra that is not loaded yet to one thread, unless the user sets another number.

    Its matrices have some ten rows here: a second thread waits in a loop and costs as much processor time again
    (13 pictures of 640 x 480: 3.7 s in place of 6.4 s).
    """
    for name in THREADS:
        os.environ.setdefault(name, "1")


def copies_itself() -> bool:
    """Return whether worker processes can be forked from this one, which takes .01 s instead of .5 s.

    A copy has the thread that made it alone, and what another one had locked stays locked in it: it is safe while this
    process has a single thread, with those of linear algebra and OpenCV counted. On macOS the system's own libraries
    start threads.
    """
    try:
        return sys.platform == "linux" and len(list(Path("/proc/self/task").iterdir())) == 1
    except OSError:
        return False


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Run OpenCV on one thread: with more, some results vary in the last bits from run to run.

    Until it has run on more than one, it also has no threads, so that this process can be copied.
    """
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def collect_seldom() -> None:
    """Search for garbage cycles every 100,000 new objects instead of every 700: they are rare, and imports make none.

    2 % of the processor time of the command on 13 pictures, for a megabyte.
    """
    import gc

    gc.set_threshold(100_000, 20, 20)


#: parameters of glibc's `mallopt`, and their values in bytes: blocks up to the second size come from the heap (the
#: largest that glibc allows, which it reaches by itself once such a block was freed), whose end is returned to the
#: system only when more than the first is free; by default that is twice the largest block so far
_OF_MALLOC = {-1: 64 << 20, -3: 32 << 20}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD of malloc.h


def keep_freed_memory() -> None:
    """Let glibc keep freed memory for the next array: the system clears each page that it hands out again.

    The command on 30 pictures of 2 megapixels has half as many page faults, and takes a twentieth less processor time.
    Other C libraries are left as they are. Called where pictures are read: ctypes takes 4 ms of the start of
    commands that do not load numpy.
    """
    import ctypes

    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "gnu_get_libc_version"):
        for name, value in _OF_MALLOC.items():
            library.mallopt(name, value)


def leave(code: int) -> None:
    """End the program with its exit code, without the interpreter's teardown of modules.

    That takes .09 s for the modules of a calibration, a quarter of their import, and frees what the system frees too.
    Functions registered for the end run; while threads or processes are left, the interpreter's own end waits for them.
    """
    import atexit
    import threading

    from camcal.system.streams import close

    processes = sys.modules.get("multiprocessing")
    if threading.active_count() == 1 and not (processes and processes.active_children()):
        atexit._run_exitfuncs()
        close(sys.stdout, sys.stderr)
        os._exit(code)
    close(sys.stdout, sys.stderr)
    sys.exit(code)


class Terminated(BaseException):
    """The program was asked to terminate; raised in the running code so that it cleans up as on ^C."""

    def __init__(self, number: int):
        super().__init__(number)
        self.exit_code = 128 + number


def end_on_signals() -> None:
    """Raise `Terminated` on SIGTERM and SIGHUP; a second signal ends the program at once."""

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        raise Terminated(number)

    for name in ENDING:
        number = getattr(signal, name, None)
        # what is ignored stays ignored: nohup
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, end)


def start_worker() -> None:
    """Start a worker process: ^C is left to the parent, one thread, and it ends with the parent in every case."""
    import multiprocessing
    import threading

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # a copy of the parent would raise its `Terminated`, which the pool's loop takes for a result
    for name in ENDING:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    collect_seldom()
    keep_freed_memory()
    if "cv2" in sys.modules:
        import cv2

        cv2.setNumThreads(1)
    else:  # it reads this when it is loaded, which a table of points does not need
        os.environ[_OF_OPENCV] = "1"


def _end_with(parent: int) -> None:
    """Wait until the system reports the end of the parent, then exit."""
    from multiprocessing import connection

    connection.wait([parent])
    os._exit(1)
