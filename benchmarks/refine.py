"""camcal (initialisation and refinement) against cv2.calibrateCamera on simulated boards.

Both get the same float32-rounded points, estimate the same parameters and stop where the cost no longer
falls (camcal: predicted decrease below 1e-14 of it; cv2: its default criteria, 500 iterations and DBL_EPSILON
in 5.0). The two are timed in turn, A B A B ..., and the medians and the median of the ratios are printed.
Peak memory is that of a process of its own that calibrates once, less that of one that only makes the data;
both libraries are loaded and have solved a small problem before.

Usage: python benchmarks/refine.py [--runs 5] [--quick] [--update docs/figures.md]
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from pathlib import Path

import cv2
import numpy as np
from tables import markdown, show

import camcal
from camcal.data.observations import Correspondences, View
from camcal.geometry import rotations
from camcal.model import lenses

SIZE = (640, 480)
CASES = [(10, 9, 6), (50, 9, 6), (200, 9, 6), (500, 9, 6), (50, 20, 20), (200, 20, 20), (1000, 20, 20)]
HEADER = (
    "model",
    "views x points",
    "camcal ms",
    "cv2 ms",
    "ratio",
    "camcal rms px",
    "rms / rms of cv2 - 1",
    "camcal MB",
    "cv2 MB",
)
FLAGS = {"opencv5": 0, "opencv8": cv2.CALIB_RATIONAL_MODEL}


def simulate(views: int, columns: int, rows: int, noise: float = 0.1, seed: int = 0) -> Correspondences:
    """Boards that fill a good part of the image, tilted up to 35 degrees, on a usual lens."""
    rng = np.random.default_rng(seed)
    lens = lenses.make("opencv5")
    params = lens.examples()[0][0]
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2).astype(float)
    board = np.c_[grid, np.zeros(len(grid))]
    depth = max(columns, rows) / 9
    made: list[View] = []
    while len(made) < views:
        rotation = rotations.exp(rng.uniform(-0.6, 0.6, 3))
        centre = np.array([*rng.uniform(-2, 2, 2), rng.uniform(12, 20)]) * [depth, depth, depth]
        uv, valid = lens.project(params, (board - board.mean(0)) @ rotation.T + centre)
        if valid.all() and (uv >= 0).all() and (uv < SIZE).all():
            seen = (uv + rng.normal(0, noise, uv.shape)).astype(np.float32).astype(float)
            made.append(View(f"v{len(made)}", board, seen))
    return Correspondences.from_views(tuple(made), SIZE)


def run_cv2(data: Correspondences, model: str) -> float:
    """cv2's rms for the same problem."""
    xyz = [v.xyz.astype(np.float32) for v in data.views]
    uv = [v.uv.astype(np.float32) for v in data.views]
    return cv2.calibrateCamera(xyz, uv, SIZE, None, None, flags=FLAGS[model])[0]


def run_camcal(data: Correspondences, model: str) -> float:
    """camcal's rms, from nothing."""
    return camcal.calibrate(data, model=model, checks=False).rms_point


def _peak(which: str, case: tuple[int, int, int], model: str, out) -> None:
    small = simulate(3, 9, 6)  # both have loaded what they load late, so that only the work itself counts
    run_camcal(small, "opencv5"), run_cv2(small, "opencv5"), camcal.calibrate(small, model="opencv5")
    data = simulate(*case)
    if which == "camcal":
        run_camcal(data, model)
    elif which == "checked":
        camcal.calibrate(data, model=model)
    elif which == "cv2":
        run_cv2(data, model)
    out.put(_high_water())


def _high_water() -> float:
    """Peak resident memory of this process, MB; getrusage would start from that of the parent."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return float("nan")


def peak_memory(which: str, case: tuple[int, int, int], model: str) -> float:
    """MB that a calibration adds to the peak of a process that has the data."""
    context = multiprocessing.get_context("spawn")
    sizes = []
    for kind in ("nothing", which):
        queue = context.Queue()
        process = context.Process(target=_peak, args=(kind, case, model, queue))
        process.start()
        sizes.append(queue.get())
        process.join()
    return sizes[1] - sizes[0]


def compare(case: tuple[int, int, int], model: str, runs: int) -> list[str]:
    """A row of the table."""
    data = simulate(*case)
    run_camcal(data, model)
    ours, theirs = [], []
    for _ in range(runs):
        begin = time.perf_counter()
        rms = run_camcal(data, model)
        middle = time.perf_counter()
        rms_cv2 = run_cv2(data, model)
        ours.append(middle - begin)
        theirs.append(time.perf_counter() - middle)
    ratio = np.median(np.array(theirs) / np.array(ours))
    memory = [peak_memory(which, case, model) for which in ("camcal", "cv2")]
    return [
        model,
        f"{case[0]} x {case[1] * case[2]}",
        f"{np.median(ours) * 1e3:.1f}",
        f"{np.median(theirs) * 1e3:.1f}",
        f"{ratio:.2f}",
        f"{rms:.9f}",
        f"{rms / rms_cv2 - 1:+.1e}",
        *(f"{m:.1f}" for m in memory),
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="only the small cases")
    parser.add_argument("--update", type=Path, metavar="PAGE", help="a page whose table is to be renewed")
    told = parser.parse_args()
    print(f"cv2 {cv2.__version__}, {cv2.getNumThreads()} threads; median of {told.runs}")
    rows = []
    for model in FLAGS:
        for case in CASES[:4] if told.quick else CASES:
            rows.append(compare(case, model, told.runs))
            print("  ".join(f"{cell:>10}" for cell in rows[-1]), flush=True)
    table = markdown(HEADER, rows)
    show(told.update, "refine", table)


if __name__ == "__main__":
    main()
