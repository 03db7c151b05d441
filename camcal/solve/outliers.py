"""Outliers among points and views, by a test on the residuals.

With s the robust scale (median) and ν its degrees of freedom, |r|² / 2 s² of a good point follows F(2, ν).
A point is rejected if the probability of a larger value is below ALPHA / N (Bonferroni): with Gaussian noise,
one run in a thousand rejects any point. If sigmas are given but not yet used as weights, |r| of a point whose sigma
is k > 1 times the median is divided by k first. s is the larger of that of all points and that of the point's view
(without its outliers), so that a picture with more blur than the others does not lose many points. A view whose s
exceeds FAR times that of the median view, that loses more than two thirds of its points, or whose remaining points do
not determine a pose, is rejected as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.data.observations import Observations, View
from camcal.geometry.numbers import median
from camcal.least_squares.distributions import f_bound
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Estimate
from camcal.solve.losses import robust_sigma
from camcal.start import shape

ALPHA = 0.001  #: probability that clean data lose a point: one calibration of a thousand
#: efficiency of the median relative to the rms, for Gaussian noise in two coordinates: of N Rayleigh distributed
#: lengths, whose median is m = sqrt(2 ln 2) and whose density there m / 2, the variance of sigma is 1 / (4 N) from the
#: rms and 1 / (N m⁴) from the median
_MEDIAN_EFFICIENCY = float(np.log(2) ** 2)
#: times the median view's scale: above it, the scale is not noise of another size, and the view is rejected
FAR = 5.0
#: views are not rejected as a whole if fewer than this many would be left: two or three that agree only because of too
#: many parameters are not a majority
LEAST_LEFT = 5
#: a view that keeps less than this fraction of its points is not a valid view
LEAST_KEPT = 1 / 3
#: residuals below this fraction of the coordinates are rounding of the input, not outliers
_ROUNDING = 1e-7
#: rounds for the scale of a view without its outliers: each drops points, until the scale no longer decreases
_ROUNDS = 10
#: relative decrease below which a scale has converged
_SETTLED = 1e-9
#: Noise is not Gaussian if sigma from the rms exceeds that from the median by this factor plus so many times 1/√N.
#: The ratio of N Gaussian points scatters by .51/√N (4,000 simulated sets), so that 4/√N is eight deviations. Of 700
#: points with a Gaussian core, 2 % with five times its noise give 1.21, with ten times 1.83; eight sets of pictures of
#: boards have 1.05 to 1.49 and one of AprilTags 4.2. Above the bound a robust estimate is also made.
LOOKS_GAUSSIAN, SCATTER = 1.15, 4.0


@dataclass(frozen=True)
class Verdict:
    """The result of the test.

    Attributes
    ----------
    used : (N,) bool array
    sigma : float
        Robust scale of one coordinate: px, or in units of the given sigmas.
    threshold : float
        Largest |r| / s of a point that is kept, over all points.
    bad_views : tuple of int
        Views to be rejected as a whole.
    lengths : (N,) array
        Of the residuals, `standardised`.
    """

    used: Array
    sigma: float
    threshold: float
    bad_views: tuple[int, ...]
    lengths: Array

    @property
    def rejected(self) -> int:
        """Number of rejected points."""
        return int((~self.used).sum())


def test(calibration: Estimate) -> Verdict:
    """Test the residuals of all rows of a fit, including those that it did not use."""
    data, parameters = calibration.observations, calibration.free_count
    lengths = standardised(calibration)
    every = data.split(lengths)
    n = len(lengths)
    sigma = max(robust_sigma(lengths, parameters), _floor(data))
    own = np.array([robust_sigma(length, parameters * len(length) // n) for length in every])
    threshold = cut(n, parameters)
    usual = max(median(own), sigma)
    bad, masks = set(), []
    for i, length in enumerate(every):
        scale = _scale_of_view(length, own[i], FAR * usual, threshold, parameters / n)
        mask = length <= threshold * min(max(sigma, scale), FAR * usual)
        if mask.mean() < LEAST_KEPT or (scale > FAR * usual and len(every) > 2):
            bad.add(i)
        masks.append(mask)
    if 0 < len(every) - len(bad) < LEAST_LEFT:
        for i in bad:
            masks[i] = every[i] <= threshold * max(sigma, own[i])
        bad = set()
    bad |= _undetermined(data.views, masks)
    for i in bad:
        masks[i] = np.zeros(len(every[i]), bool)
    if len(bad) == len(every):
        bad, masks = set(), [length <= threshold * sigma for length in every]
    return Verdict(np.concatenate(masks), sigma, threshold, tuple(sorted(bad)), lengths)


def _scale_of_view(lengths: Array, scale: float, most: float, threshold: float, share: float) -> float:
    """The scale of a view's points without its own outliers; in a bad view these are more than half of them.

    `share` is the number of parameters per point.
    """
    for _ in range(_ROUNDS):
        kept = lengths[lengths <= threshold * min(scale, most)]
        if len(kept) < 2:
            break
        fresh = robust_sigma(kept, int(share * len(kept)))
        if not fresh < scale * (1 - _SETTLED):
            break
        scale = fresh
    return scale


def _undetermined(views: Sequence[View], masks: Sequence[Array]) -> set[int]:
    """The views that lost points and whose remaining points suffice for no closed form."""
    touched = [i for i, m in enumerate(masks) if not m.all()]
    if not touched:
        return set()
    rest = Observations.from_views([views[i].take(masks[i]) for i in touched])
    return {touched[i] for i in shape.unusable(rest)}


def cut(points: int, parameters: int) -> float:
    """The largest |r| / s that passes the test, for the given numbers of points and parameters."""
    freedom = max(_MEDIAN_EFFICIENCY * (2 * points - parameters), 2.0)
    return float(np.sqrt(2 * f_bound(ALPHA / points, 2, freedom)))


def looks_gaussian(lengths: Array, sigma: float) -> bool:
    """Return whether the rms and the median of residuals of these lengths (N,) give the same σ, within the
    bounds of `LOOKS_GAUSSIAN`.

    This reveals contamination that masks its own points by increasing the median.
    """
    if not np.isfinite(lengths).all():
        return False
    ratio = np.sqrt(np.square(lengths).mean() / 2) / max(sigma, np.finfo(float).tiny)
    return bool(ratio < LOOKS_GAUSSIAN + SCATTER / np.sqrt(len(lengths)))


def is_clean(calibration: Estimate) -> bool:
    """Return whether the residuals show no outlier and are Gaussian as far as their median and rms show."""
    verdict = test(calibration)
    return not verdict.rejected and looks_gaussian(verdict.lengths, verdict.sigma)


def standardised(calibration: Estimate) -> Array:
    """Lengths (N,) of the residuals in units of the stated sigmas, as far as these are known."""
    data = calibration.observations
    lengths = data.standardised(calibration.residuals)
    return lengths if data.sigma is not None else lengths / data.allowance()


def _floor(data: Observations) -> float:
    unit = 1.0 if data.sigma is None else median(data.sigma[~np.isnan(data.sigma)])
    return _ROUNDING * float(np.abs(data.uv).max()) / unit
