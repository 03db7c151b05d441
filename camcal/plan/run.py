"""The plan of a calibration with one lens model, and its start."""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Observations
from camcal.data.table import LARGEST_VALUE
from camcal.errors import DataError
from camcal.model import lenses
from camcal.plan.boards import SHAPES
from camcal.plan.minima import from_nothing
from camcal.plan.options import Options
from camcal.plan.outlying import FOREIGN, REJECT, SIGMAS, outliers_plan
from camcal.plan.progress import Attempt, Progress, follow
from camcal.plan.second_pass import SECOND_PASS
from camcal.start import known_pose, shape
from camcal.start.numbering import check_numbering

#: what makes a camera better: the pictures again, given sigmas, views that do not belong, the shape of the board
BETTER: tuple[Attempt, ...] = (SECOND_PASS, SIGMAS, REJECT, FOREIGN, *SHAPES)


def camera_plan() -> tuple[Attempt, ...]:
    """The attempts at the camera, with or without outliers."""
    return (*from_nothing(), *outliers_plan())


def plan() -> tuple[Attempt, ...]:
    """Every attempt that a calibration may make, in order; each decides whether it applies."""
    return (*camera_plan(), *BETTER)


def begun(given: Observations, asked: Options) -> Progress:
    """The progress before the first attempt."""
    lens = lenses.make(asked.model, asked.skew)
    return Progress(asked, lens, asked.how(lens), given, given.unweighted())


def solved(observations: Observations, asked: Options) -> Progress:
    """All attempts of the plan with the requested model.

    Raises
    ------
    DataError, EstimationError
        If the observations cannot be used, or do not determine a camera.
    """
    return follow(plan(), begun(usable(observations), asked))


def usable(observations: Observations, known: bool = False) -> Observations:
    """The observations without views that no closed form can use; these become `rejected`.

    Before a `known` camera four points in space are enough.

    Raises
    ------
    DataError
        If none is left, all are exact copies of one, or numbers are too large or too small to be computed with.
    """
    count = len(observations)
    _check_range(observations)
    if count > 1 and shape.all_same(observations.views):
        raise DataError(
            f"all {count} views hold exactly the same points, so they count as one; different views are needed.",
            "Move and tilt the target between views. To calibrate from a single view, keep one copy of it.",
        )
    least = known_pose.LEAST if known else shape.LEAST_3D
    bad = shape.unusable(observations, least_3d=least)
    if len(bad) == count:
        shape.check(observations, least)  # raises, with the reason of the first view
    check_numbering(observations)
    return observations.without(bad)


def _check_range(observations: Observations) -> None:
    """Raise a DataError for coordinates that readers refuse, and for a target too small for powers of its size."""
    for values, what in ((observations.xyz, "points"), (observations.uv, "image points")):
        if not (np.abs(values) <= LARGEST_VALUE).all():
            raise DataError(f"the {what} have a coordinate above {LARGEST_VALUE:g}.", "Are the data damaged?")
    extent = float(np.ptp(observations.xyz, axis=0).max()) if len(observations.xyz) else 0.0
    if 0 < extent < 1 / LARGEST_VALUE:
        raise DataError(
            f"the points lie within {extent:g} of each other; at least {1 / LARGEST_VALUE:g} is needed.",
            "Give them in a larger number of a smaller unit, such as millimetres.",
        )
