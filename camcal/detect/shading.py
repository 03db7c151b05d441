"""Shading: the variation of the board's white and black over a picture, from the fits of its corners.

A slope of the shading across a corner's window pulls the corner towards the brighter side: 10 % over a
picture of 640 px and a blur of 1.2 px make about 0.003 px. One corner does not separate such a slope from a
shift; all of them together can.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import Fits
from camcal.detect.ranks import lower_quartile, median
from camcal.detect.windows import Windows

Array = np.ndarray

#: times the lower quartile of a picture's corners; larger residuals show what the model does not hold. In photographs
#: nine corners of ten have 1.2 to 1.5
UNUSUAL = 1.5
SIGNIFICANT = 5.0  #: sigmas by which a slope of the shading must move a corner to count; JPEG blocks make 4
LEAST_CORNERS = (
    12  #: for a quadratic surface, two a coefficient; fewer carry a plane, fewer than half of it nothing
)
RIDGE = 1e-9  #: of the diagonal; keeps the equations solvable where the corners are collinear
ROUNDS = 3  #: of least squares and new weights; the weights of a glare settle in two
#: of a corner's own range from black to white, which is a divisor: shading reduces it no further; .01 to .8 find the
#: same corners
LEAST_RANGE = 0.2
INSIDE = (
    1e-3  #: grey levels; how far a value is kept from the limits, at which the picture would count as cut off
)
HUBER = 2.0  #: median deviations (1.35 sigma, Huber 1964) from which on a corner counts less


def unusual(noise: Array) -> Array:
    """The corners (K,) whose residuals are larger than the model of a corner usually leaves."""
    return noise > UNUSUAL * lower_quartile(noise)


def slopes(uv: Array, offset: Array, contrast: Array, sound: Array) -> Array:
    """Slopes (K, 2, 2) of the white (0) and of the black (1) at each corner, grey levels per px.

    Parameters
    ----------
    uv : (K, 2) array
        px.
    offset, contrast : (K,) arrays
        a and |b| of the corners' fits.
    sound : (K,) bool array
        Corners from which the shading is taken; others may be beside a glare.
    """
    count = int(sound.sum())
    if count < LEAST_CORNERS // 2:
        return np.zeros((len(uv), 2, 2))
    scale = max(float(np.ptp(uv, axis=0).max()), 1e-9)
    x, y = ((uv - uv.mean(0)) / scale).T
    one, zero = np.ones(len(uv)), np.zeros(len(uv))
    design, by_x, by_y = [one, x, y], [zero, one, zero], [zero, zero, one]
    if count >= LEAST_CORNERS:
        design += [x * x, x * y, y * y]
        by_x += [2 * x, y, zero]
        by_y += [zero, x, 2 * y]
    levels = np.stack([offset + contrast, offset - contrast], -1)
    surface = _robust_fits(np.stack(design, -1)[sound], levels[sound])
    return np.stack([np.stack(d, -1) @ surface / scale for d in (by_x, by_y)], -1)


def _robust_fits(design: Array, values: Array) -> Array:
    """Least squares (P, L) of the columns of values (N, L) with Huber's weights; the scale is the median deviation."""
    weights, diagonal = np.ones(values.T.shape), np.arange(design.shape[1])
    for _ in range(ROUNDS):
        weighted = design.T * weights[:, None]
        normal = weighted @ design
        normal[:, diagonal, diagonal] *= 1 + RIDGE
        solution = np.linalg.solve(normal, weighted @ values.T[..., None])[..., 0]
        residual = np.abs(values.T - solution @ design.T)
        limit = HUBER * np.maximum([median(r) for r in residual], 1e-9)
        weights = np.minimum(1, limit[:, None] / np.maximum(residual, 1e-12))
    return np.asarray(solution.T)


def evened(
    windows: Windows, slope: Array, offset: Array, contrast: Array, limits: tuple[float, float]
) -> Windows:
    """The windows corrected to the shading of their corners everywhere.

    Parameters
    ----------
    slope : (K, 2, 2) array
        As `slopes` gives them.
    offset, contrast : (K,) arrays
    limits : (low, high)
        Values at which the picture is cut off; they stay what they are.
    """
    position = np.where(windows.counts[:, None], windows.q, 0)
    white, black = (np.einsum("kc,kcp->kp", slope[:, i], position) for i in (0, 1))
    dark = (offset - contrast)[:, None]
    range_ = 2 * contrast[:, None]
    share = (windows.value - dark - black) / np.maximum(range_ + white - black, LEAST_RANGE * range_)
    low, high = limits
    cut_off = (windows.value <= low) | (windows.value >= high)
    value = np.clip(dark + share * range_, low + INSIDE, high - INSIDE)
    value = np.where(cut_off, windows.value, value).astype(np.float32)
    return Windows(windows.origin, windows.q, value, windows.counts, windows.inside)


def with_slopes(windows: Windows, fits: Fits, limits: tuple[float, float]) -> Fits:
    """Fits whose covariance includes the effect of a shading slope within a window, for example beside a glare.

    Only corners with unusual residuals are looked at. The slope g that these show is that of least squares over the
    fit's own parameters and two more: with residuals r, derivatives J, the pixels' coordinates G and X = (J Jᵀ)⁻¹ J Gᵀ

        (G Gᵀ - G Jᵀ X) g = -G r,    the corner moves by the first two rows of -X g

    Parameters
    ----------
    windows : Windows
    fits : Fits
        Of the windows.
    limits : (low, high)
        Grey values at which the picture is cut off.
    """
    rows = np.flatnonzero(unusual(fits.noise))
    if not len(rows):
        return fits
    some = windows.take(rows)
    found = model.residuals(some.q, some.value, some.counts, fits.params[rows], limits)
    residual, jacobian = (a.astype(float) for a in found)
    place = np.where(jacobian[:, [model.OFFSET]] != 0, some.q, 0).astype(float)
    both, right = jacobian @ place.transpose(0, 2, 1), place @ residual[..., None]
    reaction = np.linalg.pinv(jacobian @ jacobian.transpose(0, 2, 1), hermitian=True) @ both
    own = place @ place.transpose(0, 2, 1) - both.transpose(0, 2, 1) @ reaction
    move = (reaction @ (np.linalg.pinv(own, hermitian=True) @ right))[:, :2, 0]
    variance = 0.5 * np.trace(fits.covariance[rows], axis1=1, axis2=2)
    clear = (move**2).sum(1) > SIGNIFICANT**2 * variance
    covariance = fits.covariance.copy()
    covariance[rows[clear]] += move[clear, :, None] * move[clear, None, :]
    return replace(fits, covariance=covariance)
