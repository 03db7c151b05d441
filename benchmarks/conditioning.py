"""Digits lost to bad conditioning, with and without normalisation, on exact data whose answer is known.

Scenes: the example of Barranco & Medel (2009), whose matrix C has a condition number of 2e6 (its camera as
published, from the reference data beside the project); a rig whose coordinates are those of a national grid,
1e6 m from the origin, with details of a metre; boards seen through a long lens, where perspective nearly
vanishes. Image points are computed from the truth, so that all that is lost is lost by the equations.

Digits kept = -log10 of the largest error of a reprojected point against the picture's size (linear stages), or
of the step's error against its length (steps of the refinement, the exact step being that of the same Jacobian
in extended precision).

Usage: python benchmarks/conditioning.py [--update docs/solvers.md]
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tables import markdown, update

from camcal.assess import conditioning
from camcal.data.observations import Correspondences, View
from camcal.errors import CamcalError
from camcal.geometry import projective, rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.solve import rows, tangent
from camcal.solve.condition import condition
from camcal.solve.linear import Linear
from camcal.solve.optimizers import make
from camcal.solve.problem import Problem, State
from camcal.start import central, dlt, zhang
from camcal.start.base import ClosedForm

DATA = Path(os.environ.get("CAMCAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SIZE = (1000, 800)


@dataclass(frozen=True)
class Scene:
    """A camera that is known, and what it sees exactly."""

    name: str
    camera: Camera
    poses: Poses
    data: Correspondences


def scene(name: str, camera: Camera, poses: Poses, points: list[np.ndarray]) -> Scene:
    views = [
        View(f"v{i}", xyz, camera.project(pose.apply(xyz)))
        for i, (xyz, pose) in enumerate(zip(points, poses, strict=True))
    ]
    return Scene(name, camera, poses, Correspondences.from_views(tuple(views), camera.image_size))


def pinhole(f: float) -> Camera:
    lens = lenses.make("pinhole")
    return Camera(lens, lens.pinhole(f, 1.002 * f, 503.0, 396.0), SIZE)


def papers_example() -> Scene | None:
    path = DATA / "barranco_medel" / "points.csv"
    if not path.exists():
        print(
            "the reference data is not here (../shared/data or $CAMCAL_DATA): the paper's example is skipped"
        )
        return None
    with path.open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    xyz = np.array([[float(row[k]) for k in "XYZ"] for row in table])
    lens = lenses.make("pinhole", skew=True)
    camera = Camera(lens, lens.pinhole(657.3025, 657.7439, 302.7166, 242.3339, 0.2761), (640, 480))
    # R = I and t as the printed matrix fixes it, up to ty
    poses = Poses(np.eye(3)[None], np.array([[3.2360, 0.0, 1.31706]]))
    return scene("paper's example", camera, poses, [xyz])


def national_grid() -> Scene:
    rng = np.random.default_rng(1)
    origin = np.array([2.6e6, 1.2e6, 450.0])
    local = np.round(rng.uniform(-2, 2, (60, 3)), 3)
    rotation = rotations.exp(np.array([0.4, -0.3, 0.2]))
    shift = np.array([0.2, -0.1, 9.0]) - rotation @ origin
    return scene(
        "national grid, 1e6 m", pinhole(1400.0), Poses(rotation[None], shift[None]), [local + origin]
    )


def long_lens() -> Scene:
    """Boards of 0.2 m at 40 m through 80 000 px: depths differ by less than half a percent."""
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(np.arange(9), np.arange(6)), -1).reshape(-1, 2) * 0.025
    board = np.c_[grid, np.zeros(len(grid))]
    turned = rotations.exp(rng.uniform(-0.6, 0.6, (12, 3)))
    centres = np.c_[rng.uniform(-0.1, 0.1, (12, 2)), rng.uniform(38, 42, 12)]
    shifts = centres - turned @ board.mean(0)
    return scene("long lens, boards", pinhole(80_000.0), Poses(turned, shifts), [board] * 12)


def scenes() -> Iterator[Scene]:
    paper = papers_example()
    if paper is not None:
        yield paper
    yield national_grid()
    yield long_lens()


# ---------------------------------------------------------------------- linear stages
def linear_rows(case: Scene) -> Iterator[list[str]]:
    estimators: dict[str, Callable[..., ClosedForm]] = {"central": central.estimate, "dlt": dlt.estimate}
    if len(case.data.views) > 1:
        estimators = {"zhang": zhang.estimate}
    for name, estimate in estimators.items():
        before, after = _conditions(name, case)
        kept = [_digits(case, estimate, normalise) for normalise in (False, True)]
        yield [case.name, name, f"{before:.1e}", f"{after:.1e}", *kept]


def _conditions(name: str, case: Scene) -> tuple[float, float]:
    both = conditioning.linear(name, case.data)
    assert both is not None
    return both["before"], both["after"]


def _digits(case: Scene, estimate: Callable[..., ClosedForm], normalise: bool) -> str:
    try:
        found = estimate(case.data, skew=True, normalise=normalise)
    except CamcalError as error:
        return f"none: {error.message.split(':')[-1].split(';')[0].strip()}"
    worst = 0.0
    for i, view in enumerate(case.data.views):
        matrix = found.projection_matrix
        if matrix is None:
            matrix = found.matrix @ np.c_[found.poses.rotations[i], found.poses.translations[i]]
        worst = max(worst, float(np.abs(projective.project(matrix, view.xyz) - view.uv).max()))
    return _kept(worst / max(SIZE))


def _kept(error: float) -> str:
    return f"{max(-np.log10(max(error, 1e-17)), 0.0):.1f}" if np.isfinite(error) else "0.0"


# ---------------------------------------------------------------------- refinement
def refinement_rows(case: Scene) -> Iterator[list[str]]:
    """Steps by both forms, and the camera they lead to from a start that is off."""
    for normalise in (False, True):
        problem, state = _started(case, normalise)
        cond = condition(problem, state, normalise)
        cells = [_step_digits(problem, state, form) for form in ("schur", "qr")]
        cells += [_camera_digits(case, problem, state, form) for form in ("schur", "qr", "auto")]
        yield [case.name, "yes" if normalise else "no", f"{cond:.1e}", *cells]


def _started(case: Scene, normalise: bool) -> tuple[Problem, State]:
    lens = case.camera.lens
    free = np.eye(lens.size)
    problem = Problem(lens, case.data.views, free, normalise=normalise)
    rng = np.random.default_rng(3)
    usual = Problem(lens, case.data.views, free)
    state = usual.state(case.camera.params * 1.001, case.poses)
    turned = rotations.exp(rng.normal(0, 1e-3, (len(case.poses), 3))) @ state.rotations
    centres = state.centres * (1 + 1e-3 * rng.normal(size=state.centres.shape))
    moved = replace(state, rotations=turned, centres=centres)
    return problem, problem.state(state.params, usual.poses(moved))


def _step_digits(problem: Problem, state: State, form: str) -> str:
    blocks = problem.linearise(state)
    assert blocks is not None
    unit = tangent.inverse_lengths(tangent.diagonal(blocks))
    exact = _extended(rows.jacobian(problem, state) * unit, -rows.residuals(problem, state))
    with np.errstate(all="ignore"):
        solved = Linear(problem, form).step(state, blocks, 0.0)
    if solved is None:
        return "none"
    return _kept(float(np.linalg.norm(tangent.flat(solved[0]) / unit - exact) / np.linalg.norm(exact)))


def _extended(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least squares by Gram-Schmidt, done twice, in extended precision."""
    a, b = a.astype(np.longdouble), b.astype(np.longdouble)
    q, r = np.zeros_like(a), np.zeros((a.shape[1],) * 2, np.longdouble)
    for k in range(a.shape[1]):
        v = a[:, k].copy()
        for _ in range(2):
            along = q[:, :k].T @ v
            v -= q[:, :k] @ along
            r[:k, k] += along
        r[k, k] = np.sqrt(v @ v)
        q[:, k] = v / r[k, k]
    x = q.T @ b
    for k in reversed(range(len(x))):
        x[k] = (x[k] - r[k, k + 1 :] @ x[k + 1 :]) / r[k, k]
    return x.astype(float)


def _camera_digits(case: Scene, problem: Problem, state: State, form: str) -> str:
    with np.errstate(all="ignore"):
        result = make(f"lm:{form}")(problem, state)
    error = abs(result.state.params[0] / case.camera.params[0] - 1)
    word = f"{_kept(float(error))} in {result.iterations}"
    return word if result.converged else word + "*"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--update", type=Path, help="a page whose tables are to be renewed")
    told = parser.parse_args()
    all_scenes = list(scenes())
    tables = {
        "conditioning-linear": markdown(
            ["scene", "stage", "cond raw", "cond normalised", "digits raw", "digits normalised"],
            [row for case in all_scenes for row in linear_rows(case)],
        ),
        "conditioning-refinement": markdown(
            [
                "scene",
                "normalised",
                "cond J",
                "step by Cholesky",
                "step by QR",
                "fx by Cholesky",
                "fx by QR",
                "fx, automatic",
            ],
            [row for case in all_scenes for row in refinement_rows(case)],
        ),
    }
    for name, text in tables.items():
        print(f"\n{name}\n{text}", flush=True)
        if told.update:
            update(told.update, name, text)


if __name__ == "__main__":
    main()
