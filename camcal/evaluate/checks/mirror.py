"""Pictures that were mirrored as a whole: the lens is then mirrored, too, and nothing else shows it.

A board that looks the same from both sides is found in good order in a mirrored picture; even where the order
tells, the view fits some pose. What does not fit is the principal point, and what else of the lens is not
symmetric. With S = diag(-1, 1, 1) a view of points X at u is compared with one of S X at (width - 1 - u, v),
which a pose S R S, S t before the same camera shows: the start of its own refinement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from camcal.evaluate.checks.facts import Facts
from camcal.refine.poses import refine_poses
from camcal.types import Array, CalibrationWarning, Poses

#: The mirrored view has to be likelier by this, n ln(sum of squares / that of the mirrored view): 1e6 to one; ...
LIKELIER = 14.0
#: ... and the sum of squares to be this many times as large: neighbouring points share errors, and good real
#: views reach 1.4. Views that were mirrored have 2 to 5 at 0.2 px noise, and more with less.
SQUARES = 1.8
#: Larger problems are not searched: it takes as long as the refinement itself.
MOST_POINTS = 20_000
_MIRROR = np.array([-1.0, 1.0, 1.0])


def mirrored_pictures(facts: Facts) -> Iterator[CalibrationWarning]:
    """Views that fit much better as mirror images."""
    few = facts.solution.correspondences.point_count <= MOST_POINTS
    if not facts.planar or facts.image_size is None or len(facts.views) < 3 or not few:
        return
    gains, counts = gains_of_mirroring(facts)
    found = np.flatnonzero((counts * gains > LIKELIER) & (gains > np.log(SQUARES)))
    if not len(found) or 2 * len(found) > len(facts.views):
        return
    names = ", ".join(facts.views[i].id for i in found[:5]) + (", ..." if len(found) > 5 else "")
    yield CalibrationWarning(
        "mirrored-picture",
        f"{len(found)} of {len(facts.views)} views fit much better as mirror images: {names}.",
        "The pictures seem to be mirrored as a whole, which bends the camera: mirror them back, or leave them out.",
    )


def gains_of_mirroring(facts: Facts) -> tuple[Array, Array]:
    """ln(own sum of squares / that of the mirrored view), -inf where it does not project, and points; (V,) each."""
    solution, width = facts.solution, (facts.image_size or (0, 0))[0]
    kept = [v.take(m) for v, m in zip(facts.views, solution.inliers, strict=True)]
    views = [
        replace(v, xyz=v.xyz * _MIRROR, uv=np.c_[width - 1 - v.uv[:, 0], v.uv[:, 1]], sigma=None)
        for v in kept
    ]
    poses = solution.poses
    start = Poses(poses.rotations * np.outer(_MIRROR, _MIRROR), poses.translations * _MIRROR)
    _, costs, _ = refine_poses(facts.camera, views, start)
    own = np.array(
        [0.5 * np.square(r[m]).sum() for r, m in zip(solution.residuals, solution.inliers, strict=True)]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(own / costs)
    return np.where(np.isfinite(ratios), ratios, -np.inf), np.array([len(v) for v in kept])
