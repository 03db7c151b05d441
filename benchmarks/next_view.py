"""How many pictures until a wanted projection uncertainty: suggested by `camcal next`, or taken at random.

A camera is known, its corners have Gaussian noise. Each run begins with the same 3 pictures; then the next
is taken where

- `suggested`: `camcal next` says, from what is known by then, held by a hand that misses the pose (by 2 degrees and
  by 2 % of the distance, rms). Where a corner leaves the picture by that, it counts, but is of no use;
- `random`: the target is anywhere in the picture, as near or far and as tilted as suggested ones may be, whole;
- `careful`: as `camcal simulate` does, each picture filled by 45 to 80 %, places and tilts going round evenly.

After each picture the camera is calibrated again; the worst uncertainty over the picture, at infinity and for the true
noise, is what counts. Medians over the seeds of the number of all pictures, the first 3 included.

Usage: python benchmarks/next_view.py [--seeds 30] [--update docs/trust.md]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tables import markdown, update

from camcal.assess import figures
from camcal.assess.candidate_views import Candidates
from camcal.assess.difference import image_grid
from camcal.assess.next_view import NextView
from camcal.assess.uncertainty import projection_uncertainty, worst_sigma
from camcal.data.observations import Correspondences
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.placement import simulate_poses
from camcal.model.pose import Pose, Poses
from camcal.plan.solution import Solution
from camcal.solve.refine import refine
from camcal.study.cameras import example_camera
from camcal.study.points import simulate_points

MODELS = ("opencv4", "opencv5", "kb4", "ds")
#: required uncertainties in units of the noise: only their ratio matters
TARGETS = (5.0, 3.0, 2.0)
NOISE = 0.2
FIRST = 3
MOST = 80
HAND = (np.radians(2.0), 0.02)
STRATEGIES = ("suggested", "random", "careful")


def board() -> np.ndarray:
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    return np.c_[x.ravel(), y.ravel(), 0 * x.ravel()] * 0.03


def by_hand(pose: Pose, rng: np.random.Generator) -> Pose:
    """The pose as a hand would meet it, turned and moved about the board's middle."""
    middle = board().mean(0)
    centre = pose.apply(middle)
    turn = rotations.exp(HAND[0] / np.sqrt(3) * rng.normal(size=3)) @ pose.rotation
    centre = centre + HAND[1] * np.linalg.norm(centre) / np.sqrt(3) * rng.normal(size=3)
    return Pose(turn, centre - turn @ middle)


class Run:
    """A calibration that grows by one picture after the other."""

    def __init__(self, truth: Camera, first: Poses, seed: int):
        self.truth, self.rng = truth, np.random.default_rng(seed)
        self.poses, self.data = first, simulate_points(truth, board(), first, self.rng, NOISE)
        self.taken = FIRST
        self.solution: Solution = refine(truth, first, self.data)

    def take(self, pose: Pose) -> None:
        """A picture of the board in this pose."""
        self.taken += 1
        seen = simulate_points(self.truth, board(), Poses.stack([pose]), self.rng, NOISE).views[0]
        if len(seen) < len(board()):
            return
        views = (*self.data.views, replace(seen, id=f"view{self.taken}"))
        self.data = Correspondences.from_views(views, self.data.image_size)
        poses = Poses.stack([*self.solution.poses, pose])
        self.solution = refine(self.solution.camera, poses, self.data)

    @property
    def worst(self) -> float:
        """The worst sigma over the picture in units of the noise."""
        pixels = image_grid(np.zeros(2), np.subtract(self.truth.image_size, 1.0), columns=9)
        sigmas = worst_sigma(projection_uncertainty(self.solution).at_pixels(pixels, np.inf))
        known = sigmas[~np.isnan(sigmas)]
        return float(known.max() / figures.sigma_0(self.solution))


def suggested(run: Run) -> Iterator[Pose]:
    while True:
        yield by_hand(NextView(run.solution, seed=run.taken).best()[0].pose, run.rng)


def at_random(run: Run) -> Iterator[Pose]:
    yield from Candidates(replace(run.solution, camera=run.truth), True).spread(4 * MOST, run.rng)


def carefully(run: Run) -> Iterator[Pose]:
    yield from simulate_poses(board(), run.truth, run.rng, MOST)


NEXT: dict[str, Callable[[Run], Iterator[Pose]]] = dict(
    zip(STRATEGIES, (suggested, at_random, carefully), strict=True)
)


def pictures(model: str, strategy: str, seed: int) -> list[float]:
    """How many pictures each target took; inf where MOST did not reach it."""
    truth = example_camera(model)
    start = simulate_poses(board(), truth, np.random.default_rng(seed), FIRST)
    run = Run(truth, start, seed + 1000)
    needed = [np.inf] * len(TARGETS)
    for pose in NEXT[strategy](run):
        worst = run.worst
        needed = [min(n, run.taken) if worst <= t else n for n, t in zip(needed, TARGETS, strict=True)]
        if np.isfinite(needed).all() or run.taken >= MOST:
            return needed
        run.take(pose)
    return needed


def count(value: float) -> str:
    return f"{value:g}" if np.isfinite(value) else f"> {MOST}"


def fewer(own: float, other: float) -> str:
    """By how much fewer; a bound where the other did not get there."""
    if not np.isfinite(own):
        return "-"
    bound = "" if np.isfinite(other) else "> "
    return f"{bound}{100 * (1 - own / min(other, MOST)):.0f} %"


def table(seeds: int) -> str:
    rows = []
    for model in MODELS:
        began = time.perf_counter()
        medians = {
            s: np.median([pictures(model, s, seed) for seed in range(seeds)], axis=0) for s in STRATEGIES
        }
        for i, target in enumerate(TARGETS):
            own, others = medians["suggested"][i], [medians[s][i] for s in STRATEGIES[1:]]
            saved = [fewer(own, other) for other in others]
            rows.append([model, f"{target:g}", count(own), *map(count, others), *saved])
            print(rows[-1], f"{time.perf_counter() - began:.0f} s", flush=True)
    header = [
        "model",
        "worst ± in units of the noise",
        "suggested",
        "random",
        "careful",
        "fewer than random",
        "than careful",
    ]
    said = (
        f"Pictures until the required uncertainty, medians of {seeds} runs (`benchmarks/next_view.py`):\n\n"
    )
    return said + markdown(header, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--update", type=Path)
    asked = parser.parse_args()
    made = table(asked.seeds)
    print(made)
    if asked.update:
        update(asked.update, "next", made)
