"""Fits of the grey values around many corners at once, by the least-squares loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.windows import Windows
from camcal.least_squares import Normal, Options, Small, damped_steps, minimise, negligible

Array = np.ndarray

ITERATIONS = 25  #: usual fits take 3 to 8
CACHED = 16_000  #: pixels that are worked on at a time: their arrays fit into a cache of half a megabyte
#: standard deviations of its parameters within which a fit stops: adds half a percent to a corner's error
SETTLED = 0.1
STILL = 0.01  #: px; a corner with less to move when the iterations run out counts as converged all the same
ROUNDING = 0.29  #: grey levels; 1/sqrt(12), which whole numbers leave of a picture without noise
PRODUCTS = 1e-5  #: of a diagonal of 1; the rounding of a sum of some hundred products in float32
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
    """Fit the model of a corner to each window.

    Parameters
    ----------
    windows : Windows
    start : (K, 7) array
        Parameters to start from.
    limits : (low, high)
        Grey values at which the picture is cut off: a pixel there says only that the value is at least so
        extreme.
    settled : float
        Standard deviations of the parameters within which a fit stops.
    """
    problem = _Corners(windows, limits)
    pixels = windows.counts.sum(1)
    options = Options(negligible(settled, pixels, model.COUNT), ITERATIONS)
    with np.errstate(over="ignore", invalid="ignore"):  # steps that lead anywhere are not taken
        params, normal, stats = minimise(problem, start, options)
    noise = np.sqrt(np.maximum(2 * normal.cost / np.maximum(pixels - model.COUNT, 1), ROUNDING**2))
    covariance = _inverse(normal.matrix)[:, :2, :2] * (noise**2)[:, None, None]
    converged = stats.converged
    if not converged.all():
        step = problem.solve(params, normal, np.zeros(len(start)))[0]
        converged |= np.abs(step[:, :2]).max(1) < STILL
    return Fits(params, covariance, noise, converged)


def _inverse(matrix: Array) -> Array:
    """Inverses of JᵀJ (K, n, n), positive definite though the products are rounded to float32."""
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    both = scale[:, :, None] * scale[:, None, :]
    return np.linalg.inv(matrix * both + PRODUCTS * np.eye(model.COUNT)) * both


class _Corners(Small):
    """The corners of a picture as one batch."""

    def __init__(self, windows: Windows, limits: tuple[float, float]):
        self.windows, self.limits, self.count = windows, limits, len(windows.q)
        # what the model's approximation of erf is worth: its derivatives do not see a change of this size
        self.rounding = 0.5 * windows.counts.sum(1) * (model.ERF_ERROR * limits[1]) ** 2
        self.left = np.arange(self.count), windows

    def linearise(self, state: Array, members: Array) -> Normal:
        """r = model - value, grey levels."""
        if len(members) != len(self.left[0]):
            self.left = members, self.windows.take(members)
        return _normal_equations(self.left[1], state, self.limits)

    def solve(self, state: Array, equations: Normal, damping: Array) -> tuple[Array, Array]:
        """The blur is left out of the equations of those corners where it would fall below its least value."""
        _, matrix, gradient = equations
        held = (state[:, model.BLUR] <= LEAST_BLUR) & (gradient[:, model.BLUR] > 0)
        if held.any():
            matrix, gradient = matrix.copy(), gradient.copy()
            matrix[held, model.BLUR] = 0
            matrix[held, :, model.BLUR] = 0
            gradient[held, model.BLUR] = 0
        return damped_steps(matrix, gradient, damping)

    def retract(self, state: Array, step: Array) -> Array:
        """Keep the blur within its limits."""
        moved = state + step
        moved[:, model.BLUR] = np.clip(moved[:, model.BLUR], LEAST_BLUR, MOST_BLUR)
        return moved


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


def _normal_equations(windows: Windows, params: Array, limits: tuple[float, float]) -> Normal:
    """The normal equations of r = model - value.

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
        cost[rows] = 0.5 * np.matmul(residual[:, None], residual[..., None])[:, 0, 0]
    return Normal(cost, normal, gradient)
