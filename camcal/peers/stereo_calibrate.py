"""cv2.stereoCalibrate on the pairs of cameras of a rig.

cv2 takes two cameras of one model, the points that both saw in the views that both have, and unit weights. Where the
rig holds more than that, camcal fits the pair again to just these points, so that both solve the same problem; cv2
begins at the intrinsics of the cameras alone. Its rms is recomputed in float64 with the cameras and the relative pose
that it returned, before the best pose of each board.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np

from camcal.assess.covariance import covariance
from camcal.data.observations import Observations
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.model.rig import Rig
from camcal.peers import calibrate_multiview, register_cameras
from camcal.peers.base import (
    LEAST_POINTS,
    LOWER,
    LOWER_PX,
    SAME,
    SIGMAS,
    Entry,
    NotComparableError,
    entry,
    size_of,
)
from camcal.peers.calibrate_camera import camera_of, coefficients, criteria, flags_of, refusals
from camcal.peers.fisheye_calibrate import flags_of as fisheye_flags
from camcal.peers.register_cameras import registered
from camcal.records import dataclass
from camcal.solve.calibration import RigCalibration
from camcal.solve.poses import poses_before
from camcal.solve.refine import How, refine, residuals
from camcal.system.processes import one_opencv_thread

AGAINST = "cv2.stereoCalibrate"
FISHEYE = "cv2.fisheye.stereoCalibrate"
#: the coefficients of a fisheye lens
BENDS = ("k1", "k2", "k3", "k4")
#: pairs that are compared at most: six for four cameras, and each costs two calibrations
MOST_PAIRS = 6
#: instants that a pair needs: below, its intrinsics are not determined by what both saw
LEAST_INSTANTS = 3

Array = np.ndarray


def crosscheck(solution: RigCalibration, flat: RigCalibration | None, how: How) -> tuple[Entry, ...]:
    """Compare each pair of cameras with cv2.

    Parameters
    ----------
    solution : RigCalibration
    flat : RigCalibration, optional
        The fit with the board as designed, where the result has a board of another shape: compared, too.
    how : How
        How both were made.
    """
    fits = (
        {"refine": solution} if flat is None or solution.board is None else {"flat": flat, "refine": solution}
    )
    pairs = list(combinations(solution.rig.cameras, 2))
    entries = []
    with one_opencv_thread():
        for stage, fit in fits.items():
            for a, b in pairs[:MOST_PAIRS]:
                entries.append(_entry(stage, fit, a, b, how))
        if len(pairs) > 1:
            entries.append(calibrate_multiview.crosscheck(solution))
    if len(pairs) > MOST_PAIRS:
        why = f"{len(pairs) - MOST_PAIRS} of {len(pairs)} pairs of cameras are not compared"
        entries.append(entry("refine", AGAINST, "not_applicable", why))
    return tuple(entries)


def _entry(stage: str, fit: RigCalibration, a: str, b: str, how: How) -> Entry:
    """The comparison of a pair with the function of cv2 that accepts it."""
    try:
        return _compare(stage, _pair(fit, a, b, how))
    except (NotComparableError, CamcalError) as error:
        why = str(error).rstrip(".")
    try:
        ours, relative = registered(fit, a, b, LEAST_INSTANTS)
        rig, said = Rig(ours.rig.cameras, {b: relative}, a), f"{a}-{b}, intrinsics held, as {why}"
        return _judged(stage, register_cameras.AGAINST, ours, rig, said, {})
    except (NotComparableError, CamcalError) as error:
        both = "" if str(error).rstrip(".") == why else f"; {str(error).rstrip('.')}"
        return entry(stage, AGAINST, "not_applicable", f"{a}-{b}: {why}{both}")


@dataclass(frozen=True)
class _Pair:
    """A pair in a form that cv2 can solve, and the parts of the rig that this omits."""

    fit: RigCalibration
    names: tuple[str, str]
    frees: tuple[Array, Array]
    remark: str
    fisheye: bool = False


def _pair(whole: RigCalibration, a: str, b: str, how: How) -> _Pair:
    """The fit of a pair to the points that both cameras saw.

    Raises
    ------
    NotComparableError
        If cv2 has no counterpart.
    """
    rig = whole.rig.with_reference(a)
    cameras = {n: rig.cameras[n] for n in (a, b)}
    start = {n: whole.start.cameras[n] for n in (a, b)}
    function = _function(cameras)
    data, instants = _shared(whole, a, b)
    if len(instants) < LEAST_INSTANTS:
        raise NotComparableError(f"{len(instants)} instants are seen by both")
    ends = np.cumsum([0, *(c.lens.size for c in whole.cameras)])
    index = {n: i for i, n in enumerate(whole.rig.cameras)}
    rows = {n: whole.free[ends[index[n]] : ends[index[n] + 1]] for n in (a, b)}
    frees = tuple(r[:, r.any(0)] for r in rows.values())
    poses = Poses.of(whole.rig.cam_from_rig[a] @ whole.poses[instants])
    pair = Rig(cameras, {b: rig.cam_from_rig[b]}, a)
    fit = refine(pair, poses, data, replace(how, board="flat"))
    left = int(np.isin(whole.observations.camera, [index[a], index[b]]).sum()) - data.point_count
    said = [f"{a}-{b}"]
    if left:
        said.append(f"over the {data.point_count // 2} points that both saw")
    if whole.board is not None:
        said.append("both with the board as estimated")
    return _Pair(
        replace(fit, start=replace(pair, cameras=start)),
        (a, b),
        (frees[0], frees[1]),
        ", ".join(said),
        function != "calibrateCamera",
    )


def _function(cameras: Mapping[str, Camera]) -> str:
    """cv2's calibration function of a single camera, which determines the one for pairs."""
    forms = []
    for camera in cameras.values():
        form = camera.lens.opencv(camera.params)
        if form is None or form.function not in ("calibrateCamera", "fisheye.calibrate"):
            raise NotComparableError(f"{AGAINST} has no model like {camera.lens.name}")
        forms.append(form)
    if forms[0].flags != forms[1].flags or len(forms[0].distortion) != len(forms[1].distortion):
        raise NotComparableError("cv2 takes one lens model for both cameras")
    if forms[0].function != forms[1].function:
        raise NotComparableError("cv2 takes one lens model for both cameras")
    return str(forms[0].function)


def _shared(whole: RigCalibration, a: str, b: str) -> tuple[Observations, Array]:
    """The points that two cameras saw at the same instants, without weights, as those of a rig; and these
    instants.
    """
    data = whole.observations
    index = [data.cameras.index(n) for n in (a, b)]
    rows = [np.flatnonzero(data.used & (data.camera == i)) for i in index]
    _, point = np.unique(data.xyz, axis=0, return_inverse=True)
    keys = point.reshape(-1) + data.view * (int(point.max(initial=0)) + 1)
    _, first, second = np.intersect1d(keys[rows[0]], keys[rows[1]], return_indices=True)
    views = data.view[rows[0][first]]
    instants, counts = np.unique(views, return_counts=True)
    instants = instants[counts >= LEAST_POINTS]
    good = np.isin(views, instants)
    taken = np.r_[rows[0][first[good]], rows[1][second[good]]]
    view = np.searchsorted(instants, data.view[taken])
    half = len(taken) // 2
    made = Observations(
        xyz=data.xyz[taken],
        uv=data.uv[taken],
        view=view,
        view_ids=tuple(data.view_ids[i] for i in instants),
        camera=np.repeat([0, 1], half),
        cameras=(a, b),
        image_sizes=tuple(data.image_sizes[i] for i in index),
    )
    return made, instants


def _compare(stage: str, pair: _Pair) -> Entry:
    fit, (a, b) = pair.fit, pair.names
    run, against = (_run_fisheye, FISHEYE) if pair.fisheye else (_run, AGAINST)
    cameras, relative, distortion = run(pair)
    rig = Rig(dict(zip((a, b), cameras, strict=True)), {b: relative}, a)
    said = f"{pair.remark}; cv2 started at the intrinsics of each camera alone"
    return _judged(stage, against, fit, rig, said, {"distortion": distortion})


def _judged(
    stage: str, against: str, fit: RigCalibration, rig: Rig, remark: str, more: Mapping[str, Any]
) -> Entry:
    """The entry that compares camcal's and cv2's results for a pair."""
    b = next(iter(fit.extrinsics))
    relative, theirs_fit = rig.cam_from_rig[b], replace(fit, rig=rig)
    poses = poses_before(theirs_fit, fit.observations, fit.poses)
    off = residuals(rig, poses, fit.observations)
    ours, theirs = fit.rms_point, float(np.sqrt(np.square(off).sum(1).mean()))
    if not np.isfinite(theirs):
        raise NotComparableError("cv2's cameras do not project some of the points")
    sigmas = _in_sigmas(fit, relative)
    status, said = "pass", [remark]
    if not theirs >= ours * (1 - LOWER) - LOWER_PX:
        status = "fail"
        said.append(f"cv2 reaches a lower rms, {theirs:.9g} px instead of {ours:.9g} px")
    elif theirs > ours * (1 + SAME) + LOWER_PX:
        said.append(f"cv2 ends at a higher rms, {theirs:.9g} px instead of {ours:.9g} px")
    elif not sigmas <= SIGMAS:
        status = "fail"
        said.append(f"the same rms, but the relative pose differs by {sigmas:.3g} standard deviations")
    opencv = {
        "rms_point": theirs,
        "matrix": [c.matrix.tolist() for c in rig.cameras.values()],
        **more,
        **relative.entry(),
        "baseline": float(np.linalg.norm(relative.translation)),
    }
    return entry(
        stage, against, status, "; ".join(said), opencv, _difference(fit, rig, ours - theirs, sigmas)
    )


def _run(pair: _Pair) -> tuple[tuple[Camera, Camera], Pose, list[list[float]]]:
    """cv2's result for a pair: both cameras, b_from_a, and the distortions."""
    data, (a, b) = pair.fit.observations, pair.names
    starts = pair.fit.start.cameras
    flags = _flags(pair)
    half = data.point_count // 2
    views = [np.flatnonzero(data.view[:half] == v) for v in range(len(data))]
    centres = [np.where(np.ptp(data.xyz[r], axis=0) == 0, data.xyz[r[0]], data.xyz[r].mean(0)) for r in views]
    size = size_of(starts[a], data.uv)
    xyz = [
        (data.xyz[v] - c).astype(np.float32).reshape(-1, 1, 3) for v, c in zip(views, centres, strict=True)
    ]
    seen_a, seen_b = (
        [data.uv[v + shift].astype(np.float32).reshape(-1, 1, 2) for v in views] for shift in (0, half)
    )
    (ka, da), (kb, db) = ((starts[n].matrix.copy(), coefficients(starts[n])) for n in (a, b))
    with refusals():
        _, k1, d1, k2, d2, r, t, *_ = cv2.stereoCalibrate(
            xyz, seen_a, seen_b, ka, da, kb, db, size, flags=flags, criteria=criteria()
        )
    found = [np.asarray(x, float) for x in (k1, d1, k2, d2, r, t)]
    if not all(np.isfinite(x).all() for x in found):
        raise NotComparableError("cv2 returned NaN")
    matrices, bends = found[0:4:2], [d.ravel() for d in found[1:4:2]]
    if flags & cv2.CALIB_FIX_INTRINSIC:
        cameras = [starts[a], starts[b]]
    else:
        cameras = [camera_of(starts[n], k, d) for n, k, d in zip((a, b), matrices, bends, strict=True)]
    return (cameras[0], cameras[1]), Pose(found[4], found[5].ravel()), [d.tolist() for d in bends]


def _run_fisheye(pair: _Pair) -> tuple[tuple[Camera, Camera], Pose, list[list[float]]]:
    """The result of cv2.fisheye.stereoCalibrate for a pair of which everything except skew is estimated."""
    data, names = pair.fit.observations, pair.names
    starts = [pair.fit.start.cameras[n] for n in names]
    for camera, free in zip(starts, pair.frees, strict=True):
        free_names = {n for n, row in zip(camera.lens.names, free, strict=True) if row.any()}
        if free_names != {"fx", "fy", "cx", "cy", *BENDS}:
            raise NotComparableError(f"{FISHEYE} is compared where f, c and k1 to k4 are estimated")
    half = data.point_count // 2
    views = [np.flatnonzero(data.view[:half] == v) for v in range(len(data))]
    xyz = [data.xyz[v].reshape(1, -1, 3) for v in views]
    seen_a, seen_b = ([data.uv[v + shift].reshape(1, -1, 2) for v in views] for shift in (0, half))
    (ka, da), (kb, db) = ((c.matrix.copy(), np.array([c.values[k] for k in BENDS])) for c in starts)
    size = size_of(starts[0], data.uv)
    flags = fisheye_flags(["USE_INTRINSIC_GUESS", "FIX_SKEW", "RECOMPUTE_EXTRINSIC"])
    with refusals():
        _, k1, d1, k2, d2, r, t, *_ = cv2.fisheye.stereoCalibrate(
            xyz, seen_a, seen_b, ka, da, kb, db, size, flags=flags, criteria=criteria()
        )
    found = [np.asarray(x, float) for x in (k1, d1, k2, d2, r, t)]
    if not all(np.isfinite(x).all() for x in found):
        raise NotComparableError("cv2 returned NaN")
    cameras = []
    for start, k, d in zip(starts, found[0:4:2], found[1:4:2], strict=True):
        values = {
            "fx": k[0, 0],
            "fy": k[1, 1],
            "cx": k[0, 2],
            "cy": k[1, 2],
            **dict(zip(BENDS, d.ravel(), strict=True)),
        }
        cameras.append(Camera(start.lens, start.lens.from_values(values), start.image_size))
    bends = [d.ravel().tolist() for d in found[1:4:2]]
    return (cameras[0], cameras[1]), Pose(found[4], found[5].ravel()), bends


def _flags(pair: _Pair) -> int:
    """cv2's flags, which hold the same parameters of both cameras."""
    held = [not f.any() for f in pair.frees]
    if all(held):
        return int(cv2.CALIB_FIX_INTRINSIC)
    if any(held):
        raise NotComparableError("cv2 cannot hold one camera and estimate the other")
    cameras = [pair.fit.rig.cameras[n] for n in pair.names]
    flags = [flags_of(c, f) for c, f in zip(cameras, pair.frees, strict=True)]
    if flags[0] != flags[1]:
        raise NotComparableError("cv2 holds the same parameters of both cameras")
    return flags[0] | int(cv2.CALIB_USE_INTRINSIC_GUESS)


def _in_sigmas(fit: RigCalibration, theirs: Pose) -> float:
    """The joint difference of the relative pose's six numbers in standard deviations."""
    name = next(iter(fit.extrinsics))
    ours, at = fit.rig.cam_from_rig[name], fit.extrinsics[name]
    delta = ours.step_to(theirs)
    spread = covariance(fit).free[at, at]
    return float(np.sqrt(max(delta @ np.linalg.lstsq(spread, delta, rcond=None)[0], 0.0)))


def _difference(fit: RigCalibration, theirs: Rig, rms: float, sigmas: float) -> dict[str, Any]:
    a, b = fit.rig.cameras
    ours, other = fit.rig.cam_from_rig[b], theirs.cam_from_rig[b]
    turn = float(np.linalg.norm(rotations.log(ours.rotation @ other.rotation.T)))
    parameters = {
        f"{n}.{p}": v - theirs.cameras[n].values[p]
        for n in (a, b)
        for p, v in fit.rig.cameras[n].values.items()
    }
    return {
        "rms_point": rms,
        "angle_max": turn,
        "translation": (ours.translation - other.translation).tolist(),
        "baseline": fit.rig.baseline(a, b) - theirs.baseline(a, b),
        "sigmas": sigmas,
        "parameters": parameters,
    }
