"""Runs command lines in forks of a process that has loaded everything, with a fault at the N-th access to the disk.

An access is what changes the disk: opening a file for writing, making a folder, each write, sync, rename, link,
removal. Requests and answers are lines of JSON on stdin and stdout.
"""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import stat
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

LONGEST = 120.0  #: s; a run that takes longer hangs
ROOM = 8 << 30  #: bytes of address space of a run: what asks for more is refused, not taken from the machine
EVENTS = ("os.rename", "os.link", "os.remove", "os.mkdir", "os.truncate")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
#: reading, devices and anonymous files of libraries are no accesses to the disk
PLAIN = ("/dev/", "/proc/", "/sys/")


class Fault:
    """Counts accesses below a folder; at the one numbered `at` something happens."""

    def __init__(self, folder: str, kind: str, at: int):
        self.folder, self.kind, self.at, self.count, self.armed = folder, kind, at, 0, True

    def access(self, path: Any = None) -> None:
        if not self.armed:
            return
        self.count += 1
        if self.kind == "full" and self.count >= self.at > 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        if self.count != self.at:
            return
        if self.kind == "EIO":
            raise OSError(errno.EIO, os.strerror(errno.EIO), path)
        if self.kind == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.kind == "terminate":
            from camcal.system.processes import Terminated

            raise Terminated(signal.SIGTERM)

    def hook(self, event: str, args: tuple) -> None:
        """An audit hook (PEP 578): what it raises stops the access."""
        if event == "open":
            path, mode, flags = args
            changes = isinstance(flags, int) and flags & WRITING
            changes = changes or (isinstance(mode, str) and any(c in mode for c in "wax+"))
            if changes and isinstance(path, (str, bytes, os.PathLike)):
                self._below(os.fsdecode(path))
        elif event in EVENTS and not (event == "os.remove" and self.kind == "full"):
            self._below(os.fsdecode(args[0]) if isinstance(args[0], (str, bytes, os.PathLike)) else "")

    def _below(self, path: str) -> None:
        if os.path.abspath(path).startswith(self.folder):  # noqa: PTH100
            self.access(path)


def _child(request: dict[str, Any], out: Any) -> int:
    os.chdir(request["folder"])
    resource.setrlimit(resource.RLIMIT_AS, (ROOM, ROOM))
    fault = Fault(request["folder"], request["kind"], request["at"])
    for name in ("write", "fsync"):
        original = getattr(os, name)

        def counted(handle: int, *args: Any, original: Any = original) -> Any:
            if handle > 2 and stat.S_ISREG(os.fstat(handle).st_mode):
                fault.access()
            return original(handle, *args)

        setattr(os, name, counted)
    sys.addaudithook(fault.hook)
    from camcal.cli.boundary import run

    code = run(["-q", *request["args"]])
    fault.armed = False
    sys.stdout.flush()
    sys.stderr.flush()
    os.pwrite(out, str(fault.count).encode(), 0)
    return code


def serve(request: dict[str, Any]) -> dict[str, Any]:
    """Run one command line; its exit code (or minus the signal), its number of accesses, what it said."""
    with tempfile.TemporaryFile() as count, tempfile.TemporaryFile() as said:
        pid = os.fork()
        if pid == 0:
            try:
                os.dup2(said.fileno(), 1)
                os.dup2(said.fileno(), 2)
                code = _child(request, count.fileno())
            except BaseException as error:  # noqa: BLE001
                os.write(2, f"Traceback: {type(error).__name__}: {error}".encode())
                code = 70
            os._exit(code)
        until = time.monotonic() + LONGEST
        done = 0
        while not done and time.monotonic() < until:
            done, status = os.waitpid(pid, os.WNOHANG)
            time.sleep(0.002)
        if not done:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return {"code": "hangs", "count": 0, "said": ""}
        said.seek(0)
        count.seek(0)
        number = int(count.read() or b"0")
        text = said.read().decode("utf-8", "replace")
        return {"code": os.waitstatus_to_exitcode(status), "count": number, "said": text}


def main() -> None:
    """Answer requests until stdin ends."""
    import cv2
    import scipy.optimize
    import scipy.sparse.linalg  # noqa: F401

    cv2.setNumThreads(1)
    for module in ("matplotlib.figure", "matplotlib.backends.backend_agg", "jinja2", "yaml", "rich.console"):
        try:
            __import__(module)
        except ImportError:
            continue
    for line in sys.stdin:
        print(json.dumps(serve(json.loads(line))), flush=True)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    main()
