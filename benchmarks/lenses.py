"""Lens models beside cv2: throughput of project and unproject, and a calibration of 50 views of 54 points.

    python benchmarks/lenses.py [--points 1000000] [--runs 5] [--models "kb4;mei"] [--update docs/lenses.md]

Times are the processor's, on one thread in both, as camcal uses one. cv2's undistortPoints stops early by
default, so it is also run until its own result no longer changes; what each leaves is the largest distance in
px between a pixel and the projection of its ray.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from tables import markdown, update

from camcal.assess.holdout import hold_out
from camcal.data.observations import Correspondences
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.placement import simulate_poses
from camcal.plan.calibrate import calibrate
from camcal.solve.refine import How
from camcal.study.points import simulate_points

Array = np.ndarray

MODELS = (
    "pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "opencv14", "brown:radial=3,decentering=1", "kb4", "ucm",
    "eucm", "ds", "mei", "fov", "division:1", "division:3", "scaramuzza", "radial-profile", "rational-function",
    "bicubic", "polynomial:5", "spline:8x6",
)  # fmt: skip
CV2_COLUMNS = ("project", "unproject, error", "unproject converged, error")
#: whose lenses the calibrations see: a webcam, a fisheye
SOURCES = ("opencv5", "kb4")
ZERO = np.zeros(3)
#: until nothing changes: cv2 stops at the smaller of both
EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-15)


def rates(functions: dict[str, Callable[[], Array]], runs: int) -> dict[str, float]:
    """Million points a second of each, by the median of the times; in turns, so that all are disturbed alike."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(runs):
        for name, function in functions.items():
            begin = time.process_time()
            count = len(function())
            times[name].append((time.process_time() - begin) / count)
    return {name: 1e-6 / statistics.median(t) for name, t in times.items()}


def cv2_functions(lens, params):
    """cv2's project (N, 3) -> (N, 2) and unproject (N, 2) -> (N, 2) on z = 1, by default and exact; or None."""
    form = lens.opencv(params)
    if form is None:
        return None
    k, d = lens.matrix(params), form.distortion
    if form.function == "fisheye.calibrate":
        undistort = cv2.fisheye.undistortPoints
        return (
            lambda xyz: cv2.fisheye.projectPoints(xyz, ZERO, ZERO, k, d)[0],
            lambda uv: undistort(uv, k, d),
            lambda uv: undistort(uv, k, d, criteria=EXACT),
        )
    if form.function == "omnidir.calibrate":
        xi = np.array([form.xi])
        return (
            lambda xyz: cv2.omnidir.projectPoints(xyz, ZERO, ZERO, k, form.xi, d)[0],
            lambda uv: cv2.omnidir.undistortPoints(uv, k, d, xi, np.eye(3)),
            None,
        )
    if hasattr(cv2, "undistortPointsIter"):
        exact = lambda uv: cv2.undistortPointsIter(uv, k, d, None, None, EXACT)  # noqa: E731
    else:
        exact = lambda uv: cv2.undistortPoints(uv, k, d, criteria=EXACT)  # noqa: E731
    return (
        lambda xyz: cv2.projectPoints(xyz, ZERO, ZERO, k, d)[0],
        lambda uv: cv2.undistortPoints(uv, k, d),
        exact,
    )


def throughput(spec: str, count: int, runs: int) -> list[str]:
    """A row of the table of throughput."""
    lens = lenses.make(spec)
    params, size = lens.examples()[0]
    uv = np.random.default_rng(0).uniform(0, 1, (2 * count, 2)) * (np.array(size) - 1)
    rays, _ = lens.unproject(params, uv)
    # cv2 knows the half in front of the camera only, most of it by x / z
    ahead = np.flatnonzero(rays[:, 2] > 0.05)[:count]
    uv, xyz = uv[ahead], np.ascontiguousarray(rays[ahead])
    functions = {
        "project": lambda: lens.project(params, xyz)[0],
        "unproject": lambda: lens.unproject(params, uv)[0],
    }
    theirs = cv2_functions(lens, params)
    if theirs is not None:
        points, pixels = xyz.reshape(-1, 1, 3), uv.reshape(-1, 1, 2)
        functions["cv2 project"] = lambda: theirs[0](points)
        # to the end it takes seconds: a tenth of the points
        some = {"cv2 unproject": pixels, "cv2 to the end": pixels[: len(pixels) // 10]}
        for (name, part), undistort in zip(some.items(), theirs[1:], strict=True):
            if undistort is not None:
                functions[name] = lambda f=undistort, p=part: f(p)
    rate = rates(functions, runs)
    row = [spec, f"{rate['project']:.1f}", f"{rate['unproject']:.1f}"]
    row.append(f"{np.nanmax(np.abs(lens.project(params, lens.unproject(params, uv)[0])[0] - uv)):.0e}")
    if theirs is None:
        return row + ["", "", ""]
    row.append(f"{rate['cv2 project']:.1f} ({rate['project'] / rate['cv2 project']:.1f}x)")
    for name in ("cv2 unproject", "cv2 to the end"):
        if name not in functions:
            row.append("")
            continue
        found = np.reshape(functions[name](), (-1, 2))
        again, _ = lens.project(params, np.c_[found, np.ones(len(found))])
        left, ratio = np.nanmax(np.abs(again - uv[: len(found)])), rate["unproject"] / rate[name]
        row.append(f"{rate[name]:.2f} ({ratio:.1f}x), {left:.0e} px")
    return row


def board_data(model="opencv5", views=50, noise=0.2):
    lens = lenses.make(model)
    params, size = lens.examples()[0]
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2) * 0.03
    points = np.c_[grid - grid.mean(0), np.zeros(len(grid))]
    camera = Camera(lens, params, size)
    return simulate_points(camera, points, simulate_poses(points, camera, rng, views), rng, noise)


def calibration(spec: str, data: Correspondences, runs: int) -> list[str]:
    """A row of the table of calibrations."""
    lens = lenses.make(spec)
    times = []
    for _ in range(runs):
        begin = time.process_time()
        solution = calibrate(data, spec, checks=False)
        times.append(time.process_time() - begin)

    held = hold_out(solution, How(dict.fromkeys(lens.default_fixed)), 5)
    cells = [spec, str(solution.free.shape[1]), f"{statistics.median(times):.3f}"]
    left = held.figures.rms_point if held else np.nan
    return [*cells, f"{solution.rms_point:.4f}", f"{left:.4f}" if np.isfinite(left) else "points outside"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--models", default=";".join(MODELS), help="separated by ;")
    parser.add_argument("--only", choices=("throughput", "calibration"))
    parser.add_argument("--update", type=Path, help="a page whose tables are to be renewed")
    told = parser.parse_args()
    cv2.setNumThreads(1)
    models = told.models.split(";")
    tables: list[tuple[str, list[str], Callable[[str], list[str]]]] = []
    if told.only != "calibration":
        header = ["model", "project", "unproject", "error, px", *("cv2 " + n for n in CV2_COLUMNS)]
        tables.append(("lenses-throughput", header, lambda spec: throughput(spec, told.points, told.runs)))
    for source in SOURCES if told.only != "throughput" else ():
        data = board_data(source)
        header = ["model", "free", "s", "rms, px", "hold-out, px"]
        tables.append(
            (f"lenses-calibration-{source}", header, lambda spec, d=data: calibration(spec, d, told.runs))
        )
    for name, header, make_row in tables:
        print(f"\n{name}\n{header}", flush=True)
        rows = []
        for spec in models:
            rows.append(make_row(spec))
            print(rows[-1], flush=True)
        if told.update:
            update(told.update, name, markdown(header, rows))


if __name__ == "__main__":
    main()
