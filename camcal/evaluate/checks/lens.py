"""The lens model: whether it is valid for the points and over the whole image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.evaluate.checks.facts import Facts
from camcal.evaluate.difference import grid_of
from camcal.types import CalibrationWarning


def outside_domain(facts: Facts) -> Iterator[CalibrationWarning]:
    """Used points that the camera cannot see: behind it, or beyond the fold of the lens."""
    lost = int(np.isnan(facts.solution.used_residuals).any(1).sum())
    if lost:
        yield CalibrationWarning(
            "points-outside-model",
            f"{lost} used points lie behind the camera or beyond the fold of the lens model.",
            "Check the order of the points; try another model.",
        )


def fold_in_image(facts: Facts) -> Iterator[CalibrationWarning]:
    """Pixels without a ray: the distortion folds back or has a pole inside the image."""
    if facts.unseen is None or not len(facts.unseen) or facts.image_size is None:
        return
    share = len(facts.unseen) / len(grid_of(facts.image_size))
    nearest = float(np.linalg.norm(facts.unseen - facts.camera.params[2:4], axis=1).min())
    yield CalibrationWarning(
        "fold-in-image",
        f"the distortion folds back or has a pole inside the image: {share:.1%} of the pixels, "
        f"from {nearest:.0f} px of the principal point outward, have no ray.",
        "Bring the target into the corners of the picture, or choose a model with fewer coefficients, "
        "or one for wide lenses.",
    )
