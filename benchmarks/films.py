"""Films: frames decoded, searched and kept a second, and the camera of the chosen frames beside that of all.

    python benchmarks/films.py FILM [--target SPEC] [--splits 40] [--update docs/figures.md]

The film is run twice: as `camcal checkerboard FILM` chooses its frames, and with every frame that shows the target
(`--every 1`, none left out). Both cameras are compared on the frames of the second run by what they project, so that a
choice of frames that loses accuracy shows.

Then the choice is tested on frames that took no part. In each split a quarter of the film's 16 stretches is held out.
Cameras are fitted to the frames that are chosen from the rest, to all of the rest, and to as many of the rest at
random, each with its own readout time, and the poses of the frames held out to each camera. `better than all` counts
splits.
The last lines compare the cameras of the chosen frames and of the frames that are not chosen, which share no noise, and
those of as many frames at random and of the others: what they project apart at the points of the film after the best
rotation, and the difference d of their parameters by the sum of their covariances, dᵀ (C_1 + C_2)⁻¹ d over the
number of parameters, which is 1 in the mean where nothing but noise tells the two apart.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from tables import markdown, update

import camcal
from camcal.assess import rolling
from camcal.assess.covariance import covariance
from camcal.assess.difference import difference, image_grid
from camcal.data.observations import Observations
from camcal.detect.films import Range, Shown, candidates, left_out
from camcal.detect.images import detect_images
from camcal.detect.targets.base import Detection
from camcal.model.pose import Poses
from camcal.plan.solution import Solution
from camcal.settings.detection import DEFAULT_FRAMES
from camcal.solve.poses import refine_poses
from camcal.solve.refine import residuals

STRETCHES, HELD_OUT = (
    16,
    4,
)  #: a stretch of the film is a few seconds: neighbouring frames are nearly the same


def run(film: Path, target: str | None, **how: object) -> tuple[dict[str, float], object]:
    """Figures of one search, and its observations."""
    said: dict[str, float] = {}

    def on_event(name: str, details: dict) -> None:
        if name == "frames":
            said["decoded"], said["searched"] = details["frames"], details["searched"]

    start = time.perf_counter()
    found = detect_images([film], target=target, cache=False, on_event=on_event, **how)
    said["seconds"], said["kept"] = time.perf_counter() - start, len(found.views)
    return said, found


def shown(film: Path, data: Observations) -> list[Shown]:
    """What the choice of frames goes by, of each view."""
    motion = {c.number: c.motion for c in candidates(film, Range(every=1))[0]}
    size = data.image_size
    assert size is not None
    return [
        Shown(
            view.id,
            view.xyz[:, :2],
            Detection(
                view.point_ids, view.uv, view.sigma, {"blur_px": data.picture_quality[view.id]["blur_px"]}
            ),
            size,
            motion[int(view.id.rpartition("#")[2])],
        )
        for view in data.views
    ]


def fitted(data: Observations) -> tuple[Solution, float]:
    """The camera of some frames, and the readout time that their points were corrected for, in frames."""
    solution = camcal.calibrate(data, model="opencv5", checks=False)
    unit = data.uv - rolling.corrected(data, 1.0).uv
    moved = data.uv - solution.observations.uv
    return solution, float((moved * unit).sum() / (unit * unit).sum())


def held_out(fit: tuple[Solution, float], test: Observations, starts: Poses) -> float:
    """rms over the points of frames that took no part, only their poses fitted, px."""
    solution, time = fit
    test = rolling.corrected(test, time)
    poses, _, _ = refine_poses(solution.camera, test.views, starts)
    return float(np.sqrt((residuals(solution.camera, poses, test) ** 2).sum(1).mean()))


def split_table(film: Path, data: Observations, splits: int, seed: int) -> tuple[str, str]:
    """The table of the held-out errors, and the sentence about the chosen frames and the others."""
    said, rng = shown(film, data), np.random.default_rng(seed)
    every = np.arange(len(said))
    whole, _ = fitted(data)
    stretch = every * STRETCHES // len(every)
    rows = []
    for number in range(splits):
        out = np.isin(stretch, rng.choice(STRETCHES, HELD_OUT, replace=False))
        rest, test = every[~out], every[out]
        dropped = left_out([said[i] for i in rest], DEFAULT_FRAMES)
        chosen = np.array([i for k, i in enumerate(rest) if k not in dropped])
        chance = np.sort(rng.choice(rest, len(chosen), replace=False))
        starts, tested = whole.poses[test], data.of_views(test)
        rows.append([held_out(fitted(data.of_views(v)), tested, starts) for v in (chosen, rest, chance)])
        print(number, len(chosen), len(rest), np.round(rows[-1], 5), flush=True)
    rms = np.array(rows)
    more = rms - rms[:, 1:2]
    better = [f"{(more[:, k] < 0).sum()} of {splits}" if k != 1 else "" for k in range(3)]
    names = ("chosen", "all of the rest", "as many at random")
    error = more.std(0) / np.sqrt(splits)
    table = markdown(
        ("fitted to", "held out, rms px", "more than all, px", "standard error", "better than all"),
        [
            (n, f"{rms[:, k].mean():.4f}", f"{more[:, k].mean():+.4f}", f"{error[k]:.4f}", better[k])
            for k, n in enumerate(names)
        ],
    )  # fmt: skip
    dropped = left_out(said, DEFAULT_FRAMES)
    chosen = ~np.isin(every, list(dropped))
    chance = [
        apart(data, np.isin(every, rng.choice(every, chosen.sum(), replace=False)))
        for _ in range(splits // 2)
    ]
    text = "{:.3f} px (rms at the points of the film), {:.1f} in each parameter"
    return table, (
        f"{chosen.sum()} chosen frames and the {len(dropped)} others: {text.format(*apart(data, chosen))}\n"
        f"as many at random and the others, mean of {len(chance)}: {text.format(*np.mean(chance, 0))}"
    )


def apart(data: Observations, part: np.ndarray) -> tuple[float, float]:
    """By how much the cameras of some frames and of the others differ: px, and of what their covariances say."""
    one, other = (fitted(data.of_views(np.flatnonzero(p)))[0] for p in (part, ~part))
    d = one.camera.params - other.camera.params
    both = covariance(one).matrix + covariance(other).matrix
    free = np.flatnonzero(np.diag(both) > 0)
    chi2 = d[free] @ np.linalg.solve(both[np.ix_(free, free)], d[free]) / len(free)
    return difference(one.camera, other.camera, data.uv).rms_px, float(chi2)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("film", type=Path)
    parser.add_argument("--target")
    parser.add_argument("--splits", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    rows, cameras = [], []
    for name, how in (("chosen", {}), ("all", {"every": 1, "keep_frames": None})):
        said, found = run(options.film, options.target, **how)
        start = time.perf_counter()
        solution = camcal.calibrate(found, model="opencv5")
        spent = time.perf_counter() - start
        cameras.append(solution.camera)
        rate = f"{said['decoded'] / said['seconds']:.1f}"
        counts = (int(said["decoded"]), int(said["searched"]), int(said["kept"]))
        rows.append((name, *counts, rate, f"{spent:.1f}", f"{solution.camera.values['fx']:.2f}",
                     f"{solution.rms_point:.4f}"))  # fmt: skip
    apart = difference(*cameras, image_grid(np.zeros(2), np.array(cameras[0].image_size) - 1.0))
    header = (
        "frames",
        "decoded",
        "searched",
        "kept",
        "frames/s",
        "calibration s",
        "fx",
        "rms px",
    )
    table = markdown(header, rows)
    print(table)
    print(
        f"projections apart after the best rotation: rms {apart.rms_px:.3f} px, at most {apart.max_px:.3f} px"
    )
    if options.update:
        update(options.update, "films", table)
    if options.splits:
        table, said = split_table(options.film, found, options.splits, options.seed)
        print(table, said, sep="\n")
        if options.update:
            update(options.update, "films-held-out", table)


if __name__ == "__main__":
    main()
