"""What outliers do to a calibration, and what guarding against them costs on clean data.

Breakdown: a growing share of the points of boards (12 views of 9x6, 0.2 px noise) is spoilt, and the camera is
compared with the truth: camcal's default (`--robust auto`), cv2.calibrateCamera, and Levenberg-Marquardt with
Huber's loss (iteratively reweighted from the least squares fit to all points). The errors are those of the focal
lengths, px, and of what the camera projects (root mean square over the picture after the best-fitting rotation).

Clean data: the variance of least squares over that of each `--robust` method on the same Gaussian noise (the
relative efficiency), the ratio of their times, taken in turn, and how many runs of `auto` reject anything at all.

Usage: OPENBLAS_NUM_THREADS=1 python benchmarks/robust.py [--runs 20] [--alarms 2500]
    [--figure docs/figures/breakdown.svg] [--update docs/robustness.md]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import poisson
from tables import markdown, update

import camcal
from camcal.assess.difference import difference
from camcal.data.observations import Correspondences
from camcal.errors import CamcalError
from camcal.model.camera import Camera
from camcal.model.placement import simulate_poses
from camcal.model.pose import Array
from camcal.solve import outliers
from camcal.solve.losses import LOSSES
from camcal.solve.refine import How
from camcal.solve.robust import METHODS, reweight
from camcal.study.cameras import example_camera
from camcal.study.points import outlier_moves, simulate_points

NOISE = 0.2
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4)
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0), [0.0]), -1).reshape(-1, 3)
#: a camera that does not see this part of the picture is none
LOST = 0.05
#: Okabe and Ito's colours
LINES = (("#0072B2", "o-"), ("#D55E00", "s-"), ("#009E73", "^--"))

Spoil = Callable[[Correspondences, float, np.random.Generator], Correspondences]
Calibrate = Callable[[Correspondences], Camera]


# ---------------------------------------------------------------------- data
def clean(camera: Camera, rng: np.random.Generator, views: int = 12, noise: float = NOISE) -> Correspondences:
    """Boards with Gaussian noise."""
    return simulate_points(camera, GRID, simulate_poses(GRID, camera, rng, views), rng, noise, clip=False)


def in_each_view(spoil: Callable[[Array, Array, np.random.Generator], None]) -> Spoil:
    """Spoil a share of the points of each view; `spoil` changes the rows `chosen` of uv in place."""

    def apply(data: Correspondences, share: float, rng: np.random.Generator) -> Correspondences:
        views = []
        for view in data.views:
            uv, chosen = view.uv.copy(), rng.choice(len(view), round(share * len(view)), replace=False)
            spoil(uv, chosen, rng)
            views.append(replace(view, uv=uv))
        return data.with_views(tuple(views))

    return apply


def moved(uv: Array, chosen: Array, rng: np.random.Generator) -> None:
    """By 5 to 60 px in any direction."""
    uv[chosen] += outlier_moves(len(chosen), 1.0, rng)


def anywhere(uv: Array, chosen: Array, rng: np.random.Generator) -> None:
    """To any place in the picture."""
    uv[chosen] = rng.uniform(0, (639, 479), (len(chosen), 2))


def exchanged(uv: Array, chosen: Array, rng: np.random.Generator) -> None:
    """Taken for one another: a cycle of wrong matches."""
    uv[chosen] = uv[np.roll(chosen, 1)]


def whole_views(data: Correspondences, share: float, rng: np.random.Generator) -> Correspondences:
    """All points of a share of the views are exchanged, the other views are good."""
    views = list(data.views)
    for i in rng.choice(len(views), round(share * len(views)), replace=False):
        views[i] = replace(views[i], uv=rng.permutation(views[i].uv))
    return data.with_views(tuple(views))


KINDS: dict[str, Spoil] = {
    "moved": in_each_view(moved),
    "anywhere": in_each_view(anywhere),
    "exchanged": in_each_view(exchanged),
    "views": whole_views,
}


# ---------------------------------------------------------------------- methods
def by_camcal(data: Correspondences) -> Camera:
    """The default of the commands."""
    return camcal.calibrate(data, robust="auto", checks=False).camera


def by_cv2(data: Correspondences) -> Camera:
    """cv2.calibrateCamera with its default flags."""
    xyz, uv = ([getattr(v, k).astype(np.float32) for v in data.views] for k in ("xyz", "uv"))
    _, matrix, k, *_ = cv2.calibrateCamera(xyz, uv, data.image_size, None, None)
    lens = camcal.model.lenses.make("opencv5")
    values = dict(zip(("k1", "k2", "p1", "p2", "k3"), k.ravel().tolist(), strict=False))
    values |= {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    return Camera(lens, lens.from_values(values), data.image_size)


def by_huber(data: Correspondences) -> Camera:
    """Least squares on all points, then Huber's loss from there."""
    plain = camcal.calibrate(data, robust="none", checks=False)
    return reweight(plain, How(), LOSSES["huber"], rounds=15).camera


WAYS: dict[str, Calibrate] = {"camcal": by_camcal, "cv2": by_cv2, "LM + Huber": by_huber}


def errors(calibrate: Calibrate, data: Correspondences, truth: Camera) -> tuple[float, float]:
    """Error of the focal lengths and of the projection, px; infinite where there is no camera."""
    try:
        found = calibrate(data)
    except (CamcalError, cv2.error):
        return np.inf, np.inf
    focal = float(np.sqrt(np.mean((found.params[:2] - truth.params[:2]) ** 2)))
    apart = difference(truth, found)
    return focal, apart.rms_px if apart.outside <= LOST * len(apart.pixels) else np.inf


# ---------------------------------------------------------------------- tables
def breakdown(kind: str, runs: int, curves: dict[str, dict[str, Array]]) -> str:
    """Errors against the share of outliers (medians over runs), and those at 20 % over those of clean data.

    The medians also go to `curves`, by kind and method.
    """
    truth, spoil = example_camera("opencv5"), KINDS[kind]
    found = {name: np.empty((len(SHARES), runs, 2)) for name in WAYS}
    for i, share in enumerate(SHARES):
        for run in range(runs):
            rng = np.random.default_rng([run, 1])
            data = spoil(clean(truth, rng), share, rng)
            for name, calibrate in WAYS.items():
                found[name][i, run] = errors(calibrate, data, truth)
        print(
            kind, share, {n: np.median(e[i], axis=0).round(3).tolist() for n, e in found.items()}, flush=True
        )
    header = ["outliers", *(f"{n}: f" for n in WAYS), *(f"{n}: projection" for n in WAYS)]
    medians = curves[kind] = {name: np.median(e, axis=1) for name, e in found.items()}
    rows = [
        [f"{share:.0%}", *(_px(medians[n][i][k]) for k in (0, 1) for n in WAYS)]
        for i, share in enumerate(SHARES)
    ]
    spread = np.sqrt(np.square(found["camcal"]).mean(1))
    f, p = spread[SHARES.index(0.2)] / spread[0]
    worst = found["camcal"][SHARES.index(0.2), :, 1].max() / found["camcal"][0, :, 1].max()
    return (
        f"{markdown(header, rows)}\n\nMedians of {runs} runs, px. At 20 % the root mean square of camcal's errors is "
        f"{f:.2f} (f) and {p:.2f} (projection) times that of clean data; the worst run's projection {worst:.2f} times."
    )


def draw(curves: dict[str, dict[str, Array]]) -> Figure:
    """The breakdown curves; a line ends where there is no camera."""
    figure = Figure(figsize=(8.5, 6), layout="constrained")
    axes = figure.subplots(2, len(curves), sharex=True, sharey="row", squeeze=False)
    for column, (kind, medians) in zip(axes.T, curves.items(), strict=True):
        for k, axis in enumerate(column):
            for (name, values), (colour, line) in zip(medians.items(), LINES, strict=True):
                shown = np.where(np.isfinite(values[:, k]), values[:, k], np.nan)
                axis.semilogy([100 * s for s in SHARES], shown, line, color=colour, label=name, lw=1.5, ms=4)
            axis.grid(alpha=0.3)
        column[0].set_title(kind, fontsize=10)
        column[1].set_xlabel("outliers (%)")
    axes[0, 0].set_ylabel("error of f (px)")
    axes[1, 0].set_ylabel("error of projection (px)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), ncols=3, loc="outside upper center")
    return figure


def _px(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "no camera"


def on_clean_data(runs: int) -> str:
    """Relative efficiency and time of each method against least squares."""
    truth = example_camera("opencv5")
    focal: dict[str, list[Array]] = {m: [] for m in METHODS}
    seconds: dict[str, list[float]] = {m: [] for m in METHODS}
    for run in range(runs):
        data = clean(truth, np.random.default_rng([run, 2]))
        for method in METHODS:
            begin = time.perf_counter()
            found = camcal.calibrate(data, robust=method, checks=False)
            seconds[method].append(time.perf_counter() - begin)
            focal[method].append(found.camera.params - truth.params)
    plain = np.square(focal["none"]).mean(0)
    rows = []
    for method in METHODS:
        efficiency = plain / np.square(focal[method]).mean(0)
        ratio = np.median(np.divide(seconds[method], seconds["none"]))
        rows.append(
            [f"`{method}`", f"{efficiency[:2].mean():.3f}", f"{efficiency.mean():.3f}", f"{ratio:.2f}"]
        )
    return markdown(["`--robust`", "efficiency of fx, fy", "of all parameters", "time"], rows)


def alarms(runs: int, sizes: Sequence[int] = (3, 12, 40)) -> str:
    """How many runs on Gaussian noise reject a point or a view, against the stated rate."""
    truth, rows = example_camera("opencv5"), []
    for views in sizes:
        count = max(runs * 12 // max(views, 12), 1)
        points = seen = begun = 0
        for run in range(count):
            data = clean(truth, np.random.default_rng([run, views, 3]), views)
            found = camcal.calibrate(data, robust="auto", checks=False)
            lost = data.point_count - int(found.used.sum())
            points, seen, begun = points + lost, seen + bool(lost), begun + ("robust" in found.fit.info)
        # how likely so many or more are at the stated rate
        chance = float(poisson.sf(seen - 1, outliers.ALPHA * count))
        rows.append([views, count, seen, f"{outliers.ALPHA * count:.1f}", f"{chance:.2g}", points, begun])
        print("alarms", rows[-1], flush=True)
    header = ["views", "runs", "with a rejection", "stated", "p of so many", "points rejected", "begun again"]
    return markdown(header, rows)


def main() -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--alarms", type=int, default=2500, help="runs on Gaussian noise")
    parser.add_argument("--update", type=Path, metavar="PAGE")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the curves (SVG)")
    parser.add_argument("--only", help="one of the tables")
    told = parser.parse_args()
    curves: dict[str, dict[str, Array]] = {}
    tables: dict[str, Callable[[], str]] = {
        f"breakdown-{kind}": partial(breakdown, kind, told.runs, curves) for kind in KINDS
    }
    tables |= {"clean": partial(on_clean_data, 5 * told.runs), "alarms": partial(alarms, told.alarms)}
    for name, make in tables.items():
        if told.only not in (None, name):
            continue
        text = make()
        print(f"\n{name}\n{text}\n", flush=True)
        if told.update is not None:
            update(told.update, name, text)
    if told.figure is not None and curves:
        draw(curves).savefig(told.figure, metadata={"Date": None})


if __name__ == "__main__":
    main()
