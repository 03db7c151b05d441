"""cv2.omnidir.calibrate with the same free parameters as a solution, for `mei`.

It begins by itself, only so from Python, and leaves out views that its own start does not like. Its steps are
damped so much that it needs hundreds of iterations.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.peers.base import LeftOutError, NotComparableError, Result, Task
from camcal.peers.calibrate_camera import criteria, refusals, where
from camcal.peers.wide import held, poses_of, refuse_rigs, rms_of

NAME = "cv2.omnidir.calibrate"

_GROUPS = ((("skew",), "FIX_SKEW"), *(((n,), f"FIX_{n.upper()}") for n in ("k1", "k2", "p1", "p2")))
#: relative change of the parameters at which it stops: an iteration takes 10 ms for 34 views, and its last ones, to the
#: rounding of float64, lower the rms by nothing
_ENOUGH = 1e-12


def run(task: Task, guess: Camera | None) -> Result:
    """Run cv2.omnidir.calibrate from its own start.

    Raises
    ------
    LeftOutError
        If cv2 does without some of the views.
    NotComparableError
        If cv2 cannot estimate the same parameters, refuses the data, or is to begin at a guess.
    """
    if not hasattr(cv2, "omnidir"):
        raise NotComparableError("this cv2 lacks the contributed modules")
    if guess is not None:
        raise NotComparableError(
            f"{NAME} accepts no start from Python; with --crosscheck full it runs from its own start"
        )
    refuse_rigs(task, NAME)
    solution = task.solution
    flags = 0
    for name in held(solution, _GROUPS, NAME):
        flags |= getattr(cv2.omnidir, f"CALIB_{name}")
    with refusals():
        _, k, xi, d, rvecs, tvecs, kept = cv2.omnidir.calibrate(
            [xyz.reshape(1, -1, 3) for xyz, _ in task.views],
            [uv.reshape(1, -1, 2) for _, uv in task.views],
            task.image_size,
            np.eye(3),
            np.zeros(1),
            np.zeros((1, 4)),
            flags,
            criteria(task.iterations, _ENOUGH),
        )
    views = np.ravel(kept).astype(int)
    if len(views) < len(task.views):
        raise LeftOutError(f"{NAME} ignored {len(task.views) - len(views)} of the views", tuple(views))
    k, xi, d = np.array(k, float), np.array(xi, float).ravel(), np.array(d, float).ravel()
    poses, turns, shifts = poses_of(task, rvecs, tvecs)
    if not all(np.isfinite(a).all() for a in (k, xi, d, turns, shifts)):
        raise NotComparableError("cv2 returned NaN")

    def project(xyz: Array, rvec: Array, tvec: Array) -> Any:
        return cv2.omnidir.projectPoints(xyz, rvec, tvec, k, float(xi[0]), d)[0]

    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2], "skew": k[0, 1], "xi": xi[0]}
    values |= dict(zip(("k1", "k2", "p1", "p2"), d.tolist(), strict=True))
    lens = solution.camera.lens
    camera = Camera(lens, lens.from_values(values), solution.camera.image_size)
    rms = rms_of(task, project, turns, shifts)
    return Result(camera, poses, rms, np.r_[xi, d], where(None, solution), rounded=False)
