"""Speed, memory and numerical drift of `camcal track`; a part of benchmarks/tracking.py."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import cv2
import numpy as np
from tracking_common import KNOWS_MOTION, cv2_matrix, error, estimator, nees

from camcal.geometry import projective
from camcal.track import ESTIMATORS
from camcal.track.frames import Frame
from camcal.track.simulate import Scene, Truth, simulate

WANTED = {"rls": "2,000", "kalman": "2,000", "iekf": "500"}
#: frames after which 0.98 per frame has forgotten all that a double can hold
FORGOTTEN = 5000


# ------------------------------------------------------------------------------------------ speed
def seconds_per_frame(update: Callable[[Frame], object], frames: list[Frame]) -> float:
    """The median over five stretches, processor time."""
    update(frames[0])
    parts = np.array_split(np.arange(1, len(frames)), 5)
    times = []
    for part in parts:
        start = time.process_time()
        for index in part:
            update(frames[index])
        times.append((time.process_time() - start) / len(part))
    return float(np.median(times))


def speed() -> Iterator[list[str]]:
    """Rows of frames a second: the estimators, cv2, and the whole command."""
    pairs = list(simulate("static", 2500, 0, Scene()))
    frames = [f for f, _ in pairs]
    for method in ESTIMATORS:
        some = frames[:300] if method == "window" else frames
        taken = seconds_per_frame(estimator(method, "static").update, some)  # type: ignore[attr-defined]
        yield [method, f"{1 / taken:,.0f}", WANTED.get(method, "")]
    every = np.ones(50, bool)
    taken = seconds_per_frame(lambda f: cv2_matrix(f, every, pairs[0][1].k), frames[:300])
    yield [f"cv2.calibrateCamera {cv2.__version__}", f"{1 / taken:,.0f}", ""]
    for method in ("rls", "kalman", "iekf"):
        yield [f"`camcal track --method {method}`, file to file", f"{whole(method, frames):,.0f}", ""]


def whole(method: str, frames: list[Frame], count: int = 20_000) -> float:
    """Frames a processor second of the command, start-up included."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "s.csv", Path(folder) / "t.csv"
        with source.open("w") as stream:
            stream.write("frame,X,Y,Z,u,v\n")
            for number in range(count):
                f = frames[number % len(frames)]
                rows = np.c_[f.xyz, f.uv].tolist()
                stream.writelines(f"{number},{','.join(f'{x:.6f}' for x in row)}\n" for row in rows)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "camcal", "track", source, "-o", out, "--method", method, "-q"]
        subprocess.run(list(map(str, command)), check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return count / (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


# ------------------------------------------------------------------------------------------ memory
def through_a_pipe(method: str, count: int) -> list[str]:
    """Feed the command frames through a pipe: its memory on the way, its speed, the error at the end."""
    (_, truth), texts = _texts(500)
    command = [sys.executable, "-m", "camcal", "track", "-", "--method", method, "-q"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None
    answer = _Answer(process.stdout)
    memory = []
    process.stdin.write(b"frame,X,Y,Z,u,v\n")
    for number in range(count):
        rows = texts[number % len(texts)]
        process.stdin.write("".join([f"{number},{row}" for row in rows]).encode())
        if number + 1 in (count // 100, count // 10, count):
            process.stdin.flush()
            memory.append(f"{_memory(process.pid):.1f}")
    process.stdin.close()
    if process.wait():
        raise SystemExit(f"camcal track --method {method} failed")
    answer.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    last = [float(x) for x in answer.tail.split(b"\n")[-2].split(b",")[:13]]
    off = error(np.reshape(last[1:], (3, 4)), truth)
    rows_given = answer.lines - 1  # without the header
    return [method, f"{rows_given:,}", *memory, f"{rows_given / seconds:,.0f}", f"{off:.3f}"]


def _texts(count: int) -> tuple[tuple[Frame, Truth], list[list[str]]]:
    """The rows, after the frame's number, of `count` frames of one standing camera."""
    pairs = list(simulate("static", count, 0, Scene()))
    texts = [
        [f"{','.join(f'{x:.6f}' for x in row)}\n" for row in np.c_[f.xyz, f.uv].tolist()] for f, _ in pairs
    ]
    return pairs[0], texts


class _Answer(threading.Thread):
    """Reads a stream to its end: how many lines, and what stood last."""

    def __init__(self, stream: IO[bytes]):
        super().__init__(daemon=True)
        self.stream, self.lines, self.tail = stream, 0, b""
        self.start()

    def run(self) -> None:
        while data := self.stream.read(1 << 16):
            self.lines += data.count(b"\n")
            self.tail = (self.tail + data)[-20_000:]


def _memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


# ------------------------------------------------------------------------------------------ drift
def drift(method: str, gain: str | None, count: int) -> list[str]:
    """A recursion over many frames against one that starts anew near their end, and against the truth."""
    options: dict[str, object] = {"gain": gain, "sigma": 0.3}
    if method in KNOWS_MOTION:
        options["motion"] = "thermal"
    frame, truth = next(simulate("static", 1, 0, Scene()))
    rng = np.random.default_rng(0)
    clean = projective.project(truth.matrix, frame.xyz)
    long, fresh = (estimator(method, "static", **options) for _ in range(2))
    early = 0.0
    for number in range(count):
        seen = Frame(number, frame.xyz, clean + rng.normal(0, 0.3, clean.shape))
        state = long.update(seen)  # type: ignore[attr-defined]
        if number == 0:  # both normalise by the same frame, so that their numbers mean the same
            fresh.model.settle(seen)  # type: ignore[attr-defined]
            fresh.model.settle = lambda _: None  # type: ignore[attr-defined]
        if number >= count - FORGOTTEN:
            again = fresh.update(seen)  # type: ignore[attr-defined]
        if number == count // 10:
            early = float(np.linalg.norm(state.factor))
    change = float(np.linalg.norm(state.factor)) / early - 1
    apart = again.estimate - state.estimate
    sigmas = np.linalg.solve(state.factor, apart)
    forgets = gain in (None, "forgetting") and method == "rls"
    size = long.model.size  # type: ignore[attr-defined]
    return [
        method + (f", gain {gain}" if gain else ""), f"{count:,}", f"{change:+.1e}",
        f"{np.abs(sigmas).max():.1e}" if forgets else "",
        f"{np.linalg.norm(again.factor - state.factor) / np.linalg.norm(state.factor):.1e}" if forgets else "",
        f"{error(long.model.describe([state.estimate], [state.factor]).matrix[0], truth):.5f}",  # type: ignore
        f"{nees(long, state, truth) / size:.2f}",
    ]  # fmt: skip
