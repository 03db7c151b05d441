"""How often the 95 % intervals hold the truth: parameters, poses and projections of simulated calibrations.

Each run draws a camera (the model's example, its values scattered by a few per cent), 8 to 40 views of a board,
noise of 0.05 to 0.5 px, and calibrates from nothing, in turn without a look at outliers, with `--robust auto`, and
with `auto` and `huber` where 1 % of the points are moved by 5 to 60 px. An interval is value +- t sigma, with
Student's t for 2N - p degrees of freedom (1.960 to 1.965 here); sigmas are those of the report, infinite ones are
counted apart. Poses are in the coordinates of their covariance: a rotation vector on the left, and the place of
the centroid of the view's points.

A projection is what `camcal.assess.uncertainty` defines: a point of the camera's frame is held to the boards
by the estimated poses, the true poses put it where the boards say on average, and there the true camera sees it.
The difference must lie in the ellipse of 95 % (Hotelling's: 2 F of 2 and 2N - p degrees of freedom). Where the
uncertainty is infinite, or the estimated camera does not see, there is no figure; these are counted apart.

Usage: python benchmarks/coverage_study.py [--runs 1000] [--models opencv5,kb4] [--arms given] [--jobs 1] [--seed 0]
    [--log FILE] [--write]
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import json
import multiprocessing
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats
from tables import kept, markdown, update

from camcal.assess.covariance import Covariance
from camcal.assess.curvature import accuracy as accuracy_of
from camcal.assess.figures import redundancy
from camcal.assess.uncertainty import board_distance, projection_uncertainty
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.placement import Spread, simulate_poses
from camcal.model.pose import Array, Poses
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import Solution
from camcal.study.cameras import example_camera
from camcal.study.points import simulate_points

#: a lens whose image radius grows with the angle, as the rational model has it: the Padé approximant [3/3] of
#: atan(r) / r. Over the 120 degrees of the picture's diagonal no polynomial of three terms comes near: it needs its
#: denominator
EQUIDISTANT = "opencv8 of 120 degrees"
MODELS = (
    "pinhole", "opencv4", "opencv5", "opencv8", EQUIDISTANT, "brown:radial=3,decentering=1", "kb4", "ucm", "ds",
    "division:1",
)  # fmt: skip
GIVEN = "auto, given sigmas"
ARMS = ("none", "auto", "auto, 1 % outliers", "huber, 1 % outliers", GIVEN)
KINDS = ("parameter", "pose", "infinite")
NO_FIGURE = "no figure"
PLACES = tuple(f"{p}, {d}" for p in ("centre", "anywhere", "corners") for d in ("board distance", "infinity"))
PAGE = Path(__file__).parents[1] / "docs" / "trust-figures.md"
LEVEL = 0.95
WANTED = (0.93, 0.97)
TURNS = ("rotation x", "rotation y", "rotation z", "place x", "place y", "place z")

#: (what, name) -> hits of one run
Hits = dict[tuple[str, str], Array]


def true_camera(name: str, rng: np.random.Generator) -> Camera:
    """The example lens of a model, its parameters scattered by 3 %."""
    truth = example_camera("opencv8" if name == EQUIDISTANT else name)
    params = truth.params
    if name == EQUIDISTANT:
        size = (1280, 960)
        focal = np.hypot(*size) / 2 / np.deg2rad(60)
        values = {"fx": focal, "fy": focal, "cx": 639.5, "cy": 479.5, "p1": 0.0, "p2": 0.0}
        over = np.array([19250, 5943, 256, 24255, 11025, 1225]) / 15015
        values |= {f"k{i + 1}": float(k) for i, k in enumerate(over)}
        truth, params = replace(truth, image_size=size), truth.lens.from_values(values)
        # of focal length and centre only: the coefficients of a fraction do not scatter one by one
        return replace(truth, params=params * np.r_[rng.uniform(0.97, 1.03, 4), np.ones(len(params) - 4)])
    return replace(truth, params=params * rng.uniform(0.97, 1.03, truth.lens.size))


def truth_and_data(model: str, rng: np.random.Generator, outliers: float, given: bool = False):
    """A camera, poses, and what is seen of a board of 9x6, 7x5 or 12x9 points.

    With `given`, each point has noise of its own, from a quarter to four times that of the run, and its sigma.
    """
    truth = true_camera(model, rng)
    columns, rows = ((9, 6), (7, 5), (12, 9))[rng.integers(3)]
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    board = np.c_[x.ravel(), y.ravel(), 0 * x.ravel()] * 0.03
    poses = simulate_poses(board, truth, rng, int(rng.integers(8, 41)), Spread())
    noise = float(np.exp(rng.uniform(*np.log([0.05, 0.5]))))
    data = simulate_points(truth, board, poses, rng, 0.0 if given else noise, outliers)
    if given:
        sigma = noise * np.exp(rng.uniform(-np.log(4), np.log(4), data.point_count))
        data = replace(data, uv=data.uv + rng.normal(size=data.uv.shape) * sigma[:, None], sigma=sigma)
    return truth, poses, data


def run(task: tuple[str, str, int]) -> tuple[str, str, int, Hits]:
    """One calibration: model, arm, seed, and what the intervals held; nothing where it ended in an error."""
    model, arm, seed = task
    rng = np.random.default_rng([seed, *model.encode()])
    truth, poses, data = truth_and_data(model, rng, 0.01 if "outliers" in arm else 0.0, "given" in arm)
    try:
        solution = calibrate(data, model=truth.lens.name, robust=arm.split(",")[0], checks=False)
    except CamcalError:
        return *task, {}
    kept = [v.id for v in solution.observations.views]
    index = [i for i, v in enumerate(data.views) if v.id in kept]
    return *task, hits(solution, truth, poses[np.array(index)], rng)


def hits(solution: Solution, truth: Camera, poses: Poses, rng: np.random.Generator) -> Hits:
    """What the intervals of a solution hold of the truth."""
    accuracy = accuracy_of(solution)
    freedom = redundancy(solution)
    reach = stats.t.ppf((1 + LEVEL) / 2, freedom)
    found: Hits = {}
    error = solution.camera.params - truth.params
    for name, e in zip(truth.lens.names, error, strict=True):
        sigma = accuracy.sigmas[name]
        found["infinite", name] = np.array([np.isinf(sigma)])
        found["parameter", name] = np.array([abs(e) <= reach * sigma])[: int(np.isfinite(sigma))]
    own, spread = pose_errors(solution, poses, accuracy)
    for i, name in enumerate(TURNS):
        found["pose", name] = np.abs(own[:, i]) <= reach * spread[:, i]
    ellipse = 2 * stats.f.ppf(LEVEL, 2, freedom)
    for name, squares in projections(solution, truth, poses, accuracy, rng):
        stated = np.isfinite(squares)
        found["projection", name] = squares[stated] <= ellipse
        found[NO_FIGURE, name] = ~stated
    return found


def pose_errors(solution: Solution, poses: Poses, accuracy: Covariance) -> tuple[Array, Array]:
    """Errors and sigmas (V, 6) of the poses in the coordinates of their covariance."""
    errors = []
    for view, pose, true in zip(solution.observations.kept().views, solution.poses, poses, strict=True):
        centre = view.xyz.mean(0)
        turn = rotations.log(pose.rotation @ true.rotation.T)
        errors.append(np.r_[turn, pose.apply(centre) - true.apply(centre)])
    return np.array(errors), np.sqrt(np.diagonal(accuracy.poses(), axis1=1, axis2=2))


def projections(
    solution: Solution, truth: Camera, poses: Poses, accuracy: Covariance, rng: np.random.Generator
) -> Iterator[tuple[str, Array]]:
    """Squared Mahalanobis lengths of the errors of projections, by place and distance.

    NaN where the uncertainty is infinite, or the estimated camera says that it does not see there.
    """
    uncertainty = projection_uncertainty(solution, accuracy)  # of the linear part, whatever is infinite
    size = np.array(truth.image_size) - 1.0
    places = {
        "centre": size[None] / 2,
        "anywhere": rng.random((1, 2)) * size,
        "corners": np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size,
    }
    for place, pixels in places.items():
        for name, distance in (("board distance", board_distance(solution)), ("infinity", np.inf)):
            difference = truly_seen(solution, truth, poses, pixels, distance) - pixels
            spread = uncertainty.at_pixels(pixels, distance)
            squares, stated = np.full(len(pixels), np.nan), np.isfinite(spread).all((1, 2))
            # where the true camera sees nothing, a finite figure is wrong
            error = np.nan_to_num(difference[stated], nan=np.inf)
            squares[stated] = np.einsum("ni,nij,nj->n", error, np.linalg.inv(spread[stated]), error)
            yield f"{place}, {name}", np.nan_to_num(squares, nan=np.nan, posinf=1e300)


def truly_seen(solution: Solution, truth: Camera, poses: Poses, pixels: Array, distance: float) -> Array:
    """Where the true camera sees (N, 2) the points that the estimated one sees at pixels (N, 2)."""
    rays = solution.camera.unproject(pixels)
    turns = poses.rotations @ solution.poses.rotations.transpose(0, 2, 1)
    if np.isinf(distance):
        return truth.project(rays @ turns.mean(0).T)
    shifts = poses.translations - np.einsum("vij,vj->vi", turns, solution.poses.translations)
    return truth.project(rays * distance @ turns.mean(0).T + shifts.mean(0))


# ------------------------------------------------------------------ tables
def share(found: list[Array]) -> tuple[float, float]:
    """The share of hits over all runs and its standard error; the hits of one run are not independent."""
    hit = np.array([h.sum() for h in found], float)
    of = np.array([len(h) for h in found], float)
    p = hit.sum() / of.sum()
    error = float(np.sqrt(np.square(hit - p * of).sum()) / of.sum())
    return p, error or float(np.sqrt(LEVEL * (1 - LEVEL) / of.sum()))


def percent(found: list[Array]) -> str:
    """In per cent; bold outside 93 to 97 % by more than two standard errors."""
    if not sum(map(len, found)):
        return ""
    p, error = share(found)
    text = f"{100 * p:.1f} ± {100 * error:.1f}"
    return f"**{text}**" if p + 2 * error < WANTED[0] or p - 2 * error > WANTED[1] else text


Kinds = Mapping[tuple[str, str], list[Array]]


def pooled(kinds: Kinds, what: str) -> list[Array]:
    """The hits of all intervals of a kind, run by run."""
    runs = zip(*(found for (kind, _), found in kinds.items() if kind == what), strict=True)
    return [np.concatenate(run) for run in runs]


def overview(by: Mapping[str, Kinds], first: str) -> str:
    """Rows of models or arms."""
    rows = []
    for name, kinds in by.items():
        infinite = np.concatenate(pooled(kinds, "infinite"))
        row = [f"`{name}`", len(next(iter(kinds.values()))), percent(pooled(kinds, "parameter"))]
        row += [f"{infinite.mean():.0%}" if infinite.any() else "none", percent(pooled(kinds, "pose"))]
        row += [percent(kinds["projection", p]) for p in PLACES]
        rows.append(
            [*row, ", ".join(f"{np.concatenate(kinds[NO_FIGURE, p]).mean():.0%}" for p in PLACES[-2:])]
        )
    header = [first, "runs", "parameters", "infinite", "poses", *PLACES, "corners without a figure"]
    return markdown(header, rows)


def by_parameter(by_model: Mapping[str, Kinds]) -> str:
    """Every parameter, and every coordinate of a pose."""
    rows = []
    for model, kinds in by_model.items():
        for what in ("parameter", "pose"):
            said = [f"{n} {percent(f)}" for (k, n), f in kinds.items() if k == what and percent(f)]
            rows.append([f"`{model}`" if what == "parameter" else "", what, ", ".join(said)])
    return markdown(["model", "of", "share of 95 % intervals that contain the true value, per cent"], rows)


def logged(tasks: list[tuple[str, str, int]], log: Path | None, jobs: int) -> list[tuple[str, str, Hits]]:
    """Model, arm and hits of all runs of some tasks; those in the log are not made again."""
    lines = kept(log)
    done, chosen = {tuple(line[:3]) for line in lines}, {task[:2] for task in tasks}
    with multiprocessing.Pool(jobs) as pool, log.open("a") if log else contextlib.nullcontext() as file:
        for *task, found in pool.imap_unordered(run, [t for t in tasks if t not in done], chunksize=4):
            lines.append([*task, [[*key, hit.astype(int).tolist()] for key, hit in found.items()]])
            if file is not None:
                print(json.dumps(lines[-1]), file=file, flush=True)
    return [
        (model, arm, {(what, name): np.array(hit, bool) for what, name, hit in found})
        for model, arm, _, found in lines
        if (model, arm) in chosen
    ]


def study(runs: list[tuple[str, str, Hits]]) -> tuple[dict[str, Kinds], dict[str, Kinds], int]:
    """Hits by model and by arm, and how many calibrations ended in an error."""
    by_model: dict = collections.defaultdict(lambda: collections.defaultdict(list))
    by_arm: dict = collections.defaultdict(lambda: collections.defaultdict(list))
    for model, arm, found in runs:
        for key, hit in found.items():
            by_model[model][key].append(hit)
        if found:
            for what in KINDS:
                by_arm[arm][what, "all"].append(np.concatenate([h for k, h in found.items() if k[0] == what]))
            for place in PLACES:
                for what in ("projection", NO_FIGURE):
                    by_arm[arm][what, place].append(found[what, place])
    return by_model, by_arm, sum(not found for _, _, found in runs)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, default in (("runs", 1000), ("jobs", 1), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--models", help="those that begin with one of these words (commas)")
    parser.add_argument("--arms", help="only treatments of outliers with this word: none, auto, huber, given")
    parser.add_argument(
        "--log", type=Path, help="file for the runs, a line each; those in it are not made again"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into docs/trust-figures.md")
    told = parser.parse_args()
    models = [m for m in MODELS if told.models is None or m.startswith(tuple(told.models.split(",")))]
    arms = [a for a in ARMS if told.arms is None or told.arms in a]
    tasks = [(m, arms[s % len(arms)], s) for s in range(told.seed, told.seed + told.runs) for m in models]
    begin = time.perf_counter()
    runs = logged(tasks, told.log, told.jobs)
    by_model, by_arm, failed = study(runs)
    of_models = {m: by_model[m] for m in MODELS if m in by_model}
    if arms == [GIVEN]:  # a page of its own: the sigmas are given and true
        tables = {"given": overview(of_models, "model"), "given-parameters": by_parameter(of_models)}
    else:
        tables = {"models": overview(of_models, "model"), "parameters": by_parameter(of_models)}
        tables["robust"] = overview({a: by_arm[a] for a in ARMS if a in by_arm}, "outliers")
    for name, table in tables.items():
        print(f"{name}\n{table}\n")
        if told.write:
            update(PAGE, f"coverage-{name}", table)
    print(f"{failed} of {len(runs)} ended in an error; {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
