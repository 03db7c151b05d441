"""What the benchmarks of tracking share: estimators by name, their errors, and cv2 on each frame."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from camcal.geometry import projective
from camcal.registry import look_up
from camcal.settings.tracking import TrackOptions
from camcal.track import ESTIMATORS, SEQUENCES
from camcal.track.frames import Frame
from camcal.track.physical_model import Physical
from camcal.track.simulate import Truth

Array = np.ndarray
Pair = tuple[Frame, Truth]

KNOWS_MOTION = ("kalman", "iekf", "window", "smoother")
GRID = np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), -1).reshape(-1, 3)


def estimator(method: str, kind: str, **options: object) -> object:
    """An estimator that is told the motion of a sequence, as far as it takes one."""
    motion = {"motion": SEQUENCES[kind]} if method in KNOWS_MOTION else {}
    return look_up(ESTIMATORS, method, "method")(TrackOptions(**{**motion, **options}))  # type: ignore[arg-type]


def run(made: object, pairs: list[Pair]) -> list:
    """The final states of all frames."""
    states = [made.update(frame) for frame, _ in pairs]  # type: ignore[attr-defined]
    last = list(made.finish())  # type: ignore[attr-defined]
    return last if made.offline else states  # type: ignore[attr-defined]


def error(matrix: Array, truth: Truth) -> float:
    """Root mean square distance, over 27 points of the cube, between true and estimated projections, px."""
    r = projective.project(matrix, GRID) - projective.project(truth.matrix, GRID)
    return float(np.sqrt((r**2).sum(1).mean()))


def nees(made: object, state: object, truth: Truth) -> float:
    """Squared error over what the covariance says: chi-squared of as many degrees as there are parameters."""
    model = made.model  # type: ignore[attr-defined]
    if hasattr(model, "lens"):
        k = truth.k
        wanted = Physical(
            model.lens.pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2]), truth.rotation, truth.translation
        )
    else:
        wanted = model.from_matrix(truth.matrix)
    deviates = np.linalg.solve(state.factor, model.local(state.estimate, wanted))  # type: ignore[attr-defined]
    return float(deviates @ deviates)


def cv2_matrix(frame: Frame, keep: Array, guess: Array) -> Array:
    """K [R | t] by cv2.calibrateCamera on one frame."""
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    xyz, uv = frame.xyz[keep].astype(np.float32), frame.uv[keep].astype(np.float32)
    _, k, _, rvecs, tvecs = cv2.calibrateCamera([xyz], [uv], (640, 480), guess.copy(), None, flags=flags)
    return projective.compose(k, cv2.Rodrigues(rvecs[0])[0], tvecs[0])


def method_errors(method: str, kind: str, pairs: list[Pair]) -> list[float]:
    """The error of each frame, px; `cv2` and `cv2 without outliers` are methods here too."""
    if method.startswith("cv2"):
        guess = pairs[0][1].k
        every = method == "cv2"
        return [error(cv2_matrix(f, t.good | every, guess), t) for f, t in pairs]
    made = estimator(method, kind)
    return state_errors(made, run(made, pairs), pairs)


def state_errors(made: object, states: list, pairs: list[Pair]) -> list[float]:
    """The error of each state, px."""
    matrices = made.model.describe([s.estimate for s in states], [s.factor for s in states]).matrix  # type: ignore
    return [error(m, t) for m, (_, t) in zip(matrices, pairs, strict=True)]


def table(header: list[str], rows: Iterator[list[str]]) -> Iterator[str]:
    """A table in Markdown, line by line as the rows come."""
    yield "| " + " | ".join(header) + " |"
    yield "|" + "---|" * len(header)
    for row in rows:
        yield "| " + " | ".join(row) + " |"
