"""Sub-pixel location of discs by fitting the grey values around each outline, all discs of a picture in one batch.

A model of the blurred edge is fitted instead of applying a threshold, so that a gradient of the shading moves the
centre only slightly; unlike a centroid, the result does not depend on the extent of a window.
"""

from __future__ import annotations

import numpy as np

from camcal.detect.disc_model import (
    BLUR,
    COUNT,
    L11,
    L12,
    L22,
    OFFSET,
    STEP,
    Band,
    distance,
    matrix_of,
    residuals,
)
from camcal.detect.discs import Discs
from camcal.detect.fit import ROUNDING, SETTLED
from camcal.detect.pyramid import white_level
from camcal.geometry.numbers import median
from camcal.least_squares import Normal, Options, Small, minimise, negligible
from camcal.records import dataclass

Array = np.ndarray

ITERATIONS = 20  #: usual fits take 4 to 8
BAND = 3.0  #: blurs used on each side of the outline: 0.1 % of the edge lies outside
START_ERROR = 1.0  #: px; by which the band is widened, as the outlines may be off by as much
MOST_PIXELS = 2500  #: of one disc; of a larger band every n-th pixel is used: the centre is known to .005 px
DARK, BRIGHT = 15, 85  #: percentiles of a band's pixels; the fit starts from the levels beyond them
LEAST_BLUR, MOST_BLUR = 0.2, 10.0  #: px; less than a pixel's own area, and more than any band holds
LEAST_INSIDE = 0.9  #: share of the band that must lie in the picture; both sides determine a centre
LEAST_CONTRAST = 2.0  #: grey levels of 255; as for corners: rounding to whole levels leaves 15 % of it
#: residual as a share of the contrast: noise of 10 grey levels on a step of 40. In a picture in which most discs have
#: more, `RARE` times the median of the picture
MOST_MISFIT, RARE = 0.25, 3.0
SOFT = 0.5  #: of the radius; a more blurred disc has no uniform middle
MOST_CHANGE = 0.5  #: of the area by which a second fit may differ from the first
MOST_SHIFT = 0.3  #: of the radius, plus half a px, by which its centre may differ


@dataclass(frozen=True)
class FittedDiscs:
    """Fitted discs.

    Attributes
    ----------
    discs : Discs
    covariance : (K, 2, 2) array
        Of the centre, px², from the scatter of the residuals.
    blur, contrast, noise : (K,) arrays
        px, grey levels, grey levels.
    reasons : tuple of str
        Empty for a good disc, otherwise why it is rejected.
    """

    discs: Discs
    covariance: Array
    blur: Array
    contrast: Array
    noise: Array
    reasons: tuple[str, ...]

    @property
    def good(self) -> Array:
        """Mask (K,) of the discs that were not rejected."""
        return np.array([not r for r in self.reasons], bool)


def fit_discs(gray: Array, discs: Discs, blur: float = 1.0, scale: float = 255.0) -> FittedDiscs:
    """Fit the discs of a picture.

    Parameters
    ----------
    gray : (height, width) array
    discs : Discs
        Approximate, to one or two px or a tenth of the radius.
    blur : float
        Blur to start from, px: at least the error of the outlines.
    scale : float
        Grey levels from black to white, to which the contrast is compared.
    """
    band = _cut(gray, discs, BAND * blur + START_ERROR)
    params = _start(band, discs, blur)
    params = _minimise(band, params)
    # the blur is known now: a band of the right width, so that neither the neighbours nor the middle matter
    settled = Discs(discs.centre + params[:, :2], np.linalg.inv(matrix_of(params)))
    # where the centre moved by half a radius or more, the start is kept
    usable = np.isfinite(settled.shape).all((1, 2)) & (np.abs(params[:, :2]).max(1) < 0.5 * _radius(discs))
    shape = np.where(usable[:, None, None], settled.shape, discs.shape)
    settled = Discs(np.where(usable[:, None], settled.centre, discs.centre), shape)
    typical = median(params[:, BLUR])
    band = _cut(gray, settled, BAND * typical + START_ERROR)
    params = _minimise(band, _start(band, settled, typical))
    return _judged(band, settled, params, scale)


def _radius(discs: Discs) -> Array:
    """Smaller half-axis of each disc, px."""
    return np.abs(np.linalg.eigvalsh(discs.shape)).min(1)


def _cut(gray: Array, discs: Discs, width: float) -> Band:
    """Cut out the pixels within `width` px of each outline."""
    height, columns = gray.shape
    reach = np.ceil(np.linalg.norm(discs.shape, axis=2) + width).astype(int)  # half the bounding box
    reach = np.minimum(reach, max(gray.shape))
    inverse = np.linalg.inv(discs.shape)
    rows = []
    for centre, far, matrix in zip(discs.centre, reach, inverse, strict=True):
        base = np.rint(centre).astype(int)
        dx, dy = np.meshgrid(np.arange(-far[0], far[0] + 1), np.arange(-far[1], far[1] + 1))
        px, py = (dx + base[0]).ravel(), (dy + base[1]).ravel()
        x, y = px - centre[0], py - centre[1]
        near = np.abs(distance(matrix, x, y)[0]) < width
        within = (px >= 0) & (px < columns) & (py >= 0) & (py < height)
        keep = np.flatnonzero(near & within)
        keep = keep[:: max(1, int(np.ceil(len(keep) / MOST_PIXELS)))]
        share = (near & within).sum() / max(near.sum(), 1)
        rows.append((x[keep], y[keep], gray[py[keep], px[keep]].astype(float), share))
    longest = max((len(r[0]) for r in rows), default=1)
    x, y, value = (np.zeros((len(rows), longest)) for _ in range(3))
    counts = np.zeros((len(rows), longest), bool)
    for k, (xs, ys, values, _) in enumerate(rows):
        x[k, : len(xs)], y[k, : len(xs)], value[k, : len(xs)], counts[k, : len(xs)] = xs, ys, values, True
    return Band(x, y, value, counts, np.array([r[3] for r in rows]), white_level(gray))


def _start(band: Band, discs: Discs, blur: float) -> Array:
    """Initial offset and step from the dark and the bright pixels of each band."""
    params = np.zeros((len(discs), COUNT))
    inverse = np.linalg.inv(discs.shape)
    params[:, L11], params[:, L12], params[:, L22] = inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]
    value = np.where(band.counts, band.value, np.nan)
    with np.errstate(all="ignore"):
        low, high = np.nanpercentile(value, (DARK, BRIGHT), axis=1) if value.size else (0.0, 0.0)
    params[:, OFFSET], params[:, STEP] = np.nan_to_num(low), np.nan_to_num(high - low)
    params[:, BLUR] = blur
    return params


def _minimise(band: Band, params: Array) -> Array:
    """The least-squares parameters of each disc."""
    options = Options(negligible(SETTLED, band.counts.sum(1), COUNT), ITERATIONS)
    with np.errstate(over="ignore", invalid="ignore"):  # steps to infinite values are rejected
        return np.asarray(minimise(_DiscFits(band), params, options).state)


class _DiscFits(Small):
    """The discs of a picture as one batch."""

    def __init__(self, band: Band):
        self.band, self.count = band, len(band.x)
        self.left = np.arange(self.count), band

    def linearise(self, state: Array, members: Array) -> Normal:
        """Residuals in grey levels."""
        if len(members) != len(self.left[0]):
            self.left = members, self.band.take(members)
        residual, jacobian = residuals(self.left[1], state)
        return Normal.of(residual, jacobian)

    def retract(self, state: Array, step: Array) -> Array:
        """Clip the blur to its limits."""
        moved = state + step
        moved[:, BLUR] = np.clip(moved[:, BLUR], LEAST_BLUR, MOST_BLUR)
        return moved


def _judged(band: Band, discs: Discs, params: Array, scale: float) -> FittedDiscs:
    pixels = band.counts.sum(1)
    with np.errstate(all="ignore"):  # squares of a diverged fit may overflow
        normal = Normal.of(*residuals(band, params))
    lost = ~(np.isfinite(normal.matrix).all((1, 2)) & np.isfinite(normal.cost))
    cost = np.where(lost, np.inf, normal.cost)
    noise = np.sqrt(np.maximum(2 * cost / np.maximum(pixels - COUNT, 1), ROUNDING**2))
    matrix = np.where(lost[:, None, None], np.eye(COUNT), normal.matrix)
    variance = np.where(lost, 1.0, noise) ** 2
    covariance = np.linalg.pinv(matrix, hermitian=True)[:, :2, :2] * variance[:, None, None]
    covariance[lost] = np.inf
    contrast, radius = params[:, STEP], _radius(discs)
    with np.errstate(all="ignore"):
        shape = np.linalg.inv(matrix_of(params))
        change = np.abs(np.linalg.det(shape) / np.linalg.det(discs.shape) - 1)
    shift = np.abs(params[:, :2]).max(1)
    usual = median(noise / np.maximum(contrast, 1e-9))
    tests = {  # the first that fails is the reason
        "at the border of the picture": band.inside < LEAST_INSIDE,
        "too little contrast": ~(contrast > LEAST_CONTRAST * scale / 255),
        "blurred away": params[:, BLUR] > SOFT * radius,
        "does not look like a disc": lost
        | (noise > max(MOST_MISFIT, RARE * usual) * contrast)
        | ~(change < MOST_CHANGE),
        "uncertain": ~(shift < MOST_SHIFT * radius + 0.5),
    }
    reasons = np.select(list(tests.values()), list(tests), "")
    fitted = Discs(discs.centre + params[:, :2], shape)
    return FittedDiscs(fitted, covariance, params[:, BLUR], contrast, noise, tuple(map(str, reasons)))
