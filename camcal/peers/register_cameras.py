"""cv2.registerCameras (5.0) on pairs of cameras of a rig that cv2.stereoCalibrate does not accept.

It takes two lens models, pinhole beside fisheye, and points of a board that only one of both cameras saw; intrinsics
are held. camcal fits the pair again with the same intrinsics held, to the same points, so that both solve one problem.
"""

from __future__ import annotations

import cv2
import numpy as np

from camcal.data.observations import Observations
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose, Poses
from camcal.model.rig import Rig
from camcal.peers.base import NotComparableError
from camcal.peers.calibrate_camera import criteria, refusals
from camcal.solve.calibration import RigCalibration
from camcal.solve.refine import How, refine

AGAINST = "cv2.registerCameras"
#: points of a picture that its pose needs in cv2
LEAST_POINTS = 4


def registered(whole: RigCalibration, a: str, b: str, least: int) -> tuple[RigCalibration, Pose]:
    """The pair with its intrinsics held, by camcal and by cv2: a fit in the frame of a, and b_from_a.

    Raises
    ------
    NotComparableError
        If this cv2 has no such function, no model like one of both, or too few instants are seen by both.
    """
    if not hasattr(cv2, "registerCameras"):
        raise NotComparableError(f"this OpenCV has no {AGAINST}, which takes such pairs")
    models = [_model(whole.rig.cameras[n]) for n in (a, b)]
    data, instants = _of_pair(whole, a, b)
    if len(instants) < least:
        raise NotComparableError(f"{len(instants)} instants are seen by both")
    rig = whole.rig.with_reference(a)
    pair = Rig({n: rig.cameras[n] for n in (a, b)}, {b: rig.cam_from_rig[b]}, a)
    held = How({f"{n}.{p}": None for n in (a, b) for p in pair.cameras[n].lens.names})
    fit = refine(pair, Poses.of(whole.rig.cam_from_rig[a] @ whole.poses[instants]), data, held)
    points: list[list[Array]] = [[], []]
    pixels: list[list[Array]] = [[], []]
    for camera, rows in zip(data.blocks.camera, data.slices, strict=True):
        points[camera].append(data.xyz[rows].astype(np.float32).reshape(-1, 1, 3))
        pixels[camera].append(data.uv[rows].astype(np.float32).reshape(-1, 1, 2))
    (ka, da, ma), (kb, db, mb) = models
    begin = pair.cam_from_rig[b]
    with refusals():
        found = cv2.registerCameras(
            points[0], points[1], pixels[0], pixels[1], ka, da, ma, kb, db, mb,
            begin.rotation.copy(), begin.translation.copy(), criteria=criteria(),
        )  # fmt: skip
    rotation, shift = (np.asarray(m, float) for m in found[1:3])
    if not (np.isfinite(rotation).all() and np.isfinite(shift).all()):
        raise NotComparableError("cv2 returned NaN")
    return fit, Pose(rotation, shift.ravel())


def _model(camera: Camera) -> tuple[Array, Array, int]:
    """K, the coefficients and cv2's number of the model."""
    form = camera.lens.opencv(camera.params)
    kinds = {"calibrateCamera": "CALIB_MODEL_PINHOLE", "fisheye.calibrate": "CALIB_MODEL_FISHEYE"}
    if form is None or form.function not in kinds:
        raise NotComparableError(f"cv2 has no rigs of cameras like {camera.lens.name}")
    if camera.values.get("skew", 0.0) != 0:
        raise NotComparableError(f"{AGAINST} has no skew")
    return (
        camera.matrix.copy(),
        np.asarray(form.distortion, float).copy(),
        int(getattr(cv2, kinds[form.function])),
    )


def _of_pair(whole: RigCalibration, a: str, b: str) -> tuple[Observations, Array]:
    """The observations of two cameras at their shared instants, without weights, as those of a rig; and these
    instants.
    """
    data = whole.observations
    index = [data.cameras.index(n) for n in (a, b)]
    counts = [np.bincount(data.view[data.used & (data.camera == i)], minlength=len(data)) for i in index]
    instants = np.flatnonzero(np.minimum(*counts) >= LEAST_POINTS)
    rows = [np.flatnonzero(data.used & (data.camera == i) & np.isin(data.view, instants)) for i in index]
    taken = np.concatenate(rows)
    made = Observations(
        xyz=data.xyz[taken],
        uv=data.uv[taken],
        view=np.searchsorted(instants, data.view[taken]),
        view_ids=tuple(data.view_ids[i] for i in instants),
        camera=np.repeat([0, 1], [len(r) for r in rows]),
        cameras=(a, b),
        image_sizes=tuple(data.image_sizes[i] for i in index),
    )
    return made, instants
