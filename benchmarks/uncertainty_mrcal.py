"""Projection uncertainty beside mrcal's, on the same data with the same free parameters.

mrcal (Debian's package, in the system's interpreter) solves each problem from camcal's solution, without its
regularisation and its rejection of outliers, once with a board that is flat and once with its bend (camcal:
`--board-shape bowl`, the same two parameters). Both then say how uncertain pixels are, in the worst direction.

`as given` compares what the two print: camcal scales by sigma_hat, whose denominator is the redundancy, mrcal by the
rms of a coordinate, which is smaller. `same scale` takes sigma = 1 px in both. Where the board bends, camcal settles
its frame on the bent points, mrcal leaves it with the ideal ones, so that a change of the bend moves what is fixed
to the board; `same frame` does as mrcal does there. What is left are the derivatives and the linear algebra.

Usage: python benchmarks/uncertainty_mrcal.py [--update docs/trust.md]
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tables import markdown, update

from camcal.assess import figures
from camcal.assess.uncertainty import board_distance, board_follow, projection_uncertainty, worst_sigma
from camcal.data.observations import Correspondences
from camcal.data.points import read_points
from camcal.geometry import rotations
from camcal.model.placement import simulate_poses
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import Solution
from camcal.study.cameras import example_camera
from camcal.study.points import simulate_points

DATA = Path(os.environ.get("CAMCAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
#: what was asked for: the two agree within this
WANTED = 0.05


@dataclass(frozen=True)
class Case:
    name: str
    model: str
    data: Correspondences
    rows: int
    columns: int
    spacing: float


def cases() -> Iterator[Case]:
    points = DATA / "mrcal_case" / "points.csv"
    if points.exists():
        data = read_points(points, image_size=(1920, 1080))
        for model in ("opencv5", "opencv8"):
            yield Case("50 views, 1920x1080", model, data, 6, 9, 0.04)
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    board = np.c_[x.ravel(), y.ravel(), 0 * x.ravel()] * 0.03
    for model, views in (("opencv4", 8), ("opencv5", 15), ("opencv12", 40)):
        rng = np.random.default_rng(views)
        truth = example_camera(model)
        data = simulate_points(truth, board, simulate_poses(board, truth, rng, views), rng, 0.2)
        yield Case(f"{views} simulated views", model, data, 6, 9, 0.03)


def interpreter() -> str | None:
    """A Python that has mrcal."""
    for name in (sys.executable, shutil.which("python3", path="/usr/bin")):
        if name and subprocess.run([name, "-c", "import mrcal"], capture_output=True).returncode == 0:
            return name
    return None


def asked(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and distances (N,): the centre and two corners, far and at the boards."""
    size = np.array(solution.camera.image_size, float)
    places = np.array([(size - 1) / 2, [0.05, 0.08] * size, [0.98, 0.97] * size])
    distances = [np.inf, board_distance(solution)]
    return np.tile(places, (2, 1)), np.repeat(distances, 3)


def by_camcal(
    solution: Solution, pixels: np.ndarray, distances: np.ndarray, settled: bool = True
) -> np.ndarray:
    """Sigmas in the worst direction, px; with the board's frame on its points, or on the ideal ones."""
    uncertainty = projection_uncertainty(solution)
    if not settled:
        every = np.arange(len(solution.poses))
        uncertainty = replace(uncertainty, follow=uncertainty.follow + board_follow(solution, every))
    return np.array(
        [worst_sigma(uncertainty.at_pixels(p[None], d))[0] for p, d in zip(pixels, distances, strict=True)]
    )


def by_mrcal(python: str, case: Case, solution: Solution, warp: bool) -> dict[str, np.ndarray]:
    pixels, distances = asked(solution)
    seen = [np.c_[v.uv, np.ones(len(v))].reshape(case.rows, case.columns, 3) for v in case.data.views]
    poses = solution.poses
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(
            given,
            seen=np.stack(seen),
            frames=np.c_[rotations.log(poses.rotations), poses.translations],
            intrinsics=solution.camera.params,
            model=f"LENSMODEL_{case.model.upper()}",
            size=np.array(solution.camera.image_size),
            spacing=case.spacing,
            warp=warp,
            pixels=pixels,
            distances=distances,
        )
        worker = Path(__file__).with_name("mrcal_uncertainty_worker.py")
        done = subprocess.run([python, worker, given, made], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stderr)
        with np.load(made) as found:
            return dict(found)


def compared(python: str, case: Case, warp: bool) -> tuple[list[str], float]:
    """A row of the table, and the largest difference at the same scale."""
    shape = "bowl" if warp else "flat"
    solution = calibrate(case.data, case.model, robust="none", board_shape=shape, crosscheck=False, holdout=0)
    own = by_camcal(solution, *asked(solution))
    other = by_mrcal(python, case, solution, warp)
    as_given = np.abs(own / other["own"] - 1)
    unit = other["unit"] * figures.sigma_0(solution)
    same = np.abs(own / unit - 1)
    framed = np.abs(by_camcal(solution, *asked(solution), settled=False) / unit - 1)
    print(case.name, case.model, shape, "camcal", own.round(4), "mrcal", other["own"].round(4), flush=True)
    shown = [f"{a:.3f} / {b:.3f}" for a, b in zip(own[:3], other["own"][:3], strict=True)]
    apart = [f"{100 * as_given.max():.1f} %", f"{100 * same.max():.2g} %", f"{100 * framed.max():.2g} %"]
    return [case.name, case.model, shape, *shown, *apart], float(same.max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--update", type=Path, help="a page whose table is to be renewed")
    told = parser.parse_args()
    python = interpreter()
    if python is None:
        print("left out: there is no mrcal on this machine (apt-get install python3-mrcal)")
        return
    found = [compared(python, case, warp) for case in cases() for warp in (False, True)]
    header = [
        "data",
        "model",
        "board",
        "centre",
        "upper left",
        "lower right",
        "as given",
        "same scale",
        "and same frame",
    ]
    said = markdown(header, [row for row, _ in found])
    print(said)
    worst = max(apart for _, apart in found)
    print(f"largest difference at the same scale: {100 * worst:.1f} % (wanted: {100 * WANTED:.0f} %)")
    if told.update:
        update(told.update, "mrcal-uncertainty", said)
    if not worst <= WANTED:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
