"""Which points and views do not belong: a stated test on the residuals.

With s the robust scale (median) and ν its degrees of freedom, |r|² / 2 s² of a good point follows F(2, ν).
A point is rejected where that is exceeded with probability below ALPHA / N (Bonferroni): on Gaussian noise,
one run in a thousand rejects anything at all. s is the larger of that of all points and that of the point's
view (after the view's own outliers), so that a picture blurred more than the others is not taken apart; a
view whose s exceeds FAR times that of the median view, that loses more than two thirds of its points, or
whose rest does not fix a pose, is rejected as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from camcal.data.observations import Correspondences, View
from camcal.model.pose import Array
from camcal.solve.losses import robust_sigma
from camcal.start import shape

ALPHA = 0.001
#: the median has this efficiency against the root mean square, Gaussian noise in two coordinates
_MEDIAN_EFFICIENCY = 0.48
FAR = 5.0
#: views are not rejected as a whole where fewer than this many would be left: two or three that agree by chance
#: of too many parameters are no majority
LEAST_LEFT = 5
#: a view that keeps less than this part of its points is not the picture it is taken for
LEAST_KEPT = 1 / 3
#: residuals below this part of the coordinates are the rounding of the input, not outliers
_ROUNDING = 1e-7


@dataclass(frozen=True)
class Verdict:
    """What the test says.

    Attributes
    ----------
    inliers : V arrays (N,) of bool
    sigma : float
        Robust scale of one coordinate: px, or of the given sigmas where there are some.
    threshold : float
        Largest |r| / s of a point that is kept, over all points.
    bad_views : tuple of int
        Views to be rejected as a whole.
    """

    inliers: tuple[Array, ...]
    sigma: float
    threshold: float
    bad_views: tuple[int, ...]

    @property
    def rejected(self) -> int:
        """Number of points that are not kept."""
        return sum(int((~m).sum()) for m in self.inliers)


def standardised(view: View, residual: Array) -> Array:
    """Lengths (N,) of residuals in units of the view's sigmas, or px; inf where a point does not project."""
    lengths = np.linalg.norm(residual, axis=1)
    lengths = np.where(np.isfinite(lengths), lengths, np.inf)
    return lengths if view.sigma is None else lengths / view.sigma


def judge(correspondences: Correspondences, residuals: Sequence[Array], parameters: int) -> Verdict:
    """Test the residuals (N, 2) of each view, px, after a fit of so many parameters."""
    views = correspondences.views
    lengths = [standardised(v, r) for v, r in zip(views, residuals, strict=True)]
    every = np.concatenate(lengths)
    n = len(every)
    floor = _floor(views)
    sigma = max(robust_sigma(every, parameters), floor)
    own = np.array([robust_sigma(length, parameters * len(length) // n) for length in lengths])
    threshold = cut(n, parameters)
    usual = max(float(np.median(own)), sigma)
    bad, masks = set(), []
    for i, length in enumerate(lengths):
        scale = _scale_of_view(length, own[i], FAR * usual, threshold, parameters / n)
        mask = length <= threshold * min(max(sigma, scale), FAR * usual)
        if mask.mean() < LEAST_KEPT or (scale > FAR * usual and len(views) > 2):
            bad.add(i)
        masks.append(mask)
    if 0 < len(views) - len(bad) < LEAST_LEFT:
        for i in bad:
            masks[i] = lengths[i] <= threshold * max(sigma, own[i])
        bad = set()
    bad |= _left_open(views, masks)
    for i in bad:
        masks[i] = np.zeros(len(views[i]), bool)
    if len(bad) == len(views):
        bad, masks = set(), [length <= threshold * sigma for length in lengths]
    return Verdict(tuple(masks), sigma, threshold, tuple(sorted(bad)))


def _scale_of_view(lengths: Array, scale: float, most: float, threshold: float, share: float) -> float:
    """The scale of a view's points after its own outliers, which are more than half of them where it is bad.

    `share` is the number of parameters that a point pays for.
    """
    for _ in range(10):
        kept = lengths[lengths <= threshold * min(scale, most)]
        if len(kept) < 2:
            break
        fresh = robust_sigma(kept, int(share * len(kept)))
        if not fresh < scale * (1 - 1e-9):
            break
        scale = fresh
    return scale


def _left_open(views: Sequence[View], masks: Sequence[Array]) -> set[int]:
    """The views that lost points and whose other points no closed form can take."""
    touched = [i for i, m in enumerate(masks) if not m.all()]
    if not touched:
        return set()
    rest = Correspondences(tuple(views[i].take(masks[i]) for i in touched))
    return {touched[i] for i in shape.unusable(rest)}


def cut(points: int, parameters: int) -> float:
    """The largest |r| / s that the test lets pass, for so many points and parameters."""
    freedom = max(_MEDIAN_EFFICIENCY * (2 * points - parameters), 2.0)
    return float(np.sqrt(2 * f_distribution.isf(ALPHA / points, 2, freedom)))


def looks_gaussian(residuals: Array, sigma: float) -> bool:
    """Whether root mean square and median of residuals (N, 2) tell of the same σ, within 4 deviations.

    Contamination that hides its own points by widening the median shows here.
    """
    squares = np.einsum("ij,ij->i", residuals, residuals)
    if not np.isfinite(squares).all():
        return False
    ratio = np.sqrt(squares.mean() / 2) / max(sigma, np.finfo(float).tiny)
    return bool(ratio < 1.15 + 4 / np.sqrt(len(residuals)))


def _floor(views: Sequence[View]) -> float:
    scale = max(float(np.abs(v.uv).max()) for v in views)
    sigmas = [float(np.median(v.sigma)) for v in views if v.sigma is not None]
    return _ROUNDING * scale / (np.median(sigmas) if sigmas else 1.0)
