"""The distribution of the residuals: heavier or lighter tails than Gaussian noise, rounded coordinates.

With x = |r|² over its mean in the view, Gaussian noise in two coordinates gives x an exponential distribution
and E[x²] = 2, whatever the noise of each view. The mean of x² over N points scatters by 2 / √N (delta method,
the mean of x being estimated too).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.figures import standard_lengths
from camcal.assess.warning import CalibrationWarning
from camcal.least_squares.scales import UNIFORM

#: Deviations of E[x²] beyond which the noise is not Gaussian. The mean of x² is skewed: of 100,000 and more clean sets
#: simulated for each size, .16 % of those of 50 points, .08 % of 200 and .02 % of 700 were taken for heavy-tailed.
SIGNIFICANT = 4.5
#: Least number of points for the test; with fewer than 36 even Laplace noise differs by no more than 4.5 deviations
#: on average: (3.5 - 2) √36 / 2.
LEAST_IN_ALL = 50
#: Coordinates that lie on whole pixels by chance: hardly ever those of four points.
LEAST_ROUNDED = 4
#: steps; some hundred times the rounding of coordinates of 10,000 px in 64 bits
ON_GRID = 1e-9
#: Limits of E[x²] that are reported: uniform noise has 1.4, Laplace 3.5 and Student's t of five degrees of freedom 5,
#: the last two 2.6 and 2.4 after rejection of outliers. Real boards that fit well have 1.8 to 2.1.
LIGHT, HEAVY = 1.7, 2.3
#: Views with fewer points are scaled jointly: their own means are too uncertain.
LEAST_POINTS = 12
#: Share of coordinates on whole (or half) pixels above which they were rounded.
ROUNDED = 0.98


def tails(facts: Facts) -> Iterator[CalibrationWarning]:
    """Residuals that are not Gaussian after normalising each view by its own noise."""
    moment, deviations = fourth_moment(facts)
    if deviations < -SIGNIFICANT and moment < LIGHT:
        yield CalibrationWarning(
            "light-tailed-residuals",
            f"the residuals are distributed uniformly (fourth moment {moment:.2f}; Gaussian noise has 2, "
            "uniform noise 1.4), as those of rounded coordinates are.",
            "Give the points with all digits that the detector provides.",
            "note",
        )
    if deviations > SIGNIFICANT and moment > HEAVY:
        yield CalibrationWarning(
            "heavy-tailed-residuals",
            f"large residuals are more frequent than with Gaussian noise (fourth moment {moment:.2f} instead of "
            "2): points of different quality, or undetected outliers.",
            "Weight the points by a robust loss (--robust huber), or give sigmas with them in a table.",
            "note",
        )


def fourth_moment(facts: Facts) -> tuple[float, float]:
    """E[x²], and the number of standard deviations by which it differs from 2; (2, 0) for fewer than
    `LEAST_IN_ALL` points.
    """
    lengths, data = standard_lengths(facts.solution), facts.solution.observations
    counts = data.per_block(data.used).astype(int)
    # each view is a group of its own, the small ones one together
    group = np.repeat(np.where(counts < LEAST_POINTS, len(counts), np.arange(len(counts))), counts)
    size = np.bincount(group, minlength=len(counts) + 1)
    used = size[group] >= LEAST_POINTS
    n, squares = int(used.sum()), lengths**2
    if n < LEAST_IN_ALL or not np.isfinite(squares[used]).all():
        return 2.0, 0.0
    mean = np.bincount(group, squares, len(size)) / np.maximum(size, 1)
    if not (mean[group[used]] > 0).all():
        return 2.0, 0.0
    # with the mean of n exponential values instead of the true mean, E[x²] is 2 n / (n + 1)
    x2 = (squares / mean[group]) ** 2 * ((size + 1) / np.maximum(size, 1))[group]
    moment = float(x2[used].mean())
    return moment, (moment - 2) / (2 / np.sqrt(n))


def rounded(facts: Facts) -> Iterator[CalibrationWarning]:
    """Image points on whole pixels."""
    uv = facts.image_points
    if len(uv) < LEAST_ROUNDED:
        return
    for step, words in ((1.0, "whole"), (0.5, "half")):
        on_grid = np.abs(uv / step - np.round(uv / step)) < ON_GRID
        if on_grid.mean() > ROUNDED:
            yield CalibrationWarning(
                "rounded-coordinates",
                f"the image points are {words} pixels: rounding alone causes an error of "
                f"{step * UNIFORM:.2g} px in each "
                "coordinate.",
                "Give the points with all digits, or find them with sub-pixel accuracy.",
                "note",
            )
            return
