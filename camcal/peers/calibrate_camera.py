"""cv2.calibrateCamera with the same free parameters as a solution.

cv2 takes float32 points: the object points are centred first (in float64), so that what is rounded is their
extent and not their place. Its rms is recomputed in float64 over the exact points from the parameters and
poses that it returned, because what it prints need not belong to them (4.14.0 after its last iteration).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np

from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses.opencv import COEFFICIENTS
from camcal.model.pose import Array, Poses
from camcal.peers.base import MOST_ITERATIONS, NotComparableError, Result, Task, bounds
from camcal.solve.calibration import Calibration

#: relative change of the parameters at which cv2 stops: a few times the rounding of float64
STILL = 1e-15


def criteria(iterations: int = MOST_ITERATIONS, gain: float = STILL) -> tuple[int, int, float]:
    """cv2's stopping criteria: a number of iterations, and a relative change per step."""
    return (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, iterations, gain)


#: which flag holds which coefficients; cv2 cannot hold a part of a group
_HOLD = (
    *(((f"k{i}",), f"CALIB_FIX_K{i}") for i in range(1, 7)),
    (("p1", "p2"), "CALIB_FIX_TANGENT_DIST"),
    (("s1", "s2", "s3", "s4"), "CALIB_FIX_S1_S2_S3_S4"),
    (("tauX", "tauY"), "CALIB_FIX_TAUX_TAUY"),
    (("cx", "cy"), "CALIB_FIX_PRINCIPAL_POINT"),
)


def task_of(solution: Calibration) -> Task:
    """The used points of a solution as input of cv2."""
    views, centroids = [], []
    for view in solution.observations.kept().views:
        xyz = view.xyz
        # a constant coordinate becomes 0 exactly: cv2 tells boards from rigs by z == 0
        centroid = np.where(np.ptp(xyz, axis=0) == 0, xyz[0], xyz.mean(0))
        views.append((xyz - centroid, view.uv))
        centroids.append(centroid)
    width, height = np.ceil(bounds(solution)[1]).astype(int).tolist()
    size = solution.camera.image_size or (width + 1, height + 1)
    return Task(solution, tuple(views), np.array(centroids), size)


def run(task: Task, guess: Camera | None) -> Result:
    """Run cv2.calibrateCamera, from a guess or, if it is None, from cv2's own start.

    Raises
    ------
    NotComparableError
        If cv2 cannot estimate the same parameters, or refuses the data.
    """
    solution = task.solution
    guess, flags, matrix, distortion = begin(task, guess)
    with refusals():
        _, *returned = cv2.calibrateCamera(
            [xyz.astype(np.float32).reshape(-1, 1, 3) for xyz, _ in task.views],
            [uv.astype(np.float32).reshape(-1, 1, 2) for _, uv in task.views],
            task.image_size,
            matrix,
            distortion,
            flags=flags,
            criteria=criteria(task.iterations),
        )
    k, bend, rvecs, tvecs = answer(returned)
    return Result(
        camera_of(solution.camera, k, bend),
        _poses(task, rvecs, tvecs),
        rms_of(task.views, k, bend, rvecs, tvecs),
        bend,
        where(guess, solution),
    )


def begin(task: Task, guess: Camera | None) -> tuple[Camera | None, int, Array, Array]:
    """The start of cv2: the guess it needs, its flags, its camera matrix and distortion.

    Raises
    ------
    NotComparableError
        If cv2 cannot estimate the same parameters.
    """
    solution = task.solution
    if guess is None and _needs_guess(task):
        guess = solution.start
    flags = flags_of(solution.camera, solution.free)
    start = solution.start if guess is None else guess
    if guess is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    return guess, flags, start.matrix.copy(), coefficients(start)


@contextmanager
def refusals() -> Iterator[None]:
    """Convert cv2's refusal of the data into a `NotComparableError`."""
    try:
        yield
    except cv2.error as error:
        raise NotComparableError(f"cv2 rejects these data: {_message(error)}") from error


def answer(returned: Sequence[Any]) -> tuple[Array, Array, Array, Array]:
    """Matrix (3, 3), distortion (n,), rotation vectors and translations (V, 3) from cv2's return values.

    4.x returns the distortion as it came in, 5.0 as a row; the poses as tuples of columns.
    """
    k, bend = np.array(returned[0], float), np.array(returned[1], float).ravel()
    rvecs, tvecs = (np.array(r, float).reshape(-1, 3) for r in returned[2:4])
    if not all(np.isfinite(a).all() for a in (k, bend, rvecs, tvecs)):
        raise NotComparableError("cv2 returned NaN")
    return k, bend, rvecs, tvecs


def where(guess: Camera | None, solution: Calibration) -> str:
    """Describe where cv2 started."""
    if guess is None:
        return "by itself"
    return "at camcal's start" if guess is solution.start else "at camcal's optimum"


def flags_of(camera: Camera, free: Array) -> int:
    """cv2's flags for the free parameters (P, F) of a camera; their values vary by version and are never stored.

    Raises
    ------
    NotComparableError
        If cv2 cannot hold, or free, exactly those.
    """
    lens = camera.lens
    form = lens.opencv(camera.params)
    assert form is not None
    estimated = {n for n, row in zip(lens.names, free, strict=True) if row.any()}
    names = [f"CALIB_{f}" for f in form.flags]
    for group, flag in _HOLD:
        inside = [n in estimated for n in group]
        if any(inside) and not all(inside):
            held = ", ".join(n for n, i in zip(group, inside, strict=True) if not i)
            raise NotComparableError(f"cv2 cannot hold {held} without {', '.join(group)}")
        if not any(inside):
            names.append(flag)
    names += _focal_flags(free, estimated)
    if "skew" in estimated or camera.values.get("skew", 0.0) != 0:
        raise NotComparableError("cv2 has no skew")
    _refuse_ties(free)
    missing = [n for n in names if not hasattr(cv2, n)]
    if missing:
        raise NotComparableError(f"this cv2 has no {missing[0]}")
    flags = 0
    for name in names:
        flags |= getattr(cv2, name)
    return flags


def _focal_flags(free: Array, estimated: set[str]) -> list[str]:
    inside = [n in estimated for n in ("fx", "fy")]
    if not any(inside):
        return ["CALIB_FIX_FOCAL_LENGTH"]
    if not all(inside):
        raise NotComparableError("cv2 cannot hold one of fx, fy and estimate the other")
    tied = np.linalg.matrix_rank(free[:2]) == 1
    return ["CALIB_FIX_ASPECT_RATIO"] if tied else []


def _refuse_ties(free: Array) -> None:
    """Reject tied parameters other than fx and fy."""
    rows = free[2:]
    if (np.count_nonzero(rows, axis=1) > 1).any() or (np.count_nonzero(rows, axis=0) > 1).any():
        raise NotComparableError("cv2 cannot tie distortion coefficients to one another")


def _needs_guess(task: Task) -> bool:
    """Return whether cv2 cannot start by itself: boards not in z = 0, or values held other than 0 or the image
    centre.
    """
    solution = task.solution
    flat = all(np.abs(xyz[:, 2]).max() == 0 for xyz, _ in task.views)
    held = solution.held.keys()
    bent = any(solution.camera.values[n] != 0 for n in held & set(COEFFICIENTS))
    return not flat or bent or bool(held & {"fx", "fy", "cx", "cy"})


def coefficients(camera: Camera) -> Array:
    """The distortion in cv2's order, with the length that cv2 expects for its flags (5, 8, 12 or 14)."""
    form = camera.lens.opencv(camera.params)
    assert form is not None
    length = next(n for n in (5, 8, 12, 14) if n >= len(form.distortion))
    return np.r_[form.distortion, np.zeros(length - len(form.distortion))].reshape(1, -1)


def camera_of(like: Camera, matrix: Array, distortion: Array) -> Camera:
    """A camera of the model of another one with cv2's values."""
    lens = like.lens
    values = dict(zip(COEFFICIENTS, distortion.tolist(), strict=False))
    values |= {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    return Camera(lens, lens.from_values(values), like.image_size)


def _poses(task: Task, rvecs: Array, tvecs: Array) -> Poses:
    turned = rotations.exp(rvecs)
    return Poses(turned, tvecs - np.einsum("vij,vj->vi", turned, task.centroids))


def rms_of(
    views: Sequence[tuple[Array, Array]], matrix: Array, distortion: Array, rvecs: Array, tvecs: Array
) -> float:
    """rms_point over the exact points by cv2's own projection in float64."""
    total, count = 0.0, 0
    for (xyz, uv), rvec, tvec in zip(views, rvecs, tvecs, strict=True):
        seen = cv2.projectPoints(xyz.reshape(-1, 1, 3), rvec, tvec, matrix, distortion)[0]
        total += float(np.square(np.reshape(seen, (-1, 2)) - uv).sum())
        count += len(uv)
    return float(np.sqrt(total / count))


def _message(error: cv2.error) -> str:
    return " ".join((getattr(error, "err", None) or str(error)).split())
