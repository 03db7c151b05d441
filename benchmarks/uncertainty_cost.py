"""What covariance and uncertainty maps cost beside the refinement: 500 views of 54 points.

The refinement begins with the focal lengths 2 % off, as after a good closed form; the maps are the two of the report
(400 pixels each). cv2's time for the same problem is measured with --cv2: half a minute.

Usage: python benchmarks/uncertainty_cost.py [--runs 7] [--cv2] [--update docs/trust.md]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tables import markdown, update

from camcal.assess.covariance import covariance
from camcal.model.camera import Camera
from camcal.model.placement import simulate_poses
from camcal.report.uncertainty import section
from camcal.solve.refine import refine
from camcal.study.cameras import example_camera
from camcal.study.points import simulate_points

VIEWS = 500


def seconds(work: Callable[[], Any], runs: int) -> tuple[float, Any]:
    """The least of several times, and the last result."""
    times, result = [], None
    for _ in range(runs):
        begin = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - begin)
    return min(times), result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--cv2", action="store_true")
    parser.add_argument("--update", type=Path)
    told = parser.parse_args()
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    board = np.c_[x.ravel(), y.ravel(), np.zeros(54)]
    rng, truth = np.random.default_rng(0), example_camera("opencv5")
    poses = simulate_poses(board, truth, rng, VIEWS)
    data = simulate_points(truth, board, poses, rng, 0.2)
    start = truth.params.copy()
    start[:2] *= 1.02
    refining, solution = seconds(
        lambda: refine(Camera(truth.lens, start, truth.image_size), poses, data), told.runs
    )
    known, accuracy = seconds(lambda: covariance(solution), told.runs)
    mapped, _ = seconds(lambda: section(solution, accuracy), told.runs)
    rows = [
        ["refinement", f"{1e3 * refining:.0f}"],
        ["covariance", f"{1e3 * known:.0f}"],
        ["two uncertainty maps", f"{1e3 * mapped:.0f}"],
    ]
    if told.cv2:
        xyz = [np.float32(v.xyz) for v in data.views]
        uv = [np.float32(v.uv) for v in data.views]
        by_cv2, _ = seconds(lambda: cv2.calibrateCameraExtended(xyz, uv, truth.image_size, None, None), 1)
        rows.append(["cv2.calibrateCameraExtended", f"{1e3 * by_cv2:.0f}"])
    made = markdown([f"{VIEWS} views of 54 points, {truth.lens.name}", "ms"], rows)
    print(made)
    if told.update:
        update(told.update, "uncertainty-cost", made)
    if not known + mapped < refining:
        raise SystemExit("covariance and maps take longer than the refinement")


if __name__ == "__main__":
    main()
