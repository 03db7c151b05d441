"""A lens from images of straight lines: the rays of each line lie in a plane through the camera's centre.

With the ray d(u, v; p) of a pixel and the unit normal n of a line's plane, n · d = 0. The distance of a point from
the line's image is, to first order, (n · d) / |∂(n · d)/∂(u, v)| px (Sampson). Its sum of squares is
minimised over the lens parameters p and all n. Rays and derivatives are those of the points of the lines' images
nearest to the observed ones, updated in each round: derivatives at the observed points share their noise with the
residuals, which biases the lens (Chojnacki et al., On the fitting of surfaces to data with covariances, 2000).

Straight lines remain straight under every collineation, so that for most models they do not determine the focal
length, the aspect and the skew, which are held. The lens is then that of a camera with the given focal length (by
default the longer side of the picture).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.least_squares.blocks import FLOOR, BlockNormal, Fitted, minimise
from camcal.least_squares.scales import NORMAL_MEDIAN
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.lenses.inverse import InverseLens
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes.between_lines import with_scatter
from camcal.routes.line_geometry import (
    Lines,
    best_normals,
    distances,
    line_rays,
    nearest_points,
    slopes,
    tangents,
)
from camcal.solve.parameters import free_matrix

LEAST_POINTS = 4  #: of a line: two define it, the others show whether it is bent
LEAST_LINES = 2  #: a single line is straight under infinitely many distortions
#: distances beyond this many σ lose weight: 95 % efficiency on Gaussian noise (Huber, Robust estimation of a
#: location parameter, 1964)
HUBER = 1.345
#: by chance the rms exceeds the σ from the median by less than this over sqrt(N): 4 standard deviations of the ratio
#: of a median to an rms, 1.17 / sqrt(N)
HEAVIER = 4.7
#: largest number of updates of the denominators, and the change of the lens, in standard deviations, that ends them
ROUNDS, SETTLED = 12, 1e-3
SAME_WEIGHT = 0.01  #: change of the weights (0 to 1) that ends them, a hundredth of a point
#: a direction of the parameters is undetermined if it moves the lines by less than this fraction of the direction that
#: moves them most, each parameter in its own unit
UNDETERMINED = 1e-7
#: px; a parameter is undetermined if a change by its unit (1 px of the principal point, 1 of a coefficient, one
#: focal length of a centre) moves the lines by less than this, rms
DEAD = 1e-6
#: Weight of the displacement of pixels by a flexible model in one round, added to the distances. Such a model contains
#: nearly every map that keeps lines straight, between which lines cannot distinguish: without this term the fit drifts
#: among them for a thousand steps. Each round starts where the last ended, so that even weakly determined directions
#: (a ten-thousandth of the others) still converge.
PROXIMAL = 0.01
#: a parameter is undetermined if an undetermined direction changes it by more than this fraction of the parameter that
#: changes most: rounding leaves a component in every one
NOTICEABLE = 1e-3
ROUNDING = 1e-12  #: of a parameter: a change at rounding level also ends the rounds: exact lines have σ = 0
#: correlations of residuals are computed up to a lag of this fraction of their number, if at least this many pairs have
#: the lag: with 30, the standard deviation of a correlation is 1 / sqrt(30) = 0.18
LAGS, LEAST_PAIRS = 10, 30
#: standard deviations, 1 / sqrt(pairs) (Bartlett 1946), above which a correlation is significant: 2.5 %
SIGNIFICANT = 2.0


@dataclass(frozen=True)
class LineFit:
    """A lens estimated from lines.

    Attributes
    ----------
    camera, start : Camera
    free : (P, F) array
        d parameters / d free parameters.
    covariance : (P, P) array
        Of the lens parameters; inf on the diagonal where undetermined.
    undetermined : tuple of str
        Parameters that the lines leave undetermined.
    distances : (N,) array
        Of the points from the images of their lines, px.
    inflation : float
        Factor by which correlated noise of neighbouring points increases the variance.
    used : (L,) bool array
        Mask of the lines that were used.
    iterations : int
    converged : bool
    fixed : tuple of str
        Parameters that were held.
    assumed : tuple of str
        Those of them that the lines leave undetermined: coordinates of the centre.
    """

    camera: Camera
    start: Camera
    free: Array
    covariance: Array
    undetermined: tuple[str, ...]
    distances: Array
    inflation: float
    used: Array
    iterations: int
    converged: bool
    fixed: tuple[str, ...]
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class _State:
    params: Array
    normals: Array


def held(lens: Lens, fix: Mapping[str, float | None]) -> dict[str, float | None]:
    """The parameters that are not estimated: focal lengths, skew, and the principal point if the lens has its own
    centre.
    """
    names: dict[str, float | None] = {p.name: None for p in lens.parameters if p.group in ("focal", "skew")}
    if getattr(lens, "free_centre", False):
        names |= {"cx": None, "cy": None}
    return {**names, **dict.fromkeys(lens.default_fixed), **fix}


def fit(
    lines: Lines,
    start: Camera,
    fix: Mapping[str, float | None],
    resistant: bool = False,
    scatter: bool = False,
) -> LineFit:
    """The lens that makes the lines straightest in px, from a start.

    With `resistant`, points are weighted by Huber's loss from the second round on if the distances are not Gaussian,
    because some points lie on no line. With `scatter`, for curves found by a program, the covariance contains the
    scatter between lines.

    Raises
    ------
    DataError
        If there are fewer than two lines of four points, or no image size.
    EstimationError
        If points lie outside the domain of the start, or there are fewer points than unknowns.
    """
    _check(lines)
    lens = start.lens
    free = free_matrix(lens, start.params, dict(fix))
    if len(lines.uv) - 2 * len(lines) <= free.shape[1]:
        raise EstimationError(
            f"{len(lines.uv)} points on {len(lines)} lines leave {len(lines.uv) - 2 * len(lines)} equations for "
            f"{free.shape[1]} unknowns.",
            "Give more lines, or a model with fewer parameters.",
        )
    state = _State(start.params, best_normals(start, lines))
    fitted: Fitted[_State] | None = None
    total = 0
    moving = _moving(lines, lens, free, state)
    weight = np.ones(len(lines.uv))
    for number in range(ROUNDS):
        before = state.params
        # parameters without effect at the start (the centre of a lens without distortion) are freed later
        fitted = _round(lines, lens, free if number or not len(moving) else free[:, moving], state, weight)
        if fitted is None:
            raise EstimationError(
                f"points lie outside the domain of model '{lens.name}' at its start.", "Try another model."
            )
        state, total = fitted.state, total + fitted.iterations
        if number == 0 and len(moving) < free.shape[1]:
            continue
        before_weight = weight
        if resistant:
            weight = _weights(distances(Camera(lens, state.params), lines))
        sigma = np.sqrt(np.abs(np.diagonal(_covariance(fitted.normal.reduced(), free, len(lines.uv))[0])))
        moved = np.abs(state.params - before)
        scale = np.sqrt(2 * fitted.normal.cost / len(lines.uv)) * sigma
        # a start that is the optimum without weights does not move in the first round
        settled = bool((moved <= SETTLED * scale + ROUNDING * np.abs(before)).all())
        if settled and np.abs(weight - before_weight).max() <= SAME_WEIGHT:
            break
    assert fitted is not None
    return _finished(lines, start, free, weight, fitted, total, scatter)


def _weights(off: Array) -> Array:
    """Weights (N,) of points at distances (N,) from their lines: 1 for all if the distances look Gaussian."""
    sigma = float(np.median(np.abs(off))) / NORMAL_MEDIAN
    heavy = np.sqrt(np.square(off).mean()) > sigma * (1 + HEAVIER / np.sqrt(len(off)))
    return 1 / np.maximum(np.abs(off) / (HUBER * sigma), 1.0) if heavy and sigma > 0 else np.ones(len(off))


def _check(lines: Lines) -> None:
    counts = np.bincount(lines.line, minlength=len(lines))
    if (counts >= LEAST_POINTS).sum() < LEAST_LINES:
        raise DataError(
            f"{len(lines)} line{'s' * (len(lines) != 1)} found; {LEAST_LINES} lines of {LEAST_POINTS} points are "
            "needed to estimate a distortion.",
            "Give more lines.",
        )


def _moving(lines: Lines, lens: Lens, free: Array, state: _State) -> Array:
    """The free parameters (F,) that affect the lines at the start."""
    at = line_rays(Camera(lens, state.params), lines.uv)
    if at is None:
        return np.arange(free.shape[1])
    n = state.normals[lines.line]
    by_params = np.einsum("ni,nip->np", n, at[2]) @ free / slopes(at, n)[:, None]
    return np.flatnonzero(np.sqrt(np.square(by_params).mean(0)) > DEAD)


def foreseen(lines: Lines, found: LineFit, fix: Mapping[str, float | None]) -> Array:
    """Predicted standard deviations (P,) of the parameters in a fit with other parameters held, from one step.

    The step tells how much of the residuals is due to what `found` held.
    """
    free = free_matrix(found.camera.lens, found.camera.params, dict(fix))
    state = _State(found.camera.params, best_normals(found.camera, lines))
    made = _linearised(lines, found.camera.lens, free, state, np.ones(len(lines.uv)))
    normal = made(state) if made is not None else None
    step = normal.step(FLOOR) if normal is not None else None
    if normal is None or step is None:
        return np.full(len(found.camera.params), np.inf)
    covariance, lost = _covariance(normal.reduced(), free, len(lines.uv))
    left = max(normal.cost - step[2], 0.0) / max(len(lines.uv) - 2 * len(lines) - free.shape[1], 1)
    sigmas = np.sqrt(np.diagonal(covariance) * 2 * left * found.inflation)
    sigmas[[n in _loose(found.camera.lens, lost) for n in found.camera.lens.names]] = np.inf
    return np.asarray(sigmas)


def _round(lines: Lines, lens: Lens, free: Array, state: _State, weight: Array) -> Fitted[_State] | None:
    """Minimise with the nearest points and the denominators fixed at their initial values."""
    near_start = _proximal(lines, lens, free, state)
    linearise = _linearised(lines, lens, free, state, weight, near_start)
    if linearise is None:
        return None

    def moved(s: _State, step: Array, own: Array) -> _State:
        normals = s.normals + np.einsum("lik,lk->li", tangents(s.normals), own)
        return _State(s.params + free @ step, normals / np.linalg.norm(normals, axis=1, keepdims=True))

    fitted = minimise(linearise, moved, state)
    if fitted is None:
        return None
    # the information on the parameters excludes the proximal term of the round
    return replace(fitted, normal=replace(fitted.normal, shared=fitted.normal.shared - near_start))


def _linearised(
    lines: Lines, lens: Lens, free: Array, state: _State, weight: Array, near_start: Array | None = None
) -> Callable[[_State], BlockNormal | None] | None:
    """The normal equations by the state, with the nearest points and the denominators of a first state."""
    near = nearest_points(Camera(lens, state.params), lines.uv, state.normals[lines.line])
    if near is None:
        return None
    root = np.sqrt(weight)
    per_unit, distance = root * near.weight, root * near.distance
    to_free = np.linalg.pinv(free)
    hold = np.zeros((free.shape[1], free.shape[1])) if near_start is None else near_start

    def linearise(s: _State) -> BlockNormal | None:
        now = line_rays(Camera(lens, s.params), near.uv)
        if now is None:
            return None
        d, _, by_params = now
        n = s.normals[lines.line]
        residual = per_unit * (n * d).sum(1) + distance
        shared = per_unit[:, None] * np.einsum("ni,nip->np", n, by_params) @ free
        tangent = tangents(s.normals)[lines.line]
        own = per_unit[:, None] * np.einsum("nik,ni->nk", tangent, d)
        normal = BlockNormal.of_groups(residual, shared, own, lines.line, len(lines))
        return _with_prior(normal, lens, s.params, free, hold, to_free @ (s.params - state.params))

    return linearise


def _proximal(lines: Lines, lens: Lens, free: Array, state: _State) -> Array:
    """The normal matrix (F, F) of the px by which the free parameters move pixels, for flexible models."""
    at = line_rays(Camera(lens, state.params), lines.uv) if isinstance(lens, InverseLens) else None
    if at is None:
        return np.zeros((free.shape[1], free.shape[1]))
    moved = PROXIMAL * state.params[0] * (at[2] @ free).reshape(-1, free.shape[1])
    return np.asarray(moved.T @ moved)


def _with_prior(
    normal: BlockNormal, lens: Lens, params: Array, free: Array, near_start: Array, step: Array
) -> BlockNormal:
    """Add the model's own regularisation, and the penalty of a step (F,) from the start of the round."""
    cost = normal.cost + 0.5 * float(step @ near_start @ step)
    shared, gradient = normal.shared + near_start, normal.gradient + near_start @ step
    prior = lens.prior(params)
    if prior is not None:
        residual, jacobian = prior[0], prior[1] @ free
        cost += 0.5 * float(residual @ residual)
        shared, gradient = shared + jacobian.T @ jacobian, gradient + jacobian.T @ residual
    return replace(normal, cost=cost, shared=shared, gradient=gradient)


def _covariance(reduced: Array, free: Array, points: int) -> tuple[Array, Array]:
    """Unscaled covariance (P, P) of the parameters, and the undetermined directions (P, U)."""
    basis, lost = _basis(reduced, free, points)
    return basis @ basis.T, lost


def _basis(reduced: Array, free: Array, points: int) -> tuple[Array, Array]:
    """B (P, K), with the unscaled covariance B Bᵀ of the parameters, and the undetermined directions (P, U)."""
    diagonal = np.maximum(np.diagonal(reduced), 0)
    alive = np.sqrt(diagonal / points) > DEAD
    scale = np.sqrt(diagonal[alive])
    values, vectors = np.linalg.eigh(reduced[np.ix_(alive, alive)] / np.outer(scale, scale))
    known = values > UNDETERMINED**2 * values.max(initial=0)
    basis = free[:, alive] @ (vectors / scale[:, None])
    determined = basis[:, known] / np.sqrt(values[known])
    lost = basis[:, ~known]
    lost = lost / np.maximum(np.linalg.norm(lost, axis=0), np.finfo(float).tiny)
    return determined, np.c_[lost, free[:, ~alive]]


def _finished(
    lines: Lines,
    start: Camera,
    free: Array,
    weight: Array,
    fitted: Fitted[_State],
    total: int,
    scatter: bool,
) -> LineFit:
    camera = replace(start, params=fitted.state.params)
    at = line_rays(camera, lines.uv)
    assert at is not None
    n = fitted.state.normals[lines.line]
    off = (n * at[0]).sum(1) / slopes(at, n)
    basis, lost = _basis(fitted.normal.reduced(), free, len(lines.uv))
    factor = inflation(off, lines.line)
    freedom = len(off) - 2 * len(lines) - free.shape[1]
    # Huber & Ronchetti, Robust Statistics, 2009, (7.83), with (JᵀWJ)⁻¹ mean(w) for (JᵀJ)⁻¹
    score, inside = weight * off, float((weight == 1).mean())
    variance = weight.mean() / inside**2 * (score @ score) / freedom * factor
    covariance = variance * basis @ basis.T
    if scatter:
        covariance = with_scatter(lines, at, n, weight, basis, variance)
    names, loose = camera.lens.names, _loose(camera.lens, lost)
    for name in loose:
        covariance[names.index(name), names.index(name)] = np.inf
    fixed = tuple(n for n, row in zip(names, free, strict=True) if not row.any())
    everybody = np.ones(len(lines), bool)
    return LineFit(
        camera,
        start,
        free,
        covariance,
        loose,
        off,
        factor,
        everybody,
        total,
        fitted.converged,
        fixed,
    )


def _loose(lens: Lens, lost: Array) -> tuple[str, ...]:
    """The parameters that undetermined directions (P, U) change."""
    share = np.abs(lost).max(1, initial=0)
    most = max(float(share.max(initial=0)), np.finfo(float).tiny)
    return tuple(n for n, s in zip(lens.names, share, strict=True) if s > NOTICEABLE * most)


def inflation(residuals: Array, group: Array) -> float:
    """The ratio of the variance of a mean to that for independent residuals: 1 + 2 Σ correlation(lag).

    The sum ends at the first lag without a significant correlation; residuals of a group are in order.
    """
    total, count = 1.0, len(residuals)
    power = float(residuals @ residuals) / max(count, 1)
    for lag in range(1, max(count // LAGS, 2)):
        same = group[lag:] == group[:-lag]
        pairs = int(same.sum())
        if pairs < LEAST_PAIRS or power == 0:
            break
        correlation = float((residuals[lag:] * residuals[:-lag])[same].mean()) / power
        if correlation < SIGNIFICANT / np.sqrt(pairs):
            break
        total += 2 * correlation
    return total
