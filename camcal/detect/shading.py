"""Shading: the variation of the board's white and black levels over a picture, from the fits of its corners.

A gradient of the shading across a corner's window shifts the corner towards the brighter side: 10 % over a
picture of 640 px shift it by about 0.003 px at a blur of 1.2 px. A single corner cannot distinguish such a gradient
from a shift; all of them together can.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import Fits
from camcal.detect.windows import Windows
from camcal.geometry.numbers import lower_quartile, median

Array = np.ndarray

#: times the lower quartile of a picture's corners; larger residuals indicate errors of the model. In photographs
#: nine of ten corners have 1.2 to 1.5
UNUSUAL = 1.5
SIGNIFICANT = 5.0  #: least shift of a corner by a shading gradient, in sigmas; JPEG blocks cause 4
LEAST_CORNERS = (
    12  #: corners for a quadratic surface, two per coefficient; fewer give a plane, less than half of it none
)
RIDGE = 1e-9  #: of the sum of the weights; keeps the equations solvable where the corners are collinear
ROUNDS = 3  #: of reweighted least squares; the weights near a glare converge in two
#: of a corner's own range from black to white: lower limit of the shading's range, by which values are divided; .01 to
#: .8 find the same corners
LEAST_RANGE = 0.2
INSIDE = 1e-3  #: grey levels; distance kept from the limits, at which the picture would count as clipped
HUBER = 2.0  #: median deviations (1.35 sigma, Huber 1964) above which a corner has less weight


def unusual(noise: Array) -> Array:
    """Mask (K,) of the corners whose residuals are unusually large for the model."""
    return noise > UNUSUAL * lower_quartile(noise)


def slopes(uv: Array, offset: Array, contrast: Array, sound: Array) -> Array:
    """Gradients (K, 2, 2) of the white level (0) and of the black level (1) at each corner, grey levels per px.

    Parameters
    ----------
    uv : (K, 2) array
        px.
    offset, contrast : (K,) arrays
        a and |b| of the corners' fits.
    sound : (K,) bool array
        Corners from which the shading is estimated; others may be near a glare.
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
    """Least squares (P, L) of the columns of values (N, L) with Huber weights; the scale is the median deviation."""
    weights, diagonal = np.ones(values.T.shape), np.arange(design.shape[1])
    for _ in range(ROUNDS):
        weighted = design.T * weights[:, None]
        normal = weighted @ design
        normal[:, diagonal, diagonal] += RIDGE * weights.sum(1, keepdims=True)
        solution = np.linalg.solve(normal, weighted @ values.T[..., None])[..., 0]
        residual = np.abs(values.T - solution @ design.T)
        limit = HUBER * np.maximum([median(r) for r in residual], 1e-9)
        weights = np.minimum(1, limit[:, None] / np.maximum(residual, 1e-12))
    return np.asarray(solution.T)


def evened(
    windows: Windows, slope: Array, offset: Array, contrast: Array, limits: tuple[float, float]
) -> Windows:
    """Correct the windows to the shading at their corners.

    Parameters
    ----------
    slope : (K, 2, 2) array
        From `slopes`.
    offset, contrast : (K,) arrays
    limits : (low, high)
        Values at which the picture is clipped; pixels at these values remain unchanged.
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
    """Fits whose covariance includes the effect of a shading gradient within a window, for example near a glare.

    Only corners with unusual residuals are examined. Their gradient g is found by least squares over the fit's
    parameters and two more: with residuals r, derivatives J, the pixels' coordinates G and X = (J Jᵀ)⁻¹ J Gᵀ

        (G Gᵀ - G Jᵀ X) g = -G r,    and the first two rows of -X g are the shift of the corner

    Parameters
    ----------
    windows : Windows
    fits : Fits
        Of the windows.
    limits : (low, high)
        Grey values at which the picture is clipped.
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
