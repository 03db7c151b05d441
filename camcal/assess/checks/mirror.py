"""Mirrored pictures, which only the asymmetry of the lens reveals.

A board that looks the same from both sides is found in correct order in a mirrored picture; even if the order is
wrong, the view fits some pose. What does not fit is the principal point and any other asymmetry of the lens.

With S = diag(-1, 1, 1) a view of points X at u is compared with one of S X at (width - 1 - u, v),
which the pose S R S, S t explains with the same camera; this is the start of a separate refinement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from camcal.assess.causes import LEAST_VIEWS
from camcal.assess.checks import fit
from camcal.assess.checks.facts import Facts
from camcal.assess.figures import rms_of_views as per_view
from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import View
from camcal.geometry.numbers import median
from camcal.model.pose import Array, Poses
from camcal.solve.poses import refine_poses
from camcal.system.text import listed

#: The mirrored view must be more likely by this, n ln(sum of squares / that of the mirrored view): 1e6 to one; ...
LIKELIER = 14.0
#: ... and the sum of squares must be this many times as large: neighbouring points share errors, and good real
#: views reach 1.4. Views that were mirrored have 2 to 5 at 0.2 px noise, and more with less.
SQUARES = 1.8
#: Only views whose rms exceeds that of the median view by this factor are examined: mirrored ones have 1.3 or more.
SUSPECT = 1.15
_MIRROR = np.array([-1.0, 1.0, 1.0])


def mirrored_pictures(facts: Facts) -> Iterator[CalibrationWarning]:
    """Views that fit much better as mirror images."""
    if facts.blameless or any(fit.outliers(facts)):
        return  # gross points bias the camera, so that a better fit of mirrored views has no meaning
    found = mirrored_views(facts)
    if not len(found):
        return
    names = listed([facts.views[i].id for i in found])
    yield CalibrationWarning(
        "mirrored-picture",
        f"{len(found)} of {len(facts.views)} views fit much better as mirror images: {names}.",
        "The pictures seem to be mirrored, which biases the camera: mirror them back, or remove them.",
        "wrong",
    )


def mirrored_views(facts: Facts) -> Array:
    """The indices of views that fit much better as mirror images; empty if these are the majority.

    Also empty if the model does not fit the lens: its errors then depend on the position of a view.
    """
    none = np.zeros(0, int)
    if (
        not facts.planar
        or facts.image_size is None
        or len(facts.views) < LEAST_VIEWS
        or any(fit.systematic(facts))
    ):
        return none
    squares = np.square(per_view(facts.solution))
    chosen = np.flatnonzero(squares > SUSPECT**2 * median(squares))
    gains, counts = gains_of_mirroring(facts, chosen)
    found = chosen[(counts * gains > LIKELIER) & (gains > np.log(SQUARES))]
    return none if 2 * len(found) > len(facts.views) else found


def gains_of_mirroring(facts: Facts, chosen: Array) -> tuple[Array, Array]:
    """ln(own sum of squares / that of the mirrored view), -inf if it cannot be projected, and the number of points.

    Of the chosen views, (C,) each.
    """
    solution, width = facts.solution, (facts.image_size or (0, 0))[0]
    data = solution.observations
    kept = data.of_views(chosen).kept().unweighted().views
    poses = Poses(solution.poses.rotations[chosen], solution.poses.translations[chosen])
    start = Poses(poses.rotations * np.outer(_MIRROR, _MIRROR), poses.translations * _MIRROR)
    _, costs, _ = refine_poses(facts.camera, [mirrored(v, width) for v in kept], start)
    squares = np.where(data.used, np.square(solution.residuals).sum(1), 0.0)
    own = 0.5 * data.per_block(squares)[chosen]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(own / costs)
    return np.where(np.isfinite(ratios), ratios, -np.inf), np.array([len(v) for v in kept])


def mirrored(view: View, width: int) -> View:
    """A view with picture and target mirrored; unweighted."""
    uv = np.c_[width - 1 - view.uv[:, 0], view.uv[:, 1]]
    return replace(view, xyz=view.xyz * _MIRROR, uv=uv, sigma=None)
