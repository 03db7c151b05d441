"""The shape of the points of each view, and the closed forms that it permits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.data.observations import Observations, View
from camcal.data.shape import Shapes, batches, shapes
from camcal.errors import DataError, EstimationError

__all__ = ["Shapes", "batches", "shapes"]

#: Points count as collinear if their extent across a line is below this fraction of the extent along it.
COLLINEAR = 1e-4
#: If more than this fraction of a view's points is behind the camera, the estimate is invalid.
BEHIND = 0.1
#: extent out of the plane relative to the largest, below which it is rounding of a table's six digits and not stated
FLAT = 1e-6

LEAST_PLANAR, LEAST_3D = 4, 6  # points that a homography and a projection matrix need


def unusable(correspondences: Observations, least_3d: int = LEAST_3D) -> dict[int, str]:
    """The views that no closed form can use, by index, each with what was found and what is needed."""
    form = correspondences.shapes
    counts = correspondences.blocks.counts
    few = counts < LEAST_PLANAR
    line = form.spreads[:, 1] <= COLLINEAR * form.spreads[:, 0]
    few_3d = ~form.planar & (counts < least_3d)
    edge_on = form.image_spreads[:, 1] <= COLLINEAR * form.image_spreads[:, 0]
    found: dict[int, str] = {}
    for i in np.flatnonzero(few | line | few_3d | edge_on):
        n = counts[i]
        if few[i]:
            found[int(i)] = f"{n} points; at least 4 on a plane or {least_3d} in space are needed"
        elif line[i]:
            found[int(i)] = f"all {n} points lie on a line; points spread over a plane or in space are needed"
        elif few_3d[i]:
            found[int(i)] = f"{n} points in space; at least {least_3d} are needed"
        else:
            found[int(i)] = "its image points lie on a line; a target seen edge-on determines no camera"
    return found


def distinct(views: Sequence[View]) -> int:
    """The number of views that are not exact repetitions of another."""
    return len({(v.xyz.tobytes(), v.uv.tobytes()) for v in views})


def all_same(views: Sequence[View]) -> bool:
    """Return whether every view is an exact repetition of the first."""
    first = views[0]
    return all(np.array_equal(v.uv, first.uv) and np.array_equal(v.xyz, first.xyz) for v in views[1:])


def check(correspondences: Observations, least_3d: int = LEAST_3D) -> Shapes:
    """Return the shapes of the views after checking that all can be used.

    Raises
    ------
    DataError
        If there is no view, or one that no closed form can use.
    """
    if not correspondences.views:
        raise DataError("there is no view to calibrate from.", "At least one view with points is needed.")
    form = correspondences.shapes
    bad = unusable(correspondences, least_3d)
    if bad:
        index, reason = next(iter(bad.items()))
        more = f" (and {len(bad) - 1} more such views)" if len(bad) > 1 else ""
        pose = (
            ""
            if len(correspondences.views) > 1
            else " Where the camera is known: camcal pose CAMERA POINTS (3 points)."
        )
        raise DataError(
            f"view '{correspondences.views[index].id}': {reason}{more}.",
            "Remove it, or give it more points." + pose,
        )
    return form


def view_in_space(correspondences: Observations, what: str) -> View:
    """The only view, of points in space, that a closed form accepts; `what` is its name in the message.

    Raises
    ------
    DataError
        As `check`.
    EstimationError
        For several views, and for points on a plane.
    """
    form = check(correspondences)
    if len(correspondences) != 1 or form.planar[0]:
        found = "a plane" if len(correspondences) == 1 else f"{len(correspondences)} views"
        raise EstimationError(
            f"{what} takes one view of points in space, not {found}.", "Use 'zhang' or 'dlt'."
        )
    return correspondences.views[0]


def behind_camera(view: str, behind: int, count: int) -> EstimationError:
    """The error for a view whose points cannot all be in front of the estimated camera."""
    return EstimationError(
        f"view '{view}': {behind} of {count} points would be behind the camera; all must be in front of it.",
        "Check that each image point belongs to its object point, and the order of the columns.",
    )


def choose(correspondences: Observations) -> tuple[list[str], str]:
    """The closed forms that suit the data, the best last, and the reason.

    Returns
    -------
    names : list of str
        Keys of `CLOSED_FORMS`; the last is the one to start a refinement from.
    why : str

    Raises
    ------
    DataError
        If a view cannot be used at all (see `unusable`).
    """
    form, points = check(correspondences), correspondences.point_count
    ratio = form.spreads[:, 2] / form.spreads[:, 0]
    count = len(ratio)
    if count == 1 and not form.planar[0]:
        return ["central", "dlt"], (
            f"one view of {points} points in space "
            f"(their extent off the best plane is {ratio[0]:.2g} of the largest)"
        )
    if form.planar.all():
        bowed = ratio.max()
        flat = "on a plane" if bowed < FLAT else f"nearly on a plane (off it by {bowed:.2g} of their extent)"
        return ["zhang"], f"{count} view{'s' * (count > 1)} of points {flat}"
    spatial = int((~form.planar).sum())
    return [
        "dlt"
    ], f"{spatial} of {count} views hold points in space: a projection matrix for each, K as the median"


def require_determined(correspondences: Observations, free: Sequence[str]) -> None:
    """Check that the views determine the free entries of the camera matrix.

    A view of a plane gives two constraints on them (Zhang 2000, section 2.3), a view of points in space all
    five.

    Parameters
    ----------
    free : sequence of str
        Names of the free ones among fx, fy, cx, cy, skew (one name if fx and fy are coupled).

    Raises
    ------
    EstimationError
        If there are fewer constraints than unknowns.
    """
    views = correspondences.views
    form = correspondences.shapes
    if not form.planar.all():
        return
    different = distinct(views)
    if 2 * different >= len(free):
        return
    found = f"{different} view{'s' * (different > 1)} of a plane" + (
        " (the others repeat them)" if different < len(views) else ""
    )
    raise EstimationError(
        f"{found} determine{'s' * (different == 1)} {2 * different} entries of the camera matrix; "
        f"{len(free)} are free ({', '.join(free)}).",
        f"Take {-(-len(free) // 2)} or more views from other directions, or fix some (--fix cx,cy,aspect).",
    )
