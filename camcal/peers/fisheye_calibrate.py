"""cv2.fisheye.calibrate with the same free parameters as a solution, for `kb4` and its shorter forms.

It begins by itself at f = max(width, height) / pi, and asserts where a ray that it finds on the way points
straight along the axis (InitExtrinsics), which happens on lenses of 150 degrees with every start. Versions: 5.0
has its flags in cv2 and takes points as (1, N, k) only, 4.x has them in cv2.fisheye and takes both.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.peers.base import NotComparableError, Result, Task
from camcal.peers.calibrate_camera import criteria, refusals, where
from camcal.peers.wide import held, poses_of, refuse_rigs, rms_of
from camcal.solve.calibration import Calibration

NAME = "cv2.fisheye.calibrate"

_GROUPS = ((("skew",), "FIX_SKEW"), *(((f"k{i}",), f"FIX_K{i}") for i in range(1, 5)))
_WITH_GUESS = ((("fx", "fy"), "FIX_FOCAL_LENGTH"), (("cx", "cy"), "FIX_PRINCIPAL_POINT"))


def run(task: Task, guess: Camera | None) -> Result:
    """Run cv2.fisheye.calibrate from a guess; if it is None from its own start, otherwise from camcal's start.

    Raises
    ------
    NotComparableError
        If cv2 cannot estimate the same parameters, or refuses the data.
    """
    refuse_rigs(task, NAME)
    _refuse_wide_angles(task)
    if guess is not None:
        return _run(task, guess)
    try:
        return _run(task, None)
    except NotComparableError:
        return _run(task, task.solution.start)


def _run(task: Task, guess: Camera | None) -> Result:
    solution = task.solution
    matrix, bend, flags = np.eye(3), np.zeros(4), ["RECOMPUTE_EXTRINSIC"]
    if guess is not None:
        form = guess.lens.opencv(guess.params)
        assert form is not None
        matrix, bend = guess.matrix.copy(), form.distortion.copy()
        flags.append("USE_INTRINSIC_GUESS")
    flags += held(solution, (*_GROUPS, *_WITH_GUESS), NAME)
    with refusals():
        _, k, d, rvecs, tvecs = cv2.fisheye.calibrate(
            [xyz.reshape(1, -1, 3) for xyz, _ in task.views],
            [uv.reshape(1, -1, 2) for _, uv in task.views],
            task.image_size,
            matrix,
            bend,
            flags=flags_of(flags),
            criteria=criteria(task.iterations),
        )
    k, d = np.array(k, float), np.array(d, float).ravel()
    poses, turns, shifts = poses_of(task, rvecs, tvecs)
    if not all(np.isfinite(a).all() for a in (k, d, turns, shifts)):
        raise NotComparableError("cv2 returned NaN")

    def project(xyz: Array, rvec: Array, tvec: Array) -> Any:
        return cv2.fisheye.projectPoints(xyz, rvec, tvec, k, d, alpha=k[0, 1] / k[0, 0])[0]

    rms = rms_of(task, project, turns, shifts)
    return Result(_camera(solution, k, d), poses, rms, d, where(guess, solution), rounded=False)


def _refuse_wide_angles(task: Task) -> None:
    """Reject wide angles, because cv2.fisheye divides by z."""
    solution = task.solution
    views = solution.observations.kept().views
    count = sum(
        int((pose.apply(view.xyz)[:, 2] <= 0).sum()) for view, pose in zip(views, solution.poses, strict=True)
    )
    if count:
        raise NotComparableError(f"cv2.fisheye ends at 90 degrees from the axis, where {count} points lie")


def flags_of(names: list[str]) -> int:
    """cv2.fisheye's flags of these names; NotComparableError if this cv2 lacks one."""
    holder = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
    missing = [n for n in names if not hasattr(holder, f"CALIB_{n}")]
    if missing:
        raise NotComparableError(f"this cv2.fisheye has no {missing[0]}")
    flags = 0
    for name in names:
        flags |= getattr(holder, f"CALIB_{name}")
    return flags


def _camera(solution: Calibration, k: Array, d: Array) -> Camera:
    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2], "skew": k[0, 1]}
    values |= {f"k{i}": v for i, v in enumerate(d.tolist(), 1)}
    lens = solution.camera.lens
    return Camera(lens, lens.from_values(values), solution.camera.image_size)
