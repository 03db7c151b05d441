"""Do the 95 % intervals of relative poses and distances hold the truth?

    python benchmarks/rig_coverage.py [--runs 200] [--cameras 2,4] [--instants 12]

Simulated rigs of `benchmarks/rig.py`, noise of .2 px. Printed are, over all runs and cameras: the share of the
intervals (1.96 sigma) of each component of the relative poses and of each distance that hold the truth, the mean error
in standard errors of that mean (bias), and the scatter of the distance between the first two cameras beside that of
cv2.stereoCalibrate on the same points.
"""

from __future__ import annotations

import argparse
from itertools import combinations

import numpy as np
from rig import simulated

import camcal
from camcal.assess.covariance import covariance
from camcal.assess.rig import baseline_sigma, relative_sigmas
from camcal.geometry import rotations
from camcal.model.rig import Rig
from camcal.peers.base import one_thread
from camcal.peers.stereo_calibrate import crosscheck
from camcal.plan.solution import RigSolution
from camcal.solve.refine import How

#: two-sided 95 % of a Gaussian
WIDTH = 1.96
MODEL = "brown:radial=1,decentering=0"


def errors(solution: RigSolution, truth: Rig) -> tuple[list[float], list[float]]:
    """Errors in units of their sigma: of the components of the relative poses, and of the distances."""
    accuracy, poses, distances = covariance(solution), [], []
    for name in list(truth.cameras)[1:]:
        ours, true = solution.rig.cam_from_rig[name], truth.cam_from_rig[name]
        off = np.r_[rotations.log(ours.rotation @ true.rotation.T), ours.translation - true.translation]
        poses += (off / relative_sigmas(solution, accuracy, name)).tolist()
    for a, b in combinations(truth.cameras, 2):
        off = solution.rig.baseline(a, b) - truth.baseline(a, b)
        distances.append(float(off / baseline_sigma(solution, accuracy, a, b)))
    return poses, distances


def by_cv2(solution: RigSolution) -> float:
    """The distance of the first two cameras as cv2.stereoCalibrate has it; NaN where it has none."""
    names = list(solution.rig.cameras)[:2]
    with one_thread():
        entries = crosscheck(solution, None, How(solution_fix(solution)))
    own = [e for e in entries if (e["why"] or "").startswith("-".join(names)) and e["opencv"]]
    return float(own[0]["opencv"]["baseline"]) if own else float("nan")


def solution_fix(solution: RigSolution) -> dict[str, None]:
    """What the solution holds."""
    return {n: None for n, row in zip(solution.names, solution.free, strict=True) if not row.any()}


def main() -> None:
    """Print a row for each number of cameras."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--cameras", default="2,4")
    parser.add_argument("--instants", type=int, default=12)
    asked = parser.parse_args()
    print("| cameras | runs | poses in 95 % | distances in 95 % | bias | distance a-b, mm | cv2's |")
    print("|---|---|---|---|---|---|---|")
    for count in map(int, asked.cameras.split(",")):
        poses, distances, ours, theirs, true = [], [], [], [], 0.0
        for seed in range(asked.runs):
            data, rig = simulated(count, asked.instants, seed=seed)
            solution = camcal.calibrate_rig(data, model=MODEL, robust="none", checks=False)
            more = errors(solution, rig)
            poses.append(more[0])
            distances.append(more[1])
            ours.append(solution.rig.baseline("c0", "c1"))
            true = rig.baseline("c0", "c1")
            theirs.append(by_cv2(solution) if count == 2 else float("nan"))
        z, d = np.array(poses), np.array(distances)
        bias = np.abs(z.mean(0) / (z.std(0, ddof=1) / np.sqrt(len(z)))).max()
        scatter = [float(np.sqrt(np.nanmean(np.square(np.array(v) - true)))) for v in (ours, theirs)]
        print(
            f"| {count} | {len(z)} | {100 * (np.abs(z) <= WIDTH).mean():.1f} % "
            f"| {100 * (np.abs(d) <= WIDTH).mean():.1f} % | {bias:.1f} se | {scatter[0]:.4f} | {scatter[1]:.4f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
