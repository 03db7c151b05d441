"""The second pass over pictures: the points are fitted again with the camera of the first pass.

A first calibration tells where each pixel lies on the board. Corners are fitted again on edges that are
straight there, discs get the bias of their centre taken off, and the camera is refined until the points
stay where they are. How large the windows may be depends on how flat the board is: several sizes are tried. The
new points are kept where the one rule for what is better says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess import figures
from camcal.assess.holdout import HoldOut, hold_out
from camcal.data.observations import Observations, View
from camcal.detect import targets
from camcal.detect.camera_pass import WINDOWS
from camcal.detect.part import KEPT_PARTS
from camcal.detect.refine_images import refine_images
from camcal.detect.saddle import INNER_HALF
from camcal.detect.targets.circles import Circles
from camcal.errors import CamcalError
from camcal.model.pose import Pose
from camcal.plan.better import Candidate, better
from camcal.plan.progress import Attempt, Change, Progress, stage_of
from camcal.solve.calibration import Calibration
from camcal.solve.refine import refine, refit

#: rounds end where a new camera moves its projections by less than this, px. Only the shape of the edges is
#: taken from the camera, so that the corners move by some hundredths of it.
SETTLED = 0.1
#: the corrections shrink by ten or more from round to round; four leave nothing
ROUNDS = 4
#: views on which the size of the windows is chosen, where there are twice as many or more: these would tell a
#: difference of their errors that is smaller by a factor of 1.4, and several sizes take twice the time of one
TRIED_ON = 12
#: targets whose corners have a second pass; those of tags have too little room for it
SHARPENED = ("checkerboard", "charuco")


def _applies(progress: Progress) -> bool:
    target = progress.given.target or {}
    kind = "" if "boards" in target else str(target.get("kind", ""))  # of one board all squares are alike
    known = kind in SHARPENED or kind.endswith("circles")
    wanted = progress.options.refine_points is not False
    return wanted and progress.best is not None and known and bool(progress.given.files)


def _second_pass(progress: Progress) -> Change:
    first, found = progress.fit, progress.given
    window, points, current, after = _in_best_windows(progress)
    rounds, change = 1, _projections_moved(first, current)
    while rounds < ROUNDS and change > SETTLED:
        points, rounds = _again(points, found, current, (window,))[0], rounds + 1
        new = _refitted(current, points, progress)
        change, current, after = _projections_moved(current, new), new, None
    KEPT_PARTS.clear()  # pictures are not needed further
    before, after = hold_out(first, progress.how), after or hold_out(current, progress.how)
    kept, why = True, "asked for"
    if progress.options.refine_points is None:
        kept, why = better(Candidate(current, after), Candidate(first, before))
        if not kept:
            kept, why = _better_on_a_free_board(current, first, progress, why)
    notes: dict[str, Any] = {
        "rounds": rounds,
        "window": window,
        "moved_px": float(np.sqrt(np.square(points.uv - found.uv).sum(1).mean())),
        "holdout_before": _rms(before),
        "holdout_after": _rms(after),
        "kept": kept,
    }
    stage = stage_of(
        "second-pass", current, current.fit.seconds, {"kept": kept, "why": why, "window": window}
    )
    if not kept:
        return Change(stage=stage, notes={"second_pass": notes})
    return Change(
        fit=Candidate(current, after), instead=True, given=points, stage=stage, notes={"second_pass": notes}
    )


def _in_best_windows(progress: Progress) -> tuple[float, Observations, Calibration, HoldOut | None]:
    """The window size that is better than the default, or the default; its points, the fit to them, and its hold-out
    where that is known.

    It is chosen on a part of the views where these are many.
    """
    whole, found = progress.fit, progress.given
    fit, tried = _of_some_views(whole, progress), []
    part = fit is not whole
    for window, points in zip(WINDOWS, _again(found, found, fit, WINDOWS), strict=False):
        fit = _refitted(fit, points, progress)  # from the fit to the smaller windows, which is near
        tried.append((window, points, fit, Candidate(fit, hold_out(fit, progress.how))))
    best = next((t for t in tried if t[0] == INNER_HALF), tried[0])
    for other in sorted(tried, key=lambda t: figures.ranked(_rms(t[3].holdout))):
        if other is best or better(other[3], best[3])[0]:
            best = other
            break
    window, points, fit, candidate = best
    if not part:
        return window, points, fit, candidate.holdout
    points = _again(found, found, whole, (window,))[0]
    return window, points, _refitted(whole, points, progress), None


def _of_some_views(whole: Calibration, progress: Progress) -> Calibration:
    """The fit to `TRIED_ON` views spread over all where there are twice as many; the whole fit where that fails."""
    count = len(whole.poses)
    if count < 2 * TRIED_ON:
        return whole
    some = np.arange(TRIED_ON) * count // TRIED_ON
    try:
        return refine(whole.camera, whole.poses[some], whole.observations.of_views(some), progress.how)
    except CamcalError:  # as some alone may not determine what all do
        return whole


def _better_on_a_free_board(
    new: Calibration, old: Calibration, progress: Progress, why: str
) -> tuple[bool, str]:
    """Return whether new points are preferred with the board's shape estimated, and the reason; else the given one.

    Residuals of a board that is not quite flat are the same for both, several times what corners gain, and hide it.
    """
    how = replace(progress.how, board="free")
    try:
        free = [refit(fit, fit.observations, how) for fit in (new, old)]
        kept, reason = better(*(Candidate(fit, hold_out(fit, how)) for fit in free))
    except CamcalError:
        return False, why  # too few views for a free board
    return (True, f"with the board's shape estimated {reason}") if kept else (False, why)


def _rms(held: HoldOut | None) -> float | None:
    return None if held is None else held.figures.rms_point


def _refitted(fit: Calibration, points: Observations, progress: Progress) -> Calibration:
    """The fit to the same views and rows with other points."""
    places = [points.view_ids.index(v) for v in fit.observations.view_ids]
    data = points.of_views(places)
    data = replace(fit.observations, uv=data.uv)
    return refine(fit.camera, fit.poses, data, progress.how)


def _again(
    points: Observations, found: Observations, fit: Calibration, windows: Sequence[float]
) -> list[Observations]:
    """The points measured with the camera of a fit, for each window size; discs have none.

    Views without a pose stay as they are.
    """
    poses = dict(zip(fit.observations.view_ids, fit.poses, strict=True))
    if str((found.target or {}).get("kind", "")).endswith("circles"):
        return [_centred(found, fit, poses)]
    return refine_images(points, fit.camera, poses, windows=windows)


def _projections_moved(old: Calibration, new: Calibration) -> float:
    """The rms difference between two fits' projections of the points of the same rows, px."""
    moved = (new.residuals + new.observations.uv) - (old.residuals + old.observations.uv)
    return float(np.sqrt(np.nanmean(np.square(moved).sum(1))))


def _centred(found: Observations, fit: Calibration, poses: Mapping[str, Pose]) -> Observations:
    """Disc centres corrected for the bias of their images' centroids, as the camera predicts it."""
    target = _circles(found.target or {})

    def centred(view: View) -> View:
        pose = poses.get(view.id)
        if pose is None or view.point_ids is None:
            return view
        shift = target.apparent_shift(fit.camera, pose, view.point_ids)
        return replace(view, uv=view.uv - np.where(np.isfinite(shift), shift, 0.0))

    return found.map_views(centred)


def _circles(described: Mapping[str, Any]) -> Circles:
    unit = "" if described["unit"] in ("unit", "square") else described["unit"]
    spec = f"{described['kind']}:{described['columns']}x{described['rows']}:{described['square']!r}{unit}"
    if described.get("diameter"):
        spec += f":{described['diameter']!r}{unit}"
    made = targets.make(spec)
    assert isinstance(made, Circles)
    return made


SECOND_PASS = Attempt("second-pass", _applies, _second_pass)
