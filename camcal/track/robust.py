"""The camera of a single frame, robust against outliers: the start of a track, also after a change."""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.errors import EstimationError
from camcal.least_squares.scales import TUKEY
from camcal.records import dataclass
from camcal.track import linear
from camcal.track.frames import Frame
from camcal.track.linear import Compressed
from camcal.track.model import Model
from camcal.track.noise import FLOOR

Array = np.ndarray

STEPS = 40  #: of reweighting, at most
SETTLED = 1e-4  #: standard deviations; a smaller step ends the reweighting


@dataclass
class FrameFit:
    """A camera fitted to one frame.

    Attributes
    ----------
    estimate : object
    factor : (p, p) array
        L with covariance L Lᵀ.
    equations : Compressed
        The frame's own equations at the estimate, inliers only.
    keep : (N,) bool array
    sigma : float
        The noise that the equations and the factor rest on: the known one, else that of the inliers.
    scatter : float
        The noise of the inliers.
    """

    estimate: Any
    factor: Array
    equations: Compressed
    keep: Array
    sigma: float
    scatter: float


def fit(
    model: Model, start: Any, frame: Frame, sigma: float | None, gate: float, prior: Array | None = None
) -> FrameFit:
    """Minimise Tukey's loss by reweighted Gauss-Newton steps, then take the points within the gate.

    Parameters
    ----------
    start : object
        An estimate; the centre of the prior too.
    sigma : float or None
        Noise of the image points; None: from the median residual.
    gate : float
        Largest squared normalised distance of an inlier.
    prior : (p, p) array, optional
        Factor of a covariance about the start.

    Raises
    ------
    EstimationError
        If the inliers do not determine the camera or the iteration does not settle.
    """
    x, scale = start, 1.0
    own = np.ones(len(frame)) if frame.sigma is None else frame.sigma
    for _ in range(STEPS):
        design, valid = model.linearise(x, frame)
        distance = _distances(design, valid, own)
        scale = _scale(distance, model.size, sigma)
        weights = np.maximum(0.0, 1 - (distance / (TUKEY * scale)) ** 2)
        a, z = _equations(design, weights / (scale * own), model, start, x, prior)
        delta = _solve(a, z)
        x = model.retract(x, delta)
        if np.abs(a @ delta).max() < SETTLED:
            break
    else:
        raise EstimationError(
            "the camera of a single frame does not converge.", "Its points may fit no camera."
        )
    return _finish(model, start, x, frame, sigma, gate, prior, own)


def _finish(
    model: Model,
    start: Any,
    x: Any,
    frame: Frame,
    sigma: float | None,
    gate: float,
    prior: Array | None,
    own: Array,
) -> FrameFit:
    """Gate the points at the solution and take one unweighted step with the remaining ones."""
    design, valid = model.linearise(x, frame)
    distance = _distances(design, valid, own)
    scale = _scale(distance, model.size, sigma)
    keep = distance**2 <= gate * scale**2
    a, z = _equations(design, keep / (scale * own), model, start, x, prior)
    x = model.retract(x, _solve(a, z))
    design, valid = model.linearise(x, frame)
    keep &= valid
    rows = (design[:, :, keep] / own[keep]).reshape(len(design), -1)
    squares, dof = float((rows[-1] ** 2).sum()), 2 * int(keep.sum()) - model.size
    scatter = float(np.sqrt(squares / dof)) if dof > 0 else scale
    noise = max(scatter, FLOOR) if sigma is None else sigma
    own_equations = linear.compress(rows / noise)
    a, _ = _equations(design, keep / (noise * own), model, start, x, prior)
    factor = linear.solve_upper(a, np.eye(model.size))
    return FrameFit(x, factor, own_equations, keep, noise, scatter)


def _distances(design: Array, valid: Array, own: Array) -> Array:
    """Residual lengths in units of the points' sigmas; inf for points outside the camera's domain."""
    if not valid.any():
        raise EstimationError("no point lies in front of the camera.", "Check the points of the frame.")
    r = design[-1]
    return np.where(valid, np.sqrt(r[0] ** 2 + r[1] ** 2) / own, np.inf)


def _scale(distance: Array, size: int, sigma: float | None) -> float:
    """The noise, at least its known part; a quantile corrected for the number of fitted parameters."""
    count = len(distance)
    rank = majority(count, size)
    spare = max(2 * count - size, 1) / (2 * count)
    # the length of a two-dimensional normal residual exceeds x with the probability exp(-x² / 2)
    usual = np.sqrt(-2 * np.log(1 - rank / (count + 1)) * spare)
    scale = float(np.partition(distance, rank - 1)[rank - 1] / usual)
    if not np.isfinite(scale):
        raise EstimationError("most points lie behind the camera.", "Check the points of the frame.")
    return max(scale, FLOOR if sigma is None else sigma)


def majority(count: int, size: int) -> int:
    """The rank of the residual that robust fits of `size` parameters to `count` points minimise.

    Half of the points that a fit does not pass through of itself, and those (Rousseeuw & Leroy, Robust
    Regression and Outlier Detection 1987, section 3.4): with few points the median would be zero.
    """
    free = -(-size // 2)
    return min(max((count + free + 1) // 2, 1), count)


def _equations(
    design: Array, weights: Array, model: Model, start: Any, x: Any, prior: Array | None
) -> tuple[Array, Array]:
    """Triangular equations of the weighted points, and of the prior if there is one."""
    rows = np.where(weights > 0, design * weights, 0.0).reshape(len(design), -1)
    if prior is not None:
        inverse = np.linalg.inv(prior)
        extra = np.empty((len(design), len(prior)))
        extra[:-1] = inverse.T
        extra[-1] = -inverse @ model.local(start, x)
        rows = np.concatenate([rows, extra], 1)
    found = linear.compress(np.ascontiguousarray(rows))
    return found.a, found.z


def _solve(a: Array, z: Array) -> Array:
    pivots = np.abs(np.diag(a))
    if not pivots.min() > linear.UNDETERMINED * pivots.max():
        raise EstimationError("the points of a frame do not determine the camera.", "More points are needed.")
    return linear.solve_upper(a, z)
