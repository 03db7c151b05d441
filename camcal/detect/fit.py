"""Fits of the grey values around many corners at once, with the common least-squares loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.windows import Inner, Windows
from camcal.least_squares import Normal, Options, Small, damped_steps, minimise, negligible
from camcal.least_squares.scales import UNIFORM
from camcal.records import dataclass

Array = np.ndarray

ITERATIONS = 25  #: usual fits take 3 to 8
CACHED = 16_000  #: pixels processed at a time: their arrays fit into a cache of half a megabyte
#: standard deviations of its parameters within which a fit stops: this adds half a percent to a corner's error
SETTLED = 0.1
#: blurs; a Gauss-Newton step of that length, of the corner or of the blur, ends within half its square of the minimum:
#: .001 of the blur, a tenth of the sigma of a corner without visible noise
SHORT = 0.05
LONG = 0.5  #: blurs; for a longer step the derivatives at its start no longer describe the edges
SLIGHT = 1e-8  #: damping of those steps, which keeps the equations of windows without an edge solvable
STILL = 0.01  #: px; a corner whose next step is shorter after the last iteration has converged
ROUNDING = UNIFORM  #: grey levels; the rounding error of integer grey values
#: px⁴, of the half-contrast over the blur⁴: residual of a Gaussian edge averaged over a square pixel, whose fourth
#: cumulant is 1/120 px⁴, which changes the edge 2 Φ - 1 by (1/120) / 24 times 2 He3 φ / s⁴; He3 φ is .36 (rms)
SQUARE_PIXEL = 2.5e-4
PRODUCTS = 1e-5  #: of a diagonal of 1; the rounding error of a sum of some hundred products in float32
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

    def take(self, rows: Array | slice) -> Fits:
        """Select some of the fits."""
        return Fits(self.params[rows], self.covariance[rows], self.noise[rows], self.converged[rows])

    def replaced(self, rows: Array, new: Fits) -> Fits:
        """Replace the fits of some corners."""
        if not len(rows):
            return self
        every = [a.copy() for a in (self.params, self.covariance, self.noise, self.converged)]
        for a, b in zip(every, (new.params, new.covariance, new.noise, new.converged), strict=True):
            a[rows] = b
        return Fits(*every)


def fit(windows: Windows, start: Array, limits: tuple[float, float], settled: float = SETTLED) -> Fits:
    """Fit the model of a corner to each window.

    Parameters
    ----------
    windows : Windows
    start : (K, 7) array
        Parameters to start from.
    limits : (low, high)
        Grey values at which the picture is clipped: the true value of a pixel there is at least as extreme.
    settled : float
        Standard deviations of the parameters within which a fit stops.
    """
    problem = _Corners(windows, limits)
    pixels = windows.counts.sum(1)
    options = Options(negligible(settled, pixels, model.COUNT), ITERATIONS)
    with np.errstate(over="ignore", invalid="ignore"):  # steps to infinite values are rejected
        params, normal, stats = minimise(problem, start, options)
    converged = stats.converged
    if not converged.all():
        step = problem.solve(params, normal, np.zeros(len(start)))[0]
        converged |= np.abs(step[:, :2]).max(1) < STILL
    return _found(params, normal, pixels, converged)


def _found(params: Array, normal: Normal, pixels: Array, converged: Array) -> Fits:
    """Fits with noise and covariance from their normal equations over `pixels` (K,) pixels each."""
    noise = _noise(normal.cost, pixels, params)
    covariance = _inverse(normal.matrix)[:, :2, :2] * (noise**2)[:, None, None]
    return Fits(params, covariance, noise, converged)


def _noise(cost: Array, pixels: Array, params: Array) -> Array:
    """Standard deviation (K,) of the residuals, grey levels, from their cost and the number of pixels."""
    shape = SQUARE_PIXEL * params[:, model.CONTRAST] / np.maximum(params[:, model.BLUR], LEAST_BLUR) ** 4
    return np.sqrt(np.maximum(2 * cost / np.maximum(pixels - model.COUNT, 1), ROUNDING**2 + shape**2))


def approached(windows: Windows, start: Array, limits: tuple[float, float]) -> tuple[Array, Array]:
    """Parameters (K, 7) after one step towards the fit, and the noise (K,) that this step predicts.

    If the step is longer than `LONG`, the parameters remain those of the start.
    """
    problem = _Corners(windows, limits)
    with np.errstate(over="ignore", invalid="ignore"):
        moved, cost, length = _stepped(problem, start, problem.linearise(start, problem.left[0]))
    return np.where((length <= LONG)[:, None], moved, start), _noise(cost, windows.counts.sum(1), start)


def fit_sizes(
    windows: Windows, sizes: Sequence[Inner], start: Array, limits: tuple[float, float]
) -> list[Fits]:
    """Fit the model in windows of several sizes by one step, using the derivatives of the largest for all of them.

    Corners whose step is longer than `SHORT` are fitted iteratively.

    Parameters
    ----------
    windows : Windows
        The largest.
    sizes : sequence of Inner
        Ascending; the last comprises all pixels.
    start, limits
        As for `fit`.
    """
    problem = _Corners(windows, limits)
    count, begin = len(start), np.tile(start, (len(sizes), 1))
    pixels = np.concatenate([windows.counts[:, : s.columns].sum(1) for s in sizes])
    # all sizes are solved together, as if they were additional corners
    with np.errstate(over="ignore", invalid="ignore"):
        parts = _normal_equations(windows, start, limits, [s.columns for s in sizes])
        equations = Normal(*map(np.concatenate, zip(*parts, strict=True)))
        params, cost, length = _stepped(problem, begin, equations)
    every = _found(params, equations._replace(cost=cost), pixels, length <= SHORT)
    fits = []
    for i, size in enumerate(sizes):
        found = every.take(slice(i * count, (i + 1) * count))
        far = np.flatnonzero(~found.converged)
        if len(far):
            found = found.replaced(far, fit(windows.inner(size).take(far), start[far], limits))
        fits.append(found)
    return fits


def _stepped(problem: _Corners, state: Array, equations: Normal) -> tuple[Array, Array, Array]:
    """Parameters after a Gauss-Newton step, the cost that it predicts, and its length in blurs."""
    step, gain = problem.solve(state, equations, np.full(len(state), SLIGHT))
    length = np.abs(step[:, [model.DX, model.DY, model.BLUR]]).max(1, initial=0) / state[:, model.BLUR]
    return problem.retract(state, step), equations.cost - gain, length


def _inverse(matrix: Array) -> Array:
    """Inverses of JᵀJ (K, n, n), kept positive definite despite the float32 rounding of the products."""
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    both = scale[:, :, None] * scale[:, None, :]
    return np.linalg.inv(matrix * both + PRODUCTS * np.eye(model.COUNT)) * both


class _Corners(Small):
    """The corners of a picture as one batch."""

    def __init__(self, windows: Windows, limits: tuple[float, float]):
        self.windows, self.limits, self.count = windows, limits, len(windows.q)
        # the error of the erf approximation: its derivatives do not represent changes of this size
        self.rounding = 0.5 * windows.counts.sum(1) * (model.ERF_ERROR * limits[1]) ** 2
        self.left = np.arange(self.count), windows

    def linearise(self, state: Array, members: Array) -> Normal:
        """r = model - value, grey levels."""
        if len(members) != len(self.left[0]):
            self.left = members, self.windows.take(members)
        windows = self.left[1]
        return _normal_equations(windows, state, self.limits, [windows.value.shape[1]])[0]

    def solve(self, state: Array, equations: Normal, damping: Array) -> tuple[Array, Array]:
        """Solve for the steps; if the blur would fall below its minimum, it is removed from the equations."""
        _, matrix, gradient = equations
        held = (state[:, model.BLUR] <= LEAST_BLUR) & (gradient[:, model.BLUR] > 0)
        if held.any():
            matrix, gradient = matrix.copy(), gradient.copy()
            matrix[held, model.BLUR] = 0
            matrix[held, :, model.BLUR] = 0
            gradient[held, model.BLUR] = 0
        return damped_steps(matrix, gradient, damping)

    def retract(self, state: Array, step: Array) -> Array:
        """Clip the blur to its limits."""
        moved = state + step
        moved[:, model.BLUR] = np.clip(moved[:, model.BLUR], LEAST_BLUR, MOST_BLUR)
        return moved


def first_guess(windows: Windows, angles: Array, blur: Array) -> Array:
    """Starting parameters (K, 7): offset and contrast by least squares, the corner at the origin.

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
    windows: Windows, params: Array, limits: tuple[float, float], ends: Sequence[int]
) -> list[Normal]:
    """The normal equations of r = model - value over the pixels before each of `ends`.

    Few windows are processed at a time, so that the arrays stay in the processor's cache.
    """
    count, size = windows.value.shape
    parts = list(zip([0, *ends], ends, strict=False))
    cost, normal = np.empty((len(ends), count)), np.empty((len(ends), count, model.COUNT, model.COUNT))
    gradient = np.empty((len(ends), count, model.COUNT))
    for start in range(0, count, max(1, CACHED // max(size, 1))):
        rows = slice(start, start + max(1, CACHED // max(size, 1)))
        observed, counts = windows.value[rows], windows.counts[rows]
        value, jacobian = model.evaluate(windows.q[rows], params[rows])
        residual = value - observed
        if observed.max(initial=limits[0]) >= limits[1] or observed.min(initial=limits[1]) <= limits[0]:
            low, high = limits
            counts = counts & ~((observed >= high) & (residual > 0)) & ~((observed <= low) & (residual < 0))
            jacobian *= counts[:, None]
        else:  # pixels without weight are far from the edges, where the other derivatives are 0
            jacobian[:, model.OFFSET] *= counts
            jacobian[:, model.CONTRAST] *= counts
        residual *= counts
        for i, (begin, end) in enumerate(parts):
            j, r = jacobian[..., begin:end], residual[:, begin:end]
            normal[i, rows] = np.matmul(j, j.transpose(0, 2, 1))
            gradient[i, rows] = np.matmul(j, r[..., None])[..., 0]
            cost[i, rows] = 0.5 * np.matmul(r[:, None], r[..., None])[:, 0, 0]
    return list(map(Normal, cost.cumsum(0), normal.cumsum(0), gradient.cumsum(0)))
