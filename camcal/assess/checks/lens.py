"""The lens model: whether it is valid at the points and over the whole image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.difference import grid_of
from camcal.assess.warning import CalibrationWarning

#: a fold in a smaller share of the picture affects only its outermost corners; from a fifth on, it affects the part
#: that is used
TIPS, MUCH = 0.02, 0.2


def outside_domain(facts: Facts) -> Iterator[CalibrationWarning]:
    """Used points that the camera cannot see: behind it, or beyond the fold of the lens."""
    lost = int(np.isnan(facts.solution.used_residuals).any(1).sum())
    if lost:
        yield CalibrationWarning(
            "points-outside-model",
            f"{lost} used points lie behind the camera or beyond the fold of the lens model.",
            "Check the order of the points; try another model.",
            "wrong",
        )


def fold_in_image(facts: Facts) -> Iterator[CalibrationWarning]:
    """Pixels without a ray: the distortion folds back or has a pole inside the image.

    For a lens that sees the whole half space and all points, it is rather the limit of its image: the corners
    outside a fisheye's image circle.
    """
    if facts.unseen is None or not len(facts.unseen) or facts.image_size is None:
        return
    centre = facts.camera.params[2:4]
    share = len(facts.unseen) / len(grid_of(facts.image_size))
    nearest = float(np.linalg.norm(facts.unseen - centre, axis=1).min())
    limit = facts.camera.lens.limit_angle(facts.camera.params)
    if limit >= np.pi / 2 and nearest >= _farthest(facts, centre):
        yield CalibrationWarning(
            "image-circle",
            f"{share:.1%} of the pixels, from {nearest:.0f} px of the principal point outward, beyond all points, have "
            f"no ray: the lens model ends at {np.degrees(limit):.0f} degrees from the axis.",
            "This is harmless if the picture is dark there; otherwise move the target farther out.",
            "note",
        )
        return
    yield CalibrationWarning(
        "fold-in-image",
        f"the distortion folds back or has a pole inside the image: {share:.1%} of the pixels, "
        f"from {nearest:.0f} px of the principal point outward, have no ray.",
        "Bring the target into the corners of the picture, or choose a model with fewer coefficients, "
        "or one for wide lenses.",
        "note" if share < TIPS else "doubtful" if share < MUCH else "wrong",
    )


def _farthest(facts: Facts, centre: np.ndarray) -> float:
    """The largest distance of a used point from the principal point, px."""
    return float(np.linalg.norm(facts.image_points - centre, axis=1).max(initial=0.0))
