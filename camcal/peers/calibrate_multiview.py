"""cv2.calibrateMultiview (5.0) on a rig of three or more cameras.

It calibrates each camera alone, then pairs, then all poses with the intrinsics held and a robust cost, so that its rms
is that of another problem: what is compared is that it does not come out lower. It takes one kind of lens for all.
Its test for points on a line has a threshold in the unit of the points and refuses boards in mm: they are given in
units of their extent.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from camcal.peers.base import LOWER, LOWER_PX, Entry, NotComparableError, entry, size_of
from camcal.peers.calibrate_camera import camera_of, flags_of, refusals
from camcal.solve.calibration import RigCalibration
from camcal.solve.poses import poses_before
from camcal.solve.refine import residuals

AGAINST = "cv2.calibrateMultiview"
#: cameras and image points that are compared at most: cv2 solves all pairs, in dense matrices
MOST_CAMERAS, MOST_POINTS = 6, 20_000


def crosscheck(fit: RigCalibration, stage: str = "refine") -> Entry:
    """Compare a rig with cv2."""
    try:
        rig = _run(fit)
    except NotComparableError as error:
        return entry(stage, AGAINST, "not_applicable", str(error).rstrip("."))
    theirs_fit = replace(fit, rig=rig)
    poses = poses_before(theirs_fit, fit.observations, fit.poses)
    off = residuals(rig, poses, fit.observations)[fit.used]
    ours, theirs = fit.rms_point, float(np.sqrt(np.square(off).sum(1).mean()))
    lower = not theirs >= ours * (1 - LOWER) - LOWER_PX
    said = f"cv2 {'reaches a lower' if lower else 'ends at a higher'} rms, {theirs:.9g} px instead of {ours:.9g} px"
    names = list(rig.cameras)
    distances = {f"{names[0]}-{n}": rig.baseline(names[0], n) for n in names[1:]}
    turns = [
        float(
            np.linalg.norm(rotations.log(fit.rig.cam_from_rig[n].rotation @ rig.cam_from_rig[n].rotation.T))
        )
        for n in names[1:]
    ]
    opencv = {"rms_point": theirs, "baselines": distances}
    difference = {
        "rms_point": ours - theirs,
        "angle_max": max(turns),
        "baselines": {
            f"{names[0]}-{n}": fit.rig.baseline(names[0], n) - rig.baseline(names[0], n) for n in names[1:]
        },
    }
    return entry(stage, AGAINST, "fail" if lower else "pass", said, opencv, difference)


def _run(fit: RigCalibration) -> Rig:
    """The rig estimated by cv2, from its own start."""
    if not hasattr(cv2, "calibrateMultiview"):
        raise NotComparableError(f"this OpenCV has no {AGAINST}")
    data, cameras = fit.observations.kept(), fit.cameras
    if len(cameras) > MOST_CAMERAS or data.point_count > MOST_POINTS:
        raise NotComparableError(f"more than {MOST_CAMERAS} cameras or {MOST_POINTS} points are not compared")
    if data.precision is not None:
        raise NotComparableError("cv2 takes no weights")
    model, flags = _model(fit)
    points, index = np.unique(data.xyz, axis=0, return_inverse=True)
    unit = float(np.ptp(points, axis=0).max())
    uv = np.full((len(cameras), len(data), len(points), 2), -1.0, np.float32)
    uv[data.camera, data.view, index.reshape(-1)] = data.uv
    mask = np.zeros(uv.shape[:2], np.uint8)
    mask[data.blocks.camera, data.blocks.view] = 1
    sizes = [size_of(c, data.uv) for c in cameras]
    board = ((points - points.mean(0)) / unit).astype(np.float32)
    with refusals():
        found = cv2.calibrateMultiview(
            [board] * len(data), [list(own) for own in uv], sizes, mask, np.full(len(cameras), model, np.uint8),
            None, None, None, None, flagsForIntrinsics=np.full(len(cameras), flags, np.int32),
        )  # type: ignore[call-overload]  # fmt: skip
    _, matrices, bends, turns, shifts = found
    made = {
        n: camera_of(c, np.asarray(k, float), np.ravel(d))
        for (n, c), k, d in zip(fit.rig.cameras.items(), matrices, bends, strict=True)
    }
    places = {}
    for name, turn, shift in zip(made, turns, shifts, strict=True):
        turn = np.asarray(turn, float)
        rotation = turn if turn.shape == (3, 3) else rotations.exp(turn.ravel())
        places[name] = Pose(rotations.nearest(rotation), unit * np.ravel(shift))
    numbers = [np.isfinite(c.params).all() for c in made.values()]
    if not all(numbers) or not all(np.isfinite(p.translation).all() for p in places.values()):
        raise NotComparableError("cv2 returned NaN")
    return Rig.in_frame_of(fit.rig.reference, made, places)


def _model(fit: RigCalibration) -> tuple[int, int]:
    """cv2's number of the lens model, and the flags that hold what camcal holds; both must be the same for all
    cameras.
    """
    kinds, row = [], 0
    for camera in fit.cameras:
        form = camera.lens.opencv(camera.params)
        own = fit.free[row : row + camera.lens.size]
        row += camera.lens.size
        if form is None or form.function != "calibrateCamera":
            raise NotComparableError(f"cv2's rigs have no model like {camera.lens.name}")
        kinds.append(flags_of(camera, own[:, own.any(0)]))
    if len(set(kinds)) > 1:
        raise NotComparableError(
            "cv2 takes one lens model for all cameras and holds the same parameters of each"
        )
    return int(cv2.CALIB_MODEL_PINHOLE), int(kinds[0])
