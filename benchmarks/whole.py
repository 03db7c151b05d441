"""What a user waits for: whole commands and calls, beside the usual OpenCV script and cv2.calibrateCamera.

    python benchmarks/whole.py [--runs 5] [--only pictures calls start] [--update docs/figures.md]

Pictures are rendered here. The script reads the pictures, runs findChessboardCorners and cornerSubPix (window 11, as
OpenCV's tutorial has it) and calibrateCamera, and prints the result; its time, and camcal's, are those of a process
from start to end. The two take turns; medians and the median of the ratios are printed. "cold" is without the cache of
detections.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
from refine import run_cv2, simulate
from tables import markdown, update

import camcal

SCRIPT = """
import sys, glob, cv2, numpy as np
grid = np.zeros((54, 3), np.float32)
grid[:, :2] = np.mgrid[0:9, 0:6].T.reshape(-1, 2)
criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
points, seen = [], []
for name in sorted(glob.glob(sys.argv[1] + '/*')):
    gray = cv2.imread(name, cv2.IMREAD_GRAYSCALE)
    ok, corners = cv2.findChessboardCorners(gray, (9, 6), None)
    if ok:
        points.append(grid)
        seen.append(cv2.cornerSubPix(gray, corners, (11, 11), (-1, -1), criteria))
print(cv2.calibrateCamera(points, seen, gray.shape[::-1], None, None)[:3])
"""
#: pictures, their size, the limit that issue and docs state for the ratio cold
PICTURES = ((13, (640, 480), "png", 3.0), (30, (1632, 1224), "jpg", 1.5), (100, (1632, 1224), "jpg", 1.0),
            (12, (4000, 3000), "jpg", 1.0))  # fmt: skip
CALLS = ((13, 9, 6), (50, 9, 6), (200, 9, 6), (200, 20, 20))


def seconds(command: list[str]) -> float:
    """Wall time of a process."""
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit {done.returncode}\n{done.stderr[-500:]}")
    return time.perf_counter() - start


def in_turn(first: Callable[[], float], second: Callable[[], float], runs: int) -> tuple[float, float, float]:
    """Medians of both and of their ratio."""
    pairs = [(first(), second()) for _ in range(runs)]
    a, b = zip(*pairs, strict=True)
    return statistics.median(a), statistics.median(b), statistics.median(x / y for x, y in pairs)


def tool(*words: object) -> list[str]:
    return [sys.executable, "-m", "camcal", *map(str, words)]


def pictures(runs: int, folder: Path) -> list[tuple[object, ...]]:
    """The command on folders of pictures, without and with the cache."""
    rows: list[tuple[object, ...]] = []
    for count, size, kind, limit in PICTURES:
        place, out = folder / f"{count}-{size[0]}", folder / "report.yaml"
        width = f"{size[0]}x{size[1]}"
        made = tool("simulate", "images", "--target", "checkerboard:9x6:25mm", "--views", count, "-o", place)
        scale = {"fx": 533 * size[0] / 640, "fy": 534 * size[0] / 640, "cx": size[0] / 2, "cy": size[1] / 2}
        values = ",".join(f"{k}={v:.4g}" for k, v in scale.items())
        blur = 0.8 * max(1.0, size[0] / 1600)
        subprocess.run(
            [*made, "--image-size", width, "--set", values, "--type", kind, "--blur", f"{blur:.2g}", "-q"],
            check=True,
        )
        for truth in place.glob("*.yaml"):
            truth.unlink()
        script = [sys.executable, "-c", SCRIPT, str(place)]
        run = tool("checkerboard", place, "-o", out, "--force", "-q")
        for name, command, most in (("cold", [*run, "--no-cache"], limit), ("cached", run, "")):
            if name == "cached":
                seconds(command)  # fills it
            ours, theirs, ratio = in_turn(lambda c=command: seconds(c), lambda s=script: seconds(s), runs)
            what = f"checkerboard, {count} pictures {width}, {name}"
            rows.append((what, f"{ours:.2f} s", f"{theirs:.2f} s", f"{ratio:.2f}", most))
    return rows


def timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def calls(runs: int) -> list[tuple[object, ...]]:
    """`camcal.calibrate` with its checks and without, beside cv2.calibrateCamera alone."""
    rows: list[tuple[object, ...]] = []
    ways = (
        ("without checks", {"checks": False}, 0.5, 0.25),
        ("with checks", {}, 3.0, 1.0),
        ("with checks and the cross-check", {"crosscheck": True}, "", ""),
        ("with checks and the board's shape", {"board_shape": "auto"}, "", ""),
    )
    for views, columns, lines in CALLS:
        data = simulate(views, columns, lines)
        for name, options, few, many in ways:
            work = lambda d=data, o=options: camcal.calibrate(d, model="opencv5", **o)  # noqa: E731
            work()
            ours, theirs, ratio = in_turn(
                lambda w=work: timed(w), lambda d=data: timed(lambda: run_cv2(d, "opencv5")), runs
            )
            limit = few if views < 50 else many
            what = f"calibrate {name}, {views} x {columns * lines}"
            rows.append((what, f"{1e3 * ours:.0f} ms", f"{1e3 * theirs:.0f} ms", f"{ratio:.2f}", limit))
    return rows


def start_up(runs: int, folder: Path) -> list[tuple[object, ...]]:
    """What is not calibration: starting, refusing, reporting."""
    points = folder / "points.csv"
    subprocess.run(tool("simulate", "board", "-o", points, "-q"), check=True)
    report = folder / "of_points.yaml"
    seconds(tool("estimate", points, "--image-size", "640x480", "-o", report, "-q"))
    page = folder / "page.html"
    cases = (
        ("python -c 'import numpy, cv2'", [sys.executable, "-c", "import numpy, cv2"]),
        ("camcal --help", tool("--help")),
        ("estimate, 12 views of a board", tool("estimate", points, "--image-size", "640x480", "-q")),
        ("report (page)", tool("report", report, "-o", page, "--force", "-q")),
    )
    bare = [sys.executable, "-c", "import numpy, cv2"]
    rows: list[tuple[object, ...]] = []
    for name, command in cases:
        ours, theirs, ratio = in_turn(lambda c=command: seconds(c), lambda: seconds(bare), runs)
        rows.append((name, f"{ours:.2f} s", f"{theirs:.2f} s (its imports)", f"{ratio:.1f}", ""))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--only", nargs="+", choices=("pictures", "calls", "start"), default=("pictures", "calls", "start")
    )
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "pictures" in options.only:
            rows += pictures(options.runs, folder)
        if "calls" in options.only:
            rows += calls(options.runs)
        if "start" in options.only:
            rows += start_up(options.runs, folder)
    table = markdown(("what", "camcal", f"OpenCV {cv2.__version__}", "ratio", "to reach"), rows)
    print(table)
    if options.update:
        update(options.update, "whole", table)


if __name__ == "__main__":
    main()
