"""Homographies of planar views against cv2.findHomography: both minimise the reprojection error.

cv2 rounds the points to float32 and stops after ten Levenberg-Marquardt iterations, camcal takes two
Gauss-Newton steps from an algebraic estimate; what remains between them is compared with the rms of the fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from camcal.assess.figures import rms_point
from camcal.data.observations import View
from camcal.geometry import homography
from camcal.model.pose import Array
from camcal.peers.base import LEAST_POINTS, Entry, entry
from camcal.start.shape import shapes

NAME = "cv2.findHomography"
#: Transferred points may differ by this part of the fit's own rms (what neither method's stopping resolves)
#: ...
PART = 0.02
#: ... or by this, px: rounding to float32 in cv2, at most 2.4e-4 px in a picture of 8,000 px.
FLOOR_PX = 1e-3
#: Gauss-Newton steps: both go to the minimum, also of a wide lens, where a start is content with two.
STEPS = 10
#: A view is a plane where the extent across is below this part of the extent along it: rounding.
FLAT = 1e-9


def against_cv2(views: Sequence[View], stage: str) -> Entry | None:
    """Compare the homographies of the planar views; None if there are none.

    The entry fails where a view's transferred points differ and cv2's homography is the better one.
    """
    worst, ours_all, theirs_all, failed = 0.0, [], [], []
    for view, ours, theirs in _transfers(views):
        a, b = rms_point(ours), rms_point(theirs)
        apart = float(np.linalg.norm(ours - theirs, axis=1).max())
        worst = float(np.maximum(worst, apart))  # NaN stays
        ours_all.append(ours)
        theirs_all.append(theirs)
        if not apart <= max(PART * a, FLOOR_PX) and (b < a or np.isnan(a)):
            failed.append(f"{view.id} ({b:.6g} instead of {a:.6g} px)")
    if not ours_all:
        return None
    ours_rms, theirs_rms = rms_point(np.concatenate(ours_all)), rms_point(np.concatenate(theirs_all))
    why = f"cv2's homography is better in {len(failed)} views, first {failed[0]}" if failed else None
    figures = {"rms_point": ours_rms - theirs_rms, "projection_max_px": worst}
    return entry(stage, NAME, "fail" if failed else "pass", why, {"rms_point": theirs_rms}, figures)


def _transfers(views: Sequence[View]) -> Iterator[tuple[View, Array, Array]]:
    """Residuals (N, 2) of each planar view by camcal's homography and by cv2's."""
    form = shapes(views)
    flat = form.spreads[:, 2] <= FLAT * form.spreads[:, 0]
    kept = [i for i, view in enumerate(views) if flat[i] and len(view) >= LEAST_POINTS]
    for members in homography.by_count(len(views[i]) for i in kept):
        chosen = [kept[m] for m in members]
        uv = np.array([views[i].uv for i in chosen])
        local = np.array([views[i].xyz for i in chosen]) - form.origins[chosen][:, None]
        plane = local @ form.axes[chosen][:, :, :2]
        ours = homography.transfer(homography.solve(plane, uv, steps=STEPS)[0], plane)
        for i, points, seen, mapped in zip(chosen, plane, uv, ours, strict=True):
            found, _ = cv2.findHomography(points.reshape(-1, 1, 2), seen.reshape(-1, 1, 2), 0)
            if found is not None:
                theirs = homography.transfer(found[None], points[None])[0]
                yield views[i], mapped - seen, theirs - seen
