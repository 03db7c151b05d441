"""How the cost grows with views, points, pixels and parameters: seconds of processor time, and exponents.

    python benchmarks/growth.py [--only views points pixels parameters memory large] [--runs 3] [--quick]
                                [--update PAGE]

A row is one quantity with all others held: calibrations of simulated boards (9x6, but for `points`) with all checks and
without, pictures of a board in front of clutter (`detect.py`) read from a JPEG and searched. The exponent is the slope
of log seconds against log size over the three largest sizes, where fixed costs no longer hide it; 1 is linear.
Processor time is the least of `--runs`, one thread of linear algebra. `memory` is what 2,000 views of 400 points add to
the peak of a process that holds the data; `large` is the peak of the command on 100 pictures of 48 megapixels, 4 that
are rendered smaller and enlarged, and copies of them, with one process (`--jobs 1`).
"""

from __future__ import annotations

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from detect import camcal_finds, scene
from refine import peak_memory, simulate
from tables import markdown, update
from whole import spent, tool

import camcal
from camcal.detect.sources import read_gray
from camcal.model import lenses

VIEWS = (10, 50, 200, 1000, 5000)
POINTS = ((9, 6), (20, 10), (25, 20), (50, 40))
MEGAPIXELS = (0.3, 2, 12, 48)
MODELS = ("pinhole", "opencv5", "spline:6x4", "spline:10x8", "spline:16x12", "spline:18x13")
#: views, where points and parameters grow
SOME = 20


def seconds(work: Callable[[], object], runs: int) -> float:
    """The least processor time of some runs; of work that takes more than ten seconds one is enough."""
    least = np.inf
    for _ in range(runs):
        begin = time.process_time()
        work()
        least = min(least, time.process_time() - begin)
        if least > 10:
            break
    return float(least)


def calibrations(sizes: list, data_of: Callable, models: list[str], checks: bool, runs: int) -> list[float]:
    found = []
    for size, model in zip(sizes, models, strict=True):
        data = data_of(size)
        found.append(seconds(lambda d=data, m=model: camcal.calibrate(d, model=m, checks=checks), runs))
    return found


def rows(only: list[str], runs: int, quick: bool) -> Iterator[tuple[str, list[float], list[float]]]:
    """Name, sizes and seconds of each row."""
    cut = slice(0, -1) if quick else slice(None)
    if "views" in only:
        sizes = list(VIEWS[cut])
        for checks in (False, True):
            found = calibrations(sizes, lambda v: simulate(v, 9, 6), ["opencv5"] * len(sizes), checks, runs)
            yield f"views of 54 points, {'with' if checks else 'without'} checks", sizes, found
    if "points" in only:
        boards = list(POINTS[cut])
        for checks in (False, True):
            found = calibrations(
                boards, lambda b: simulate(SOME, *b), ["opencv5"] * len(boards), checks, runs
            )
            yield (
                f"points a view, {SOME} views, {'with' if checks else 'without'} checks",
                [c * r for c, r in boards],
                found,
            )
    if "pixels" in only:
        sizes = list(MEGAPIXELS[cut])
        reading, searching = [], []
        with tempfile.TemporaryDirectory() as folder:
            for size in sizes:
                path = Path(folder) / f"{size}.jpg"
                gray = scene(1, size, board=True)
                cv2.imwrite(str(path), gray)
                reading.append(seconds(lambda p=path: read_gray(p), runs))
                searching.append(seconds(lambda g=gray: camcal_finds(g, (9, 6)), runs))
        yield "megapixels, read", sizes, reading
        yield "megapixels, searched for a 9x6 board and its corners fitted", sizes, searching
    if "parameters" in only:
        models = list(MODELS[cut])
        sizes = [lenses.make(m).size for m in models]
        data = simulate(SOME, 25, 20)
        found = calibrations(sizes, lambda _: data, models, False, runs)
        yield f"parameters, {SOME} views of 500 points", sizes, found


def large(rendered: int = 4, count: int = 100) -> tuple[float, float]:
    """Processor time, s, and peak of memory, MB, of the command on pictures of 48 megapixels.

    They are rendered with 3 megapixels and enlarged.
    """
    with tempfile.TemporaryDirectory() as name:
        made, folder = Path(name) / "made", Path(name) / "pictures"
        words = ("simulate", "images", "--target", "checkerboard:9x6:25mm", "--views", rendered, "-o", made)
        camera = ("--image-size", "2000x1500", "--set", "fx=1665,fy=1669,cx=1000,cy=750", "--type", "png")
        subprocess.run(tool(*words, *camera, "--blur", 1, "-q"), check=True)
        folder.mkdir()
        pictures = sorted(made.glob("*.png"))
        for picture in pictures:
            gray = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
            large = cv2.resize(gray, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
            cv2.imwrite(str(picture.with_suffix(".jpg")), large)
        for i in range(count):
            data = pictures[i % rendered].with_suffix(".jpg").read_bytes()
            (folder / f"{i:03d}.jpg").write_bytes(data + bytes(i // rendered))  # each with a hash of its own
        return spent(
            tool("checkerboard", folder, "-o", Path(name) / "r.yaml", "-q", "--jobs", 1, "--no-cache")
        )


def exponent(sizes: list[float], found: list[float]) -> float:
    """The slope over the three largest sizes."""
    return float(np.polyfit(np.log(sizes[-3:]), np.log(found[-3:]), 1)[0])


def main() -> None:
    every = ["views", "points", "pixels", "parameters", "memory", "large"]
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=every, default=every)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="without the largest size of each row")
    parser.add_argument("--update", type=Path)
    told = parser.parse_args()
    cv2.setNumThreads(1)
    table: list[tuple[object, ...]] = []
    for name, sizes, found in rows(told.only, told.runs, told.quick):
        shown = ", ".join(f"{s:g}: {t:.3g}" for s, t in zip(sizes, found, strict=True))
        table.append((name, shown, f"{exponent(sizes, found):.2f}"))
        print(*table[-1], flush=True)
    if "memory" in told.only:
        table.append(
            (
                "MB that 2000 views of 400 points add, without checks and with",
                ", ".join(
                    f"{peak_memory(which, (2000, 20, 20), 'opencv5'):.0f}" for which in ("camcal", "checked")
                ),
                "",
            )
        )
        print(*table[-1], flush=True)
    if "large" in told.only:
        taken, peak = large()
        table.append(
            ("MB, peak of the command on 100 pictures of 48 megapixels", f"{peak:.0f} ({taken:.0f} s)", "")
        )
        print(*table[-1], flush=True)
    text = markdown(("growing", "size: seconds", "exponent"), table)
    print(text)
    if told.update:
        update(told.update, "growth", text)


if __name__ == "__main__":
    main()
