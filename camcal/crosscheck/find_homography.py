"""Homographies of planar views against cv2.findHomography: both minimise the reprojection error.

cv2 rounds the points to float32 and stops after ten Levenberg-Marquardt iterations, camcal takes two
Gauss-Newton steps from an algebraic estimate; what remains between them is compared with the rms of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from camcal.crosscheck.base import Entry, entry
from camcal.evaluate.figures import rms_point
from camcal.geometry import homography, projective
from camcal.types import Array, View

NAME = "cv2.findHomography"
#: Transferred points may differ by this part of the fit's own rms (what neither method's stopping resolves)
#: ...
PART = 0.02
#: ... or by this, px: rounding to float32 in cv2, at most 2.4e-4 px in a picture of 8,000 px.
FLOOR_PX = 1e-3


def against_cv2(views: Sequence[View], stage: str) -> Entry | None:
    """Compare the homographies of the views that are planar; None where there is none.

    The entry fails where a view's transferred points differ and cv2's homography is the better one.
    """
    worst = ours_total = theirs_total = 0.0
    count, failed = 0, []
    for view in views:
        plane = _plane_coordinates(view)
        if plane is None:
            continue
        ours = homography.transfer(homography.solve(plane[None], view.uv[None])[0], plane[None])[0]
        theirs = _cv2_transfer(plane, view.uv)
        if theirs is None:
            continue
        a, b = rms_point(ours - view.uv), rms_point(theirs - view.uv)
        apart = float(np.linalg.norm(ours - theirs, axis=1).max())
        worst, count = max(worst, apart), count + len(view)
        ours_total, theirs_total = ours_total + a * a * len(view), theirs_total + b * b * len(view)
        if apart > max(PART * a, FLOOR_PX) and b < a:
            failed.append(f"{view.id} ({b:.6g} instead of {a:.6g} px)")
    if not count:
        return None
    ours_rms, theirs_rms = (float(np.sqrt(t / count)) for t in (ours_total, theirs_total))
    why = f"cv2's homography is better in {len(failed)} views, first {failed[0]}" if failed else None
    figures = {"rms_point": ours_rms - theirs_rms, "projection_max_px": worst}
    return entry(stage, NAME, "fail" if failed else "pass", why, {"rms_point": theirs_rms}, figures)


def _plane_coordinates(view: View) -> Array | None:
    """Coordinates (N, 2) in the plane of a view's points; None where they are not on one, or too few."""
    if len(view) < 4:
        return None
    origin, axes, spread = projective.fit_plane(view.xyz)
    if spread[2] > 1e-9 * spread[0]:
        return None
    return (view.xyz - origin) @ axes[:, :2]


def _cv2_transfer(plane: Array, uv: Array) -> Array | None:
    found, _ = cv2.findHomography(plane.reshape(-1, 1, 2), uv.reshape(-1, 1, 2), 0)
    return None if found is None else homography.transfer(found[None], plane[None])[0]
