"""How often the 95 % intervals hold the truth: parameters, poses and projections of simulated calibrations.

Each run draws a camera (the model's example, its values scattered by a few per cent), 8 to 40 views of a board,
noise of 0.05 to 0.5 px, and calibrates from nothing, in turn without a look at outliers, with `--robust auto`, and
with `auto` and `huber` where 1 % of the points are moved by 5 to 60 px. An interval is value +- t sigma, with
Student's t for 2N - p degrees of freedom (1.960 to 1.965 here); sigmas are those of the report, infinite ones are
counted apart. Poses are in the coordinates of their covariance: a rotation vector on the left, and the place of
the centroid of the view's points.

A projection is what `camcal.assess.uncertainty` defines: a point of the camera's frame is held to the boards
by the estimated poses, the true poses put it where the boards say on average, and there the true camera sees it.
The difference must lie in the ellipse of 95 % (Hotelling's: 2 F of 2 and 2N - p degrees of freedom).

Usage: python benchmarks/coverage_study.py [--runs 1000] [--models opencv5,kb4] [--jobs 1] [--seed 0] [--write]
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats
from tables import markdown, update

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

MODELS = (
    "pinhole", "opencv4", "opencv5", "opencv8", "brown:radial=3,decentering=1", "kb4", "ucm", "ds", "division:1",
)  # fmt: skip
ARMS = ("none", "auto", "auto, 1 % outliers", "huber, 1 % outliers", "auto, given sigmas")
KINDS = ("parameter", "pose", "infinite")
PLACES = tuple(f"{p}, {d}" for p in ("centre", "anywhere", "corners") for d in ("board distance", "infinity"))
PAGE = Path(__file__).parents[1] / "docs" / "trust-figures.md"
LEVEL = 0.95
WANTED = (0.93, 0.97)
TURNS = ("rotation x", "rotation y", "rotation z", "place x", "place y", "place z")

#: (what, name) -> hits of one run
Hits = dict[tuple[str, str], Array]


def truth_and_data(model: str, rng: np.random.Generator, outliers: float, given: bool = False):
    """A camera, poses, and what is seen of a board of 9x6, 7x5 or 12x9 points.

    With `given`, each point has noise of its own, from a quarter to four times that of the run, and its sigma.
    """
    truth = example_camera(model)
    truth = Camera(truth.lens, truth.params * rng.uniform(0.97, 1.03, truth.lens.size), truth.image_size)
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


def run(task: tuple[str, int]) -> tuple[str, str, Hits]:
    """One calibration: model, arm, and what the intervals held."""
    model, seed = task
    arm = ARMS[seed % len(ARMS)]
    rng = np.random.default_rng([seed, MODELS.index(model)])
    truth, poses, data = truth_and_data(model, rng, 0.01 if "outliers" in arm else 0.0, "given" in arm)
    try:
        solution = calibrate(data, model=model, robust=arm.split(",")[0], checks=False)
    except CamcalError:
        return model, arm, {}
    kept = [v.id for v in solution.observations.views]
    index = [i for i, v in enumerate(data.views) if v.id in kept]
    return model, arm, hits(solution, truth, poses[np.array(index)], rng)


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
        found["projection", name] = squares <= ellipse
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
    """Squared Mahalanobis lengths of the errors of projections, by place and distance."""
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
            good = np.isfinite(difference).all(1) & np.isfinite(spread).all((1, 2))
            solved = np.linalg.solve(spread[good], difference[good, :, None])[..., 0]
            yield f"{place}, {name}", np.einsum("ni,ni->n", difference[good], solved)


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
        rows.append([*row, *(percent(kinds["projection", p]) for p in PLACES)])
    return markdown([first, "runs", "parameters", "infinite", "poses", *PLACES], rows)


def by_parameter(by_model: Mapping[str, Kinds]) -> str:
    """Every parameter, and every coordinate of a pose."""
    rows = []
    for model, kinds in by_model.items():
        for what in ("parameter", "pose"):
            said = [f"{n} {percent(f)}" for (k, n), f in kinds.items() if k == what and percent(f)]
            rows.append([f"`{model}`" if what == "parameter" else "", what, ", ".join(said)])
    return markdown(["model", "of", "share of 95 % intervals that hold the truth, per cent"], rows)


def study(
    models: list[str], runs: int, seed: int, jobs: int
) -> tuple[dict[str, Kinds], dict[str, Kinds], int]:
    """Hits by model and by arm, and how many calibrations ended in an error."""
    by_model: dict = {m: collections.defaultdict(list) for m in models}
    by_arm: dict = {a: collections.defaultdict(list) for a in ARMS}
    failed = 0
    with multiprocessing.Pool(jobs) as pool:
        for model, arm, found in pool.imap(
            run, [(m, seed + i) for m in models for i in range(runs)], chunksize=8
        ):
            failed += not found
            for key, hit in found.items():
                by_model[model][key].append(hit)
            if found:
                for what in KINDS:
                    by_arm[arm][what, "all"].append(
                        np.concatenate([h for k, h in found.items() if k[0] == what])
                    )
                for place in PLACES:
                    by_arm[arm]["projection", place].append(found["projection", place])
    return by_model, by_arm, failed


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, default in (("runs", 1000), ("jobs", 1), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--models", help="comma-separated, without options")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/trust-figures.md")
    told = parser.parse_args()
    models = [m for m in MODELS if told.models is None or m.split(":")[0] in told.models.split(",")]
    begin = time.perf_counter()
    by_model, by_arm, failed = study(models, told.runs, told.seed, told.jobs)
    tables = {"models": overview(by_model, "model"), "parameters": by_parameter(by_model)}
    tables["robust"] = overview({a: k for a, k in by_arm.items() if k}, "outliers")
    for name, table in tables.items():
        print(f"{name}\n{table}\n")
        if told.write:
            update(PAGE, f"coverage-{name}", table)
    print(f"{failed} of {len(models) * told.runs} ended in an error; {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
