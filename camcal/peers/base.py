"""Shared parts of the cross-checks: the entry of the report, the tolerances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration

Entry = dict[str, Any]

#: cv2 may come out lower than camcal by this part of the rms: both sums are taken in float64 over the same
#: numbers, camcal stops at a predicted decrease of 1e-14 of the cost, and cv2's answer is taken as it is.
LOWER = 1e-9
#: ... or by this, px, where the data are exact and the rms is made of rounding alone.
LOWER_PX = 1e-9
#: ... or by this in chi², where camcal ended in a valley: a thousand more steps at the rate at which it was left
#: (`lm.STILL_CHI2` in ten steps), and a tenth of a standard deviation at most of anything that the data determine
LOWER_CHI2 = 0.01
#: The same optimum: cv2 sees the points rounded to float32, at most 2.4e-4 px off in a picture of 8,000 px,
#: which moves its optimum; that raises its rms over the exact points by less than this part.
SAME = 1e-6
#: Projections of the same optimum differ by no more than this, px (rounding to float32 again) ...
PROJECTION_PX = 1e-3
#: ... or where the camera is weakly determined, the parameters together by this many standard deviations.
SIGMAS = 0.05
#: ... and by this many standard deviations of what rounding to float32 does to them
ROUNDED = 3.0


#: Enough for cv2 to stop by itself: 5.0 has 500 iterations as its default, 4.x only 30.
MOST_ITERATIONS = 500
#: Points of a view that determine a homography; cv2 takes no view of fewer.
LEAST_POINTS = 4
#: ... and to see whether it stays where it begins: from a point that is no optimum the first step lowers the cost by
#: most of what there is to gain.
TO_STAY = 5


@dataclass(frozen=True)
class Task:
    """The input of cv2: the used points of a solution, and the free parameters to estimate."""

    solution: Calibration
    views: tuple[tuple[Array, Array], ...]  #: (xyz (N, 3) relative to `centroids`, uv (N, 2)) of each view
    centroids: Array  #: (V, 3)
    image_size: tuple[int, int]
    iterations: int = MOST_ITERATIONS


@dataclass(frozen=True)
class Result:
    """The result of cv2, and its figure recomputed.

    `rms_point` is over the exact points, in float64, with the parameters and poses as returned. `board` are the
    board's points (M, 3) where they were estimated, in the frame and at the scale of camcal's. `rounded` says
    whether cv2 got the image points as float32.
    """

    camera: Camera
    poses: Poses
    rms_point: float
    distortion: Array
    start: str
    board: Array | None = None
    rounded: bool = True


#: runs cv2's calibration from a guess, or from where it begins by itself
Calibrate = Callable[[Task, Camera | None], Result]


class NotComparableError(Exception):
    """Raised if cv2 has no counterpart; the text gives the reason. It is caught within this package."""


class LeftOutError(NotComparableError):
    """Raised if cv2 ignored some views; `kept` are the indices of those it used."""

    def __init__(self, message: str, kept: tuple[int, ...]):
        super().__init__(message)
        self.kept = kept


def entry(
    stage: str,
    against: str,
    status: str,
    why: str | None = None,
    opencv: Mapping[str, Any] | None = None,
    difference: Mapping[str, Any] | None = None,
) -> Entry:
    """An entry of the report's `crosscheck`; differences are camcal's value minus cv2's."""
    return {
        "stage": stage,
        "against": against,
        "status": status,
        "why": why,
        "opencv": dict(opencv) if opencv is not None else None,
        "difference": dict(difference) if difference is not None else None,
    }


def judge(value: float, bound: float, what: str) -> tuple[str, str | None]:
    """`pass`, or `fail` with a reason, for a value that must not exceed a bound; NaN fails."""
    if value <= bound:
        return "pass", None
    return "fail", f"{what} {value:.3g}, at most {bound:.3g} was expected"


def bounds(solution: Calibration) -> tuple[Array, Array]:
    """The corners (2,) of the image, or of the bounding box of all image points if the image size is unknown."""
    size = solution.camera.image_size
    if size is not None:
        return np.zeros(2), np.subtract(size, 1.0)
    uv = solution.observations.uv
    return uv.min(0), uv.max(0)


def size_of(camera: Camera, uv: Array) -> tuple[int, int]:
    """The image size for cv2: that of the camera, or one that holds the points (N, 2)."""
    if camera.image_size is not None:
        return camera.image_size
    width, height = np.ceil(uv.max(0)).astype(int).tolist()
    return width + 1, height + 1
