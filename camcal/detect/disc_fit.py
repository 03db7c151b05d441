"""Sub-pixel discs by fitting the grey values around each outline, all discs of a picture in one batch.

    I(d) = (a + b Φ(s(d) / σ)) (1 + g·d),    s = (|L d| - 1) / |∇|L d||,    d = pixel - centre

a is the black, b the step to the white, g the slope of the shading, in proportion to both, Φ the
normal distribution function, s the signed distance from the ellipse |L d| = 1 (to first order) and σ the
blur. Ten parameters: centre (2), L symmetric (3), a, g (2), b, σ. The blurred edge counts, not a threshold
on it, so that a slope of the shading hardly moves the centre; and unlike a centroid nothing depends on where
a window ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from camcal.detect.aliasing import white_level
from camcal.detect.discs import Discs
from camcal.least_squares import Normal, Options, Small, minimise, negligible

Array = np.ndarray

CX, CY, L11, L12, L22, OFFSET, GX, GY, STEP, BLUR = range(10)
COUNT = 10
ITERATIONS = 20  #: usual fits take 4 to 8
SETTLED = 0.1  #: standard deviations of its parameters within which a fit stops; see `fit.SETTLED`
BAND = 3.0  #: blurs to each side of the outline that take part
MOST_PIXELS = 2500  #: of one disc; of a larger band every n-th pixel is taken
LEAST_BLUR, MOST_BLUR = 0.2, 10.0  #: px
LEAST_INSIDE = 0.9  #: share of the band that must lie in the picture
LEAST_CONTRAST = 8.0  #: grey levels of 255
MOST_MISFIT = 0.25  #: residual as a share of the contrast


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


@dataclass(frozen=True)
class _Band:
    """Pixels around K outlines, padded to P: offsets (K, P) from the centres, values, which count.

    `white` is the grey value at which the picture is cut off: a pixel there is at least as bright.
    """

    x: Array
    y: Array
    value: Array
    counts: Array
    inside: Array
    white: float

    def take(self, rows: Array) -> _Band:
        x, y, value, counts, inside = (
            a[rows] for a in (self.x, self.y, self.value, self.counts, self.inside)
        )
        return _Band(x, y, value, counts, inside, self.white)


def fit_discs(gray: Array, discs: Discs, blur: float = 1.0, scale: float = 255.0) -> FittedDiscs:
    """Fit the discs of a picture.

    Parameters
    ----------
    gray : (height, width) array
    discs : Discs
        Approximate, to a px or two or a tenth of the radius.
    blur : float
        Blur to start from, px: at least the error of the outlines.
    scale : float
        Grey value of white.
    """
    band = _cut(gray, discs, BAND * blur + 1.0)
    params = _start(band, discs, blur)
    params = _minimise(band, params)
    # the blur is known now: a band of the right width, so that neither the neighbours nor the middle matter
    settled = Discs(discs.centre + params[:, :2], np.linalg.inv(_matrix(params)))
    usable = np.isfinite(settled.shape).all((1, 2)) & (np.abs(params[:, :2]).max(1) < 0.5 * _radius(discs))
    shape = np.where(usable[:, None, None], settled.shape, discs.shape)
    settled = Discs(np.where(usable[:, None], settled.centre, discs.centre), shape)
    typical = float(np.median(params[:, BLUR]))
    band = _cut(gray, settled, BAND * typical + 1.0)
    params = _minimise(band, _start(band, settled, typical))
    return _judged(band, settled, params, scale)


def _radius(discs: Discs) -> Array:
    """Smaller half-axis of each disc, px."""
    return np.abs(np.linalg.eigvalsh(discs.shape)).min(1)


def _cut(gray: Array, discs: Discs, width: float) -> _Band:
    """Pixels within `width` px of each outline."""
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
        near = np.abs(_distance(matrix, x, y)[0]) < width
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
    return _Band(x, y, value, counts, np.array([r[3] for r in rows]), white_level(gray))


def _distance(matrix: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Signed distance from |L d| = 1 (first order), L d, and |∇|L d||."""
    wx = matrix[..., 0, 0] * x + matrix[..., 0, 1] * y
    wy = matrix[..., 1, 0] * x + matrix[..., 1, 1] * y
    rho = np.sqrt(wx * wx + wy * wy) + 1e-12
    slope = np.hypot(
        matrix[..., 0, 0] * wx + matrix[..., 1, 0] * wy, matrix[..., 0, 1] * wx + matrix[..., 1, 1] * wy
    )
    slope = slope / rho + 1e-12
    return (rho - 1) / slope, wx / rho, wy / rho, slope


def _matrix(params: Array) -> Array:
    return params[:, [L11, L12, L12, L22]].reshape(-1, 2, 2)


def _start(band: _Band, discs: Discs, blur: float) -> Array:
    """Offset and step from the dark and the bright pixels of each band."""
    params = np.zeros((len(discs), COUNT))
    inverse = np.linalg.inv(discs.shape)
    params[:, L11], params[:, L12], params[:, L22] = inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]
    value = np.where(band.counts, band.value, np.nan)
    with np.errstate(all="ignore"):
        low, high = np.nanpercentile(value, (15, 85), axis=1) if value.size else (0.0, 0.0)
    params[:, OFFSET], params[:, STEP] = np.nan_to_num(low), np.nan_to_num(high - low)
    params[:, BLUR] = blur
    return params


def _evaluate(band: _Band, params: Array) -> tuple[Array, Array]:
    """Residuals (K, P), model - value, and their derivatives (K, 10, P)."""
    p = params[:, :, None]
    x, y = band.x - p[:, CX], band.y - p[:, CY]
    s, nx, ny, slope = _distance(_matrix(params)[:, None], x, y)
    z = s / p[:, BLUR]
    edge = 0.5 * (1 + erf(z / np.sqrt(2)))
    bell = p[:, STEP] * np.exp(-0.5 * z * z) / (np.sqrt(2 * np.pi) * p[:, BLUR])
    along = bell / slope  # d I / d |L d|; the change of the slope itself vanishes on the outline
    jacobian = np.empty((len(params), COUNT, band.x.shape[1]))
    grey, shading = p[:, OFFSET] + p[:, STEP] * edge, 1 + p[:, GX] * x + p[:, GY] * y
    along *= shading
    jacobian[:, CX] = -along * (p[:, L11] * nx + p[:, L12] * ny) - grey * p[:, GX]
    jacobian[:, CY] = -along * (p[:, L12] * nx + p[:, L22] * ny) - grey * p[:, GY]
    jacobian[:, L11] = along * nx * x
    jacobian[:, L12] = along * (nx * y + ny * x)
    jacobian[:, L22] = along * ny * y
    jacobian[:, OFFSET] = shading
    jacobian[:, GX], jacobian[:, GY] = grey * x, grey * y
    jacobian[:, STEP] = edge * shading
    jacobian[:, BLUR] = -bell * shading * z
    residual = grey * shading - band.value
    counts = band.counts & ~((band.value >= band.white) & (residual > 0))
    return np.where(counts, residual, 0.0), jacobian * counts[:, None]


def _minimise(band: _Band, params: Array) -> Array:
    """Each disc's parameters of least squares."""
    options = Options(negligible(SETTLED, band.counts.sum(1), COUNT), ITERATIONS)
    return np.asarray(minimise(_DiscFits(band), params, options).state)


class _DiscFits(Small):
    """The discs of a picture as one batch."""

    def __init__(self, band: _Band):
        self.band, self.count = band, len(band.x)
        self.left = np.arange(self.count), band

    def linearise(self, state: Array, members: Array) -> Normal:
        """Residuals in grey levels."""
        if len(members) != len(self.left[0]):
            self.left = members, self.band.take(members)
        residual, jacobian = _evaluate(self.left[1], state)
        return Normal.of(residual, jacobian)

    def retract(self, state: Array, step: Array) -> Array:
        """Keep the blur within its limits."""
        moved = state + step
        moved[:, BLUR] = np.clip(moved[:, BLUR], LEAST_BLUR, MOST_BLUR)
        return moved


def _judged(band: _Band, discs: Discs, params: Array, scale: float) -> FittedDiscs:
    residual, jacobian = _evaluate(band, params)
    pixels = band.counts.sum(1)
    normal = Normal.of(residual, jacobian)
    noise = np.sqrt(2 * normal.cost / np.maximum(pixels - COUNT, 1))
    covariance = np.linalg.pinv(normal.matrix, hermitian=True)[:, :2, :2] * (noise**2)[:, None, None]
    contrast, radius = params[:, STEP], _radius(discs)
    with np.errstate(all="ignore"):
        shape = np.linalg.inv(_matrix(params))
        change = np.abs(np.linalg.det(shape) / np.linalg.det(discs.shape) - 1)
    shift = np.abs(params[:, :2]).max(1)
    usual = float(np.median(noise / np.maximum(contrast, 1e-9))) if len(noise) else 0.0
    tests = {  # the first that fails is the reason
        "at the border of the picture": band.inside < LEAST_INSIDE,
        "too little contrast": ~(contrast > LEAST_CONTRAST * scale / 255),
        "blurred away": params[:, BLUR] > 0.5 * radius,
        "does not look like a disc": (noise > max(MOST_MISFIT, 3 * usual) * contrast) | ~(change < 0.5),
        "uncertain": ~(shift < 0.3 * radius + 0.5),
    }
    reasons = np.full(len(params), "", object)
    for reason, failed in reversed(tests.items()):
        reasons[failed] = reason
    fitted = Discs(discs.centre + params[:, :2], shape)
    return FittedDiscs(fitted, covariance, params[:, BLUR], contrast, noise, tuple(map(str, reasons)))
