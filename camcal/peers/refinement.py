"""The refined camera compared with cv2's calibration of the same points with the same free parameters.

cv2 begins where it begins by itself, or at camcal's start where it cannot; never at camcal's optimum, or
the check would prove nothing. Where it ends elsewhere it gets a second chance from camcal's optimum, so
that the question "is there a lower cost than camcal's?" is really asked. It fails where cv2 reaches a lower
rms, or the same rms with a camera that projects differently.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.covariance import eliminate_poses, reduce
from camcal.assess.difference import Difference, difference, image_grid
from camcal.assess.figures import sigma_0
from camcal.data.observations import Observations
from camcal.errors import CamcalError
from camcal.least_squares import STILL
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.peers import CALIBRATORS, WITH_SKEW
from camcal.peers.base import (
    LOWER,
    LOWER_CHI2,
    LOWER_PX,
    PROJECTION_PX,
    ROUNDED,
    SAME,
    SIGMAS,
    TO_STAY,
    Calibrate,
    Entry,
    LeftOutError,
    NotComparableError,
    Result,
    Task,
    bounds,
    entry,
)
from camcal.peers.calibrate_camera import task_of
from camcal.peers.nearest import nearest
from camcal.registry import load
from camcal.solve.calibration import Calibration
from camcal.solve.refine import How, refine, residuals

STAGE = "refine"


def against_cv2(solution: Calibration, how: How | None = None, full: bool = True) -> list[Entry]:
    """Compare a solution with cv2's calibration; if there is no counterpart, also with the nearest one.

    Parameters
    ----------
    solution : Calibration
    how : How, optional
        How it was made, for the fit to what cv2 can solve where it lacks a part (skew, weights).
    full : bool
        Whether cv2 begins by itself; else at the optimum, where it has to stay.
    """
    how = how or How()
    form = solution.camera.lens.opencv(solution.camera.params)
    against = f"cv2.{form.function}" if form is not None else "cv2.calibrateCamera"
    if form is None or form.function not in CALIBRATORS:
        return [nearest(solution, STAGE, full)]
    missing, data, skew = unlike(solution)
    if not missing:
        shaped = solution.board is not None
        remark = "both with the board as estimated" if shaped else ""
        try:
            return [compare(solution, against, remark, full=full)]
        except LeftOutError as left:
            return [_without_views(solution, against, left, how, full)]
    entries = [entry(STAGE, against, "not_applicable", f"cv2 has no {' and no '.join(missing)}")]
    remarks = ["without skew in both"] if skew else []
    if data is not solution.observations:
        remarks.append(f"over the {data.point_count} points that were kept, with unit weights in both")
    try:
        again = fitted_again(solution, data, how)
    except CamcalError as error:
        why = f"{' and '.join(remarks)} there is no camera: {error}"
        return [*entries, entry(STAGE, against, "not_applicable", why)]
    try:
        entries.append(compare(again, against, " and ".join(remarks), full=full))
    except LeftOutError as left:
        entries.append(entry(STAGE, against, "not_applicable", str(left)))
    return entries


def fitted_again(solution: Calibration, data: Observations, how: How, keep_skew: bool = False) -> Calibration:
    """The fit from a solution to other observations of its views, without skew unless that is kept.

    Raises
    ------
    EstimationError
        If the observations are too few.
    """
    camera, fix = solution.camera, dict(how.fix)
    if not keep_skew and "skew" in camera.lens.names:
        lens = make(camera.lens.name)
        camera = Camera(lens, np.array([camera.values[n] for n in lens.names]), camera.image_size)
        fix.pop("skew", None)
    places = np.array([solution.observations.view_ids.index(v) for v in data.view_ids])
    return refine(camera, solution.poses[places], data, replace(how, fix=fix))


def _without_views(solution: Calibration, against: str, left: LeftOutError, how: How, full: bool) -> Entry:
    """Compare on the views that cv2 uses."""
    data = unweighted(solution).of_views(left.kept)
    try:
        again = fitted_again(solution, data, how, keep_skew=True)
        return compare(again, against, f"over the {len(data.views)} views that cv2 keeps", full=full)
    except (CamcalError, LeftOutError) as error:
        return entry(STAGE, against, "not_applicable", f"{left}; over the others: {error}")


def unlike(solution: Calibration) -> tuple[list[str], Observations, bool]:
    """The features of this solution that cv2 lacks, the data without them, and whether skew is among them."""
    found, data = [], solution.observations
    lens = solution.camera.lens
    form = lens.opencv(solution.camera.params)
    known = form is not None and form.function in WITH_SKEW
    skew = (
        not known
        and "skew" in lens.names
        and (bool(solution.free[lens.index("skew")].any()) or solution.camera.values["skew"] != 0)
    )
    if skew:
        found.append("skew")
    precision = data.precision
    weighted = solution.fit.loss == "linear" and precision is not None and bool(np.ptp(precision) > 0)
    robust = solution.fit.loss != "linear"
    if weighted:
        found.append("weights of points")
    if robust:
        found.append(f"loss like '{solution.fit.loss}'")
    if weighted or robust:
        data = unweighted(solution)
    return found, data, skew


def unweighted(solution: Calibration) -> Observations:
    """The used points of a solution, without sigmas."""
    return solution.observations.kept().unweighted()


def compare(
    solution: Calibration, against: str, remark: str = "", run: Calibrate | None = None, full: bool = True
) -> Entry:
    """Compare a solution that cv2 can represent: no skew, unit weights; the reason starts with `remark`.

    `run` is the function of cv2, where it is another than that of the model. Where cv2 does not stay at an optimum, it
    begins by itself after all.

    Raises
    ------
    LeftOutError
        If cv2 does without some of the views.
    """
    form = solution.camera.lens.opencv(solution.camera.params)
    assert form is not None
    run, task = run or load(CALIBRATORS[form.function]), task_of(solution)
    try:
        first = run(task, None) if full else run(replace(task, iterations=TO_STAY), solution.camera)
        if not full and not _same(first, solution):
            first = run(task, None)
    except LeftOutError:
        raise
    except NotComparableError as error:
        return entry(STAGE, against, "not_applicable", str(error))
    best, said = first, [remark] if remark else []
    if not _same(first, solution):
        second = _second_chance(run, task, solution)
        if second is not None and second.rms_point < first.rms_point:
            best = second
            said.append(f"started {first.start}, cv2 ends at rms {first.rms_point:.9g} px")
    return _judged(solution, best, against, said)


def _same(result: Result, solution: Calibration) -> bool:
    """Return whether cv2's rms equals camcal's, or exceeds it by at most the effect of rounding its points."""
    more, enough = result.rms_point - solution.rms_point, SAME * solution.rms_point + LOWER_PX
    rounding = _rounding(solution) if result.rounded else 0.0
    return -enough <= more <= enough + float(np.hypot(solution.rms_point, rounding)) - solution.rms_point


def _second_chance(run: Calibrate, task: Task, solution: Calibration) -> Result | None:
    try:
        return run(task, solution.camera)
    except NotComparableError:  # the first run stands
        return None


def _judged(solution: Calibration, result: Result, against: str, said: list[str]) -> Entry:
    ours, theirs = solution.rms_point, result.rms_point
    apart = difference(solution.camera, result.camera, image_grid(*bounds(solution)))
    sigmas = distance_in_sigmas(solution, result)
    status = "pass"
    if theirs < ours * (1 - _lower(solution)) - LOWER_PX:
        blind = _unseen(solution, result)
        status = "not_applicable" if blind else "fail"
        said.append(f"cv2 reaches a lower rms, {theirs:.9g} px instead of {ours:.9g} px")
        if blind:
            said.append(
                f"but its distortion folds back before {blind} of the points, so this camera cannot see them"
            )
    elif theirs > ours * (1 + SAME) + LOWER_PX + (_rounding(solution) if result.rounded else 0.0):
        said.append(f"cv2 ends at a higher rms, {theirs:.9g} px instead of {ours:.9g} px")
    elif not (apart.max_px <= PROJECTION_PX or sigmas <= same_sigmas(solution, result.rounded)):
        status = "fail"
        said.append(f"the same rms, but projections differ by up to {apart.max_px:.3g} px")
    said.append(f"cv2 started {result.start}")
    opencv = {
        "rms_point": theirs,
        "matrix": result.camera.matrix.tolist(),
        "distortion": result.distortion.tolist(),
    }
    return entry(STAGE, against, status, "; ".join(said), opencv, _figures(solution, result, apart, sigmas))


def _lower(solution: Calibration) -> float:
    """The fraction of the rms by which cv2 may be lower."""
    if solution.fit.stop_reason != STILL:
        return LOWER
    return LOWER_CHI2 / (4 * max(int(solution.used.sum()), 1))  # chi² is 2 N (rms / sigma)²


def _unseen(solution: Calibration, result: Result) -> int:
    """The number of used points outside the domain of cv2's camera, at the poses it returned."""
    off = residuals(result.camera, result.poses, solution.observations)
    return int(np.isnan(off[solution.used]).any(1).sum())


def _figures(solution: Calibration, result: Result, apart: Difference, sigmas: float) -> dict:
    ours, theirs = solution.camera.values, result.camera.values
    board = {}
    shaped = solution.board
    if result.board is not None and shaped is not None:
        board["board_max"] = float(np.linalg.norm(shaped.points - result.board, axis=1).max())
    return board | {
        "rms_point": solution.rms_point - result.rms_point,
        "projection_max_px": apart.max_px,
        "projection_rms_px": apart.rms_px,
        "pixels_outside": apart.outside,
        "sigmas": sigmas,
        "parameters": {name: ours[name] - theirs[name] for name in ours},
    }


def _rounding(solution: Calibration) -> float:
    """The largest effect on an rms of rounding the image points to float32, px: a unit in the last place."""
    largest = float(np.abs(solution.observations.uv).max(initial=1.0))
    return float(np.spacing(np.float32(largest)))


def same_sigmas(solution: Calibration, rounded: bool) -> float:
    """The joint distance in standard deviations up to which the parameters of two solutions count as the same optimum.

    Errors of e px in the coordinates, independent of the noise with sigma_0, move the optimum by e / sigma_0 standard
    deviations times the root of a chi² with as many degrees of freedom as there are parameters.
    """
    scale = sigma_0(solution)
    if not (rounded and scale > 0):
        return SIGMAS
    moved = _rounding(solution) / np.sqrt(12) / scale * np.sqrt(solution.free.any(0).sum())
    return float(np.hypot(SIGMAS, ROUNDED * moved))


def distance_in_sigmas(solution: Calibration, result: Result) -> float:
    """sqrt(δᵀ S δ) / sigma_0: the joint difference of the free parameters in standard deviations."""
    delta = np.linalg.lstsq(solution.free, solution.camera.params - result.camera.params, rcond=None)[0]
    reduced = reduce(solution.normal, eliminate_poses(solution.normal))
    scale = sigma_0(solution)
    if not scale > 0:
        return float("nan")
    return float(np.sqrt(max(delta @ reduced @ delta, 0.0)) / scale)
