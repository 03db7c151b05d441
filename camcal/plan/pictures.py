"""From what was found in pictures to a camera, going back to the pictures with each camera.

A first calibration tells where each pixel lies on the board. Corners are fitted again on edges that are
straight there, discs get the bias of their centre taken off, and the calibration is repeated until the points
stay where they are. The new points are kept only if they lower the error on views held out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess.holdout import k_fold
from camcal.data.observations import Correspondences
from camcal.detect import targets
from camcal.detect.refine_images import refine_images
from camcal.detect.targets.circles import Circles
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.plan.pipeline import calibrate
from camcal.solve.noise import unweighted
from camcal.solve.solution import Solution
from camcal.solve.solve import refine

#: rounds end where a new camera moves its projections by less than this, px. Only the shape of the edges is
#: taken from the camera, so that the corners move by some hundredths of it.
SETTLED = 0.1
ROUNDS = 4
#: targets whose corners have a second pass; those of tags have too little room for it
SHARPENED = ("checkerboard", "charuco")

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]


def calibrate_pictures(
    found: Correspondences,
    refine_points: bool | None = None,
    on_event: OnEvent | None = None,
    **options: Any,
) -> tuple[Solution, Correspondences]:
    """Calibrate from what `detect_images` found, and refine the points with the camera.

    Parameters
    ----------
    found : Correspondences
        With `files`, so that the pictures can be read again.
    refine_points : bool, optional
        Whether to go back to the pictures; left out, the refined points are kept if the hold-out error falls.
    on_event : callable, optional
        Called with `("refined-points", {rounds, moved_px, holdout_before, holdout_after, kept})`.
    **options
        Of `camcal.plan.pipeline.calibrate`.

    Returns
    -------
    solution : Solution
    points : Correspondences
        The points that it was made from.
    """
    rough = {**options, "checks": False, "crosscheck": False, "board_shape": "flat"}
    if refine_points is not False:
        first = calibrate(found, **rough)
        points, told = _settled(found, first, rough)
        if points is not None:
            before, after = _holdout(first), _holdout(calibrate(points, **rough))
            kept = bool(refine_points) or after < before < np.inf
            told |= {"holdout_before": before, "holdout_after": after, "kept": kept}
            if on_event is not None:
                on_event("refined-points", told)
            found = points if kept else found
            solution = calibrate(found, **options)
            return replace(solution, extras={**solution.extras, "refined_points": told}), found
    return calibrate(found, **options), found


def _settled(
    found: Correspondences, solution: Solution, options: Mapping[str, Any]
) -> tuple[Correspondences | None, dict[str, Any]]:
    """The points after as many rounds as they need; None where the target has no second pass."""
    again = _second_pass(found)
    if again is None:
        return None, {}
    current, rounds, change = found, 0, np.inf
    while rounds < ROUNDS and change > SETTLED:
        current, rounds = again(current if rounds else found, solution), rounds + 1
        new = calibrate(current, **options)
        change, solution = _projections_moved(solution, new), new
    return current, {"rounds": rounds, "moved_px": _moved(found, current)}


def _projections_moved(old: Solution, new: Solution) -> float:
    """Root mean square difference of where two solutions project the points that both hold, px."""
    before = {v.id: r + v.uv for v, r in zip(old.correspondences.views, old.residuals, strict=True)}
    squares = [
        ((r + v.uv - before[v.id]) ** 2).sum(1)
        for v, r in zip(new.correspondences.views, new.residuals, strict=True)
        if v.id in before
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(squares)))) if squares else 0.0


def _second_pass(
    found: Correspondences,
) -> Callable[[Correspondences, Solution], Correspondences] | None:
    kind = str((found.target or {}).get("kind", ""))
    if kind.endswith("circles"):
        return lambda _, solution: _centred(found, solution)
    return _sharpened if kind in SHARPENED else None


def _sharpened(points: Correspondences, solution: Solution) -> Correspondences:
    """Corners fitted again with the camera of a solution; views that it does not hold stay as they are."""
    poses = _poses_by_id(solution)

    def board_from_pixel(index: int, pixels: Array) -> Array:
        pose = poses.get(points.views[index].id)
        if pose is None:
            return np.full(pixels.shape, np.nan)
        return on_board(solution.camera, pose, pixels)

    return refine_images(points, board_from_pixel)[0]


def on_board(camera: Camera, cam_from_board: Pose, pixels: Array) -> Array:
    """Where pixels (..., 2) lie on the plane z = 0 of a board, (..., 2) in its unit; NaN off the plane."""
    rays = camera.unproject(pixels) @ cam_from_board.rotation
    origin = -cam_from_board.rotation.T @ cam_from_board.translation
    with np.errstate(all="ignore"):
        reach = -origin[2] / rays[..., 2]
        place = origin[:2] + reach[..., None] * rays[..., :2]
    return np.where((reach > 0)[..., None], place, np.nan)


def _centred(found: Correspondences, solution: Solution) -> Correspondences:
    """Centres of discs less the bias of their pictures' centroids, as the camera predicts it."""
    target = _circles(found.target or {})
    poses = _poses_by_id(solution)
    views = []
    for view in found.views:
        pose = poses.get(view.id)
        if pose is not None and view.point_ids is not None:
            shift = target.apparent_shift(solution.camera, pose, view.point_ids)
            view = replace(view, uv=view.uv - np.where(np.isfinite(shift), shift, 0.0))
        views.append(view)
    return replace(found, views=tuple(views))


def _circles(described: Mapping[str, Any]) -> Circles:
    unit = "" if described["unit"] in ("unit", "square") else described["unit"]
    spec = f"{described['kind']}:{described['columns']}x{described['rows']}:{described['square']!r}{unit}"
    if described.get("diameter"):
        spec += f":{described['diameter']!r}{unit}"
    made = targets.make(spec)
    assert isinstance(made, Circles)
    return made


def _poses_by_id(solution: Solution) -> dict[str, Pose]:
    return {v.id: p for v, p in zip(solution.correspondences.views, solution.poses, strict=True)}


def _moved(a: Correspondences, b: Correspondences) -> float:
    """Root mean square distance of the points, px."""
    squares = [((p.uv - q.uv) ** 2).sum(1) for p, q in zip(a.views, b.views, strict=True)]
    return float(np.sqrt(np.concatenate(squares).mean()))


def _holdout(solution: Solution) -> float:
    """rms_point of 4 folds, px, all points alike; inf where there are too few views."""
    held = k_fold(
        unweighted(solution.correspondences),
        solution.poses,
        solution.inliers,
        lambda data, poses, masks: refine(solution.camera, poses, data, inliers=masks),
    )
    return held.figures.rms_point if held else np.inf
