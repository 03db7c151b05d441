"""Levenberg–Marquardt for many small problems of the same shape at once: the corners of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.windows import Windows

Array = np.ndarray

ITERATIONS = 25
CACHED = 16_000  #: pixels that are worked on at a time: their arrays fit into a cache of half a megabyte
SETTLED = 2e-3  #: px; a corner that moves less is done
STILL = 0.01  #: px; one that moves less when the iterations run out counts as converged all the same
LEAST_BLUR = 0.28  #: px; a pixel averages over its own area, which alone blurs by 1/sqrt(12)
MOST_BLUR = 30.0  #: px


@dataclass(frozen=True)
class Fits:
    """The fitted corners.

    Attributes
    ----------
    params : (K, 7) array
        In the order of `edge_model`; the corner is relative to the window's origin.
    covariance : (K, 2, 2) array
        Of the corner, px², from the scatter of the residuals.
    noise : (K,) array
        Standard deviation of the residuals, grey levels.
    converged : (K,) bool array
    """

    params: Array
    covariance: Array
    noise: Array
    converged: Array


def fit(windows: Windows, start: Array, limits: tuple[float, float], settled: float = SETTLED) -> Fits:
    """Fit the picture of a corner to each window.

    Parameters
    ----------
    windows : Windows
    start : (K, 7) array
        Parameters to start from.
    limits : (low, high)
        Grey values at which the picture is cut off: a pixel there says only that the value is at least so
        extreme.
    settled : float
        px; a corner that moves less is done.
    """
    count = len(windows.q)
    params = start.copy()
    cost, normal, gradient = _normal_equations(windows, params, limits)
    damping = np.full(count, 1e-3)
    active = np.arange(count)
    moved = np.full(count, np.inf)
    for _ in range(ITERATIONS):
        if not len(active):
            break
        step = _damped_step(*_held(normal[active], gradient[active], params[active]), damping[active])
        trial = params[active] + step
        trial[:, model.BLUR] = np.clip(trial[:, model.BLUR], LEAST_BLUR, MOST_BLUR)
        some = windows if len(active) == count else windows.take(active)
        new = _normal_equations(some, trial, limits)
        better = new[0] <= cost[active]
        moved[active] = np.abs(step[:, :2]).max(1)
        took = active[better]
        params[took] = trial[better]
        cost[took], normal[took], gradient[took] = (a[better] for a in new)
        damping[active] = np.where(better, np.maximum(0.15 * damping[active], 1e-9), 10 * damping[active])
        active = active[(moved[active] >= settled) & (damping[active] < 1e8)]
    freedom = np.maximum(windows.counts.sum(1) - model.COUNT, 1)
    noise = np.sqrt(cost / freedom)
    covariance = np.linalg.pinv(normal, hermitian=True)[:, :2, :2] * (noise**2)[:, None, None]
    return Fits(params, covariance, noise, moved < max(STILL, settled))


def first_guess(windows: Windows, angles: Array, blur: Array) -> Array:
    """Parameters (K, 7) to start from: offset and contrast by least squares, the corner at the origin.

    Parameters
    ----------
    angles : (K, 2) array
        Directions of the edges' normals, radians.
    blur : (K,) array
        px.
    """
    params = np.zeros((len(angles), model.COUNT))
    params[:, model.ANGLE1], params[:, model.ANGLE2] = angles.T
    params[:, model.BLUR] = blur
    params[:, model.CONTRAST] = 1
    shape = model.evaluate(windows.q, params)[1][:, model.CONTRAST] * windows.counts
    number = np.maximum(windows.counts.sum(1), 1)
    mean_shape, mean_value = shape.sum(1) / number, windows.value.sum(1) / number
    cross = (shape * windows.value).sum(1) / number - mean_shape * mean_value
    contrast = cross / np.maximum((shape**2).sum(1) / number - mean_shape**2, 1e-6)
    params[:, model.CONTRAST] = contrast
    params[:, model.OFFSET] = mean_value - contrast * mean_shape
    return params


def _normal_equations(
    windows: Windows, params: Array, limits: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Sum of squares (K,), JᵀJ (K, 7, 7) and Jᵀr (K, 7); r = model - value.

    A few windows at a time, so that the arrays stay in the processor's cache.
    """
    count, size = windows.value.shape
    cost, normal = np.empty(count), np.empty((count, model.COUNT, model.COUNT))
    gradient = np.empty((count, model.COUNT))
    for start in range(0, count, max(1, CACHED // max(size, 1))):
        rows = slice(start, start + max(1, CACHED // max(size, 1)))
        observed, counts = windows.value[rows], windows.counts[rows]
        value, jacobian = model.evaluate(windows.q[rows], params[rows])
        residual = value - observed
        if observed.max(initial=limits[0]) >= limits[1] or observed.min(initial=limits[1]) <= limits[0]:
            low, high = limits
            counts = counts & ~((observed >= high) & (residual > 0)) & ~((observed <= low) & (residual < 0))
            jacobian *= counts[:, None]
        else:  # pixels that do not count are far from the edges, where the other derivatives are 0
            jacobian[:, model.OFFSET] *= counts
            jacobian[:, model.CONTRAST] *= counts
        residual *= counts
        normal[rows] = np.matmul(jacobian, jacobian.transpose(0, 2, 1))
        gradient[rows] = np.matmul(jacobian, residual[..., None])[..., 0]
        cost[rows] = np.matmul(residual[:, None], residual[..., None])[:, 0, 0]
    return cost, normal, gradient


def _held(normal: Array, gradient: Array, params: Array) -> tuple[Array, Array]:
    """Leave the blur out of the equations of those corners where it would fall below its least value."""
    held = (params[:, model.BLUR] <= LEAST_BLUR) & (gradient[:, model.BLUR] > 0)
    if held.any():
        normal[held, model.BLUR] = 0
        normal[held, :, model.BLUR] = 0
        gradient[held, model.BLUR] = 0
    return normal, gradient


def _damped_step(normal: Array, gradient: Array, damping: Array) -> Array:
    """Solve (JᵀJ + damping diag) step = -Jᵀr for each corner, scaled to a unit diagonal."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
    scaled = normal * scale[:, :, None] * scale[:, None, :]
    diagonal = np.arange(model.COUNT)
    scaled[:, diagonal, diagonal] = 1 + damping[:, None] + 1e-9
    return -np.linalg.solve(scaled, (gradient * scale)[..., None])[..., 0] * scale
