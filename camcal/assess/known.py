"""A known camera on new data: whether it fits them as its report predicts, and if not, what was exchanged.

Its residuals are judged by the median over all points, including rejected ones, because those that remain after robust
estimation always look good. If the points do not fit, a few transformations of them are tried (`SUSPICIONS`), with the
pose of each view re-estimated; the one that explains the points is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from camcal.assess.checks import KNOWN, checks_of, spoken
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import Observations, View
from camcal.errors import CamcalError
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Calibration
from camcal.solve.poses import refine_poses
from camcal.start.known_pose import start_poses

#: A median residual this many times what the calibration left is worse than another distance, lighting and detector
#: make it (the held-out median of real sets stays below 1.5 times that of the fit); ...
WORSE = 2.0
#: ... from this many times on, and from `SEVERAL_PX` px on, the camera is not that of the data.
FAR, SEVERAL_PX = 5.0, 1.0
#: a transformation explains the points where it leaves this part of the median or less
EXPLAINS = 0.5
#: sizes that pictures are stored in, against those of the calibration
SCALES = (2.0, 0.5, 1.5, 2 / 3, 4 / 3, 0.75, 3.0, 1 / 3)


@dataclass(frozen=True)
class Promise:
    """The prediction of the camera's own report for its residuals, px: the median length over its points."""

    median: float


@dataclass(frozen=True)
class Suspicion:
    """A possible misinterpretation of the data.

    Attributes
    ----------
    words : str
        What was done to the data, and what to do about it.
    change : callable
        The view as it would be right, from (view, middle): `middle` is the picture's centre, px.
    """

    words: str
    hint: str
    change: Callable[[View, Array], View]


def _uv(function: Callable[[Array, Array], Array]) -> Callable[[View, Array], View]:
    return lambda view, middle: replace(view, uv=function(view.uv, middle))


SUSPICIONS: tuple[Suspicion, ...] = (
    Suspicion(
        "v increases upwards (the image's y axis points up)",
        "Use v = height - 1 - v.",
        _uv(lambda uv, m: np.c_[uv[:, 0], 2 * m[1] - uv[:, 1]]),
    ),
    Suspicion(
        "u and v are exchanged (row before column)",
        "Exchange the columns u and v.",
        _uv(lambda uv, m: uv[:, ::-1].copy()),
    ),
    Suspicion(
        "the pictures are mirrored, left to right",
        "Use u = width - 1 - u.",
        _uv(lambda uv, m: np.c_[2 * m[0] - uv[:, 0], uv[:, 1]]),
    ),
    Suspicion(
        "two axes of the points are exchanged, or one has the wrong sign (a left-handed frame)",
        "Exchange X and Y, or negate one coordinate.",
        lambda view, m: replace(view, xyz=view.xyz[:, [1, 0, 2]].copy()),
    ),
    *(
        Suspicion(
            f"the pictures have another size, {1 / s:.4g} times that of the calibration",
            "Use pictures of the size used in the calibration, or scale the parameters (camcal convert).",
            _uv(lambda uv, m, s=s: (uv + 0.5) * s - 0.5),  # type: ignore[misc]
        )
        for s in SCALES
    ),
)


def check_known(
    solution: Calibration, given: Observations, promise: Promise | None = None
) -> tuple[CalibrationWarning, ...]:
    """All warnings about a known camera's fit to data.

    Parameters
    ----------
    solution : Calibration
        Poses and residuals, the camera as it was.
    given : Observations
        All points, those included that were rejected.
    promise : Promise, optional
        What the camera's report says; without it a fit is judged by the size of the picture alone.
    """
    facts = Facts(solution)
    said = spoken(checks_of(KNOWN), facts)
    misfit = [*_worse(facts, promise)]
    if misfit or any(w.code == "large-residuals" for w in said):
        cause = _named(solution, given)
        if cause is not None:
            said = [
                w for w in said if w.code not in ("large-residuals", "systematic-residuals", "mirrored-views")
            ]
            misfit = [cause]
    elif (
        facts.solution.rms_point <= SEVERAL_PX
    ):  # the camera explains them: pixels are counted from another origin
        said = [replace(w, severity="doubtful") if w.code == "points-outside-image" else w for w in said]
    return (*misfit, *said)


def _worse(facts: Facts, promise: Promise | None) -> Iterator[CalibrationWarning]:
    """Residuals larger than the camera's report predicts."""
    found = median_of(facts.solution)
    if promise is None or not promise.median > 0 or not found > WORSE * promise.median:
        return
    ratio = found / promise.median
    yield CalibrationWarning(
        "does-not-fit",
        f"the median residual is {found:.3g} px, {ratio:.3g} times that of the calibration ({promise.median:.3g} px).",
        "Is it the same camera, at the same zoom and focus, and are the points those of this target, in order?",
        "wrong" if ratio > FAR and found > SEVERAL_PX else "doubtful",
    )


def median_of(solution: Calibration) -> float:
    """The median length of the residuals of a solution, px."""
    lengths = np.linalg.norm(solution.residuals, axis=1)
    return float(np.median(np.where(np.isfinite(lengths), lengths, np.inf))) if len(lengths) else float("nan")


def _named(solution: Calibration, given: Observations) -> CalibrationWarning | None:
    """The transformation of the points that explains them; None where none does."""
    camera = solution.camera
    size = camera.image_size or given.image_size
    middle = np.array(camera.params[2:4]) if size is None else np.subtract(size, 1) / 2
    own = median_of(solution)
    best, left = None, EXPLAINS * own
    for suspicion in SUSPICIONS:
        found = _median_after([suspicion.change(v, middle) for v in given.views], camera)
        if found < left:
            best, left = suspicion, found
    if best is None:
        return None
    return CalibrationWarning(
        "data-exchanged",
        f"{best.words}: with this change, the median residual falls from {own:.3g} to {left:.3g} px.",
        best.hint,
        "wrong" if own > SEVERAL_PX else "doubtful",
    )


def _median_after(changed: Sequence[View], camera: Camera) -> float:
    """The median residual of changed views with re-estimated poses; inf if there are none."""
    try:
        views_ = [v.take(np.ones(len(v), bool)) for v in changed]
        poses, _, _ = refine_poses(camera, views_, start_poses(camera, views_))
    except CamcalError:
        return float("inf")
    off = [camera.project(pose.apply(v.xyz)) - v.uv for pose, v in zip(poses, views_, strict=True)]
    lengths = np.linalg.norm(np.concatenate(off), axis=1)
    return float(np.median(np.where(np.isfinite(lengths), lengths, np.inf)))
