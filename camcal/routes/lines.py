"""A lens from images of straight lines: the rays of each line lie in a plane through the camera's centre.

With the ray d(u, v; p) of a pixel and the unit normal n of a line's plane, n · d = 0. The distance of a point from
the line's image is, to first order, (n · d) / |∂(n · d)/∂(u, v)| px (Sampson). Its sum of squares over the lens
parameters p and all n is minimised, with the rays and derivatives of the points of the lines' images nearest to the
observed ones, renewed from round to round: derivatives at the observed points share their noise with the residuals,
which draws the lens to one side (Chojnacki et al., On the fitting of surfaces to data with covariances, 2000).

Straight lines stay straight under every map of the plane onto itself that keeps lines, so that they say nothing
on the focal length, the aspect and the skew of most models: these are held. The lens is then that of a camera of
the focal length given (the longer side of the picture by default).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array
from camcal.solve.parameters import apply_fixed, free_matrix

LEAST_POINTS = 4  #: of a line: two fix it, the rest say whether it bends
LEAST_LINES = 2
#: distances beyond this many σ lose weight: 95 % efficiency on Gaussian noise (Huber, Robust estimation of a
#: location parameter, 1964); the median of |r| of a normal distribution of σ = 1
HUBER, NORMAL_MEDIAN = 1.345, 0.6744898
#: the root mean square exceeds the σ from the median by chance by less than this over sqrt(N): 4 standard
#: deviations of the ratio, 1.17 / sqrt(N) for a median against a root mean square
HEAVIER = 4.7
#: rounds of renewed denominators, and the change of the lens in its standard deviations that ends them
ROUNDS, SETTLED = 12, 1e-3
#: a direction of the parameters is undetermined where it moves the lines by less than this part of the direction
#: that moves them most, each parameter in its own unit
UNDETERMINED = 1e-7
#: px; a parameter is undetermined where a change by its unit (1 px of the principal point, 1 of a coefficient, one
#: focal length of a centre) moves the lines by less than this, rms
DEAD = 1e-6


@dataclass(frozen=True)
class Lines:
    """Points on images of straight lines.

    Attributes
    ----------
    uv : (N, 2) array, px
    line : (N,) int array
        Rows of a line stand together.
    names : tuple of str
    image_size : (width, height) or None
    """

    uv: Array
    line: Array
    names: tuple[str, ...]
    image_size: tuple[int, int] | None = None

    @classmethod
    def of(cls, parts: Sequence[Array], names: Sequence[str], image_size: tuple[int, int] | None) -> Lines:
        """From the points (N, 2) of each line."""
        counts = [len(p) for p in parts]
        uv = np.concatenate(parts) if parts else np.zeros((0, 2))
        return cls(uv, np.repeat(np.arange(len(parts)), counts), tuple(names), image_size)

    def __len__(self) -> int:
        return len(self.names)

    def take(self, chosen: Array) -> Lines:
        """Only some of the lines (a mask or indices)."""
        index = np.arange(len(self))[chosen]
        place = np.full(len(self), -1)
        place[index] = np.arange(len(index))
        rows = place[self.line] >= 0
        return Lines(
            self.uv[rows], place[self.line[rows]], tuple(self.names[i] for i in index), self.image_size
        )


@dataclass(frozen=True)
class LineFit:
    """A lens from lines.

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
        By which the variance of neighbours that share their noise exceeds that of independent points.
    used : (L,) bool array
        Which lines of those given took part.
    iterations : int
    converged : bool
    fixed : tuple of str
        Parameters that were held.
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


@dataclass(frozen=True)
class _State:
    params: Array
    normals: Array


def nominal(lens: Lens, image_size: tuple[int, int], fix: Mapping[str, float | None]) -> Camera:
    """The lens without distortion, f the longer side, the principal point in the middle, and what `fix` says."""
    f = float(max(image_size))
    params = lens.pinhole(f, f, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2)
    return Camera(lens, apply_fixed(lens, params, dict(fix)), image_size)


def held(lens: Lens, fix: Mapping[str, float | None]) -> dict[str, float | None]:
    """What is not estimated: the focal lengths and the skew, the principal point beside a centre of its own."""
    names: dict[str, float | None] = {p.name: None for p in lens.parameters if p.group in ("focal", "skew")}
    if getattr(lens, "free_centre", False):
        names |= {"cx": None, "cy": None}
    return {**names, **dict.fromkeys(lens.default_fixed), **fix}


def fit(lines: Lines, start: Camera, fix: Mapping[str, float | None], resistant: bool = False) -> LineFit:
    """The lens whose lines are straightest in px, from a start.

    With `resistant`, points weigh by Huber's loss from the second round on where the distances are not Gaussian:
    some lie on no line.

    Raises
    ------
    DataError
        Fewer than two lines of four points, or no image size.
    EstimationError
        Where points lie outside the domain of the start, or there are fewer points than unknowns.
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
        # what moves nothing at the start (the centre of a lens without distortion) waits for the rest
        fitted = _round(lines, lens, free if number or not len(moving) else free[:, moving], state, weight)
        if fitted is None:
            raise EstimationError(
                f"points lie outside the domain of model '{lens.name}' at its start.", "Try another model."
            )
        state, total = fitted.state, total + fitted.iterations
        if number == 0 and len(moving) < free.shape[1]:
            continue
        if resistant:
            weight = _weights(distances(Camera(lens, state.params), lines))
        sigma = np.sqrt(np.abs(np.diagonal(_covariance(fitted.normal.reduced(), free, len(lines.uv))[0])))
        moved = np.abs(state.params - before)
        scale = np.sqrt(2 * fitted.normal.cost / len(lines.uv)) * sigma
        if (moved <= SETTLED * scale + 1e-12 * np.abs(before)).all():
            break
    assert fitted is not None
    return _finished(lines, start, free, weight, fitted, total)


def _weights(off: Array) -> Array:
    """Weights (N,) of points at distances (N,) from their lines: 1 for all where these look Gaussian."""
    sigma = float(np.median(np.abs(off))) / NORMAL_MEDIAN
    heavy = np.sqrt(np.square(off).mean()) > sigma * (1 + HEAVIER / np.sqrt(len(off)))
    return 1 / np.maximum(np.abs(off) / (HUBER * sigma), 1.0) if heavy and sigma > 0 else np.ones(len(off))


def _check(lines: Lines) -> None:
    counts = np.bincount(lines.line, minlength=len(lines))
    if (counts >= LEAST_POINTS).sum() < LEAST_LINES:
        raise DataError(
            f"{len(lines)} line{'s' * (len(lines) != 1)} found; {LEAST_LINES} lines of {LEAST_POINTS} points are "
            "needed to say how a lens bends them.",
            "Give more lines.",
        )


def _moving(lines: Lines, lens: Lens, free: Array, state: _State) -> Array:
    """Which free parameters (F,) move the lines at the start."""
    at = line_rays(Camera(lens, state.params), lines.uv)
    if at is None:
        return np.arange(free.shape[1])
    n = state.normals[lines.line]
    by_params = np.einsum("ni,nip->np", n, at[2]) @ free / slopes(at, n)[:, None]
    return np.flatnonzero(np.sqrt(np.square(by_params).mean(0)) > DEAD)


def _round(lines: Lines, lens: Lens, free: Array, state: _State, weight: Array) -> Fitted[_State] | None:
    """Minimise with the nearest points and the denominators as they are at the start."""
    near = nearest_points(Camera(lens, state.params), lines.uv, state.normals[lines.line])
    if near is None:
        return None
    root = np.sqrt(weight)
    per_unit, distance = root * near.weight, root * near.distance

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
        return BlockNormal.of_groups(residual, shared, own, lines.line, len(lines))

    def moved(s: _State, step: Array, own: Array) -> _State:
        normals = s.normals + np.einsum("lik,lk->li", tangents(s.normals), own)
        return _State(s.params + free @ step, normals / np.linalg.norm(normals, axis=1, keepdims=True))

    return minimise(linearise, moved, state)


class Nearest(NamedTuple):
    """The points of lines' images nearest to observed ones.

    Attributes
    ----------
    uv : (N, 2) array, px
    weight : (N,) array
        Px for a unit of n · d there.
    distance : (N,) array
        Of the observed points, px, with the sign of n · d.
    """

    uv: Array
    weight: Array
    distance: Array


def nearest_points(camera: Camera, uv: Array, normals: Array) -> Nearest | None:
    """Two Newton steps along the gradient of n · d, (N, 3) normals; None outside the domain of the lens."""
    near, weight = uv, np.ones(len(uv))
    slope = np.zeros_like(uv)
    for _ in range(2):
        at = line_rays(camera, near)
        if at is None:
            return None
        slope = np.einsum("ni,nij->nj", normals, at[1])
        square = np.square(slope).sum(1)
        weight = 1 / np.sqrt(square)
        # to the line along the normal through the observed point
        across = slope * weight[:, None]
        off = (normals * at[0]).sum(1) * weight + ((uv - near) * across).sum(1)
        near = uv - off[:, None] * across
    return Nearest(near, weight, ((uv - near) * slope).sum(1) * weight)


def line_rays(camera: Camera, uv: Array) -> tuple[Array, Array, Array] | None:
    """Rays d (N, 3), ∂d/∂(u, v) (N, 3, 2), ∂d/∂params (N, 3, P), by the inverse of the projection's derivatives."""
    d = camera.unproject(uv)
    if not np.isfinite(d).all():
        return None
    _, d_xyz, d_params, valid = camera.lens.jacobians(camera.params, d)
    if not valid.all():
        return None
    across = tangents(d)
    onto = d_xyz @ across
    det = onto[:, 0, 0] * onto[:, 1, 1] - onto[:, 0, 1] * onto[:, 1, 0]
    if not (np.abs(det) > 0).all():
        return None
    by_uv = across @ np.linalg.inv(onto)
    return d, by_uv, -by_uv @ d_params


def slopes(at: tuple[Array, Array, Array], normals: Array) -> Array:
    """|∂(n · d)/∂(u, v)| (N,), per px."""
    return np.linalg.norm(np.einsum("ni,nij->nj", normals, at[1]), axis=1)


def tangents(vectors: Array) -> Array:
    """Two unit vectors (N, 3, 2) normal to each vector (N, 3) and to each other."""
    helper = np.where(np.abs(vectors[:, :1]) < 0.6, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(vectors, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(vectors, first)], 2)


def best_normals(camera: Camera, lines: Lines) -> Array:
    """The normals (L, 3) of the planes nearest to the rays of each line."""
    return plane_normals(np.nan_to_num(camera.unproject(lines.uv)), lines.line, len(lines))


def plane_normals(rays: Array, line: Array, count: int) -> Array:
    """The unit vectors (L, 3) most nearly normal to the rays (N, 3) of each line."""
    scatter = np.zeros((count, 3, 3))
    np.add.at(scatter, line, rays[:, :, None] * rays[:, None])
    return np.linalg.eigh(scatter)[1][:, :, 0]


def distances(camera: Camera, lines: Lines) -> Array:
    """Distances (N,) of points from the images of the straight lines nearest to them, px; NaN outside the domain."""
    at = line_rays(camera, lines.uv)
    if at is None:
        return np.full(len(lines.uv), np.nan)
    n = plane_normals(at[0], lines.line, len(lines))
    for _ in range(2):  # the plane of least algebraic error, then of least distance in px
        weight = 1 / slopes(at, n[lines.line])
        n = plane_normals(at[0] * weight[:, None], lines.line, len(lines))
    return (n[lines.line] * at[0]).sum(1) / slopes(at, n[lines.line])


def _covariance(reduced: Array, free: Array, points: int) -> tuple[Array, Array]:
    """Unscaled covariance (P, P) of the parameters, and the undetermined directions (P, U)."""
    diagonal = np.maximum(np.diagonal(reduced), 0)
    alive = np.sqrt(diagonal / points) > DEAD
    scale = np.sqrt(diagonal[alive])
    values, vectors = np.linalg.eigh(reduced[np.ix_(alive, alive)] / np.outer(scale, scale))
    known = values > UNDETERMINED**2 * values.max(initial=0)
    basis = free[:, alive] @ (vectors / scale[:, None])
    covariance = (basis[:, known] / values[known]) @ basis[:, known].T
    lost = basis[:, ~known]
    lost = lost / np.maximum(np.linalg.norm(lost, axis=0), np.finfo(float).tiny)
    return covariance, np.c_[lost, free[:, ~alive]]


def _finished(
    lines: Lines,
    start: Camera,
    free: Array,
    weight: Array,
    fitted: Fitted[_State],
    total: int,
) -> LineFit:
    camera = replace(start, params=fitted.state.params)
    at = line_rays(camera, lines.uv)
    assert at is not None
    n = fitted.state.normals[lines.line]
    off = (n * at[0]).sum(1) / slopes(at, n)
    covariance, lost = _covariance(fitted.normal.reduced(), free, len(lines.uv))
    factor = inflation(off, lines.line)
    freedom = len(off) - 2 * len(lines) - free.shape[1]
    # Huber & Ronchetti, Robust Statistics, 2009, (7.83), with (JᵀWJ)⁻¹ mean(w) for (JᵀJ)⁻¹
    score, inside = weight * off, float((weight == 1).mean())
    covariance = covariance * (weight.mean() / inside**2 * (score @ score) / freedom) * factor
    names = camera.lens.names
    # a parameter is undetermined where an undetermined direction moves it noticeably
    share = np.abs(lost).max(1, initial=0) if lost.size else np.zeros(len(names))
    loose = (
        tuple(n for n, s in zip(names, share, strict=True) if s > 1e-3 * max(share.max(), 1e-300))
        if lost.size
        else ()
    )
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


def inflation(residuals: Array, group: Array) -> float:
    """How far the variance of a mean exceeds that of independent residuals: 1 + 2 Σ correlation(lag).

    The sum ends at the first lag without a significant correlation; residuals of a group stand in order.
    """
    total, count = 1.0, len(residuals)
    power = float(residuals @ residuals) / max(count, 1)
    for lag in range(1, max(count // 10, 2)):
        same = group[lag:] == group[:-lag]
        pairs = int(same.sum())
        if pairs < 30 or power == 0:
            break
        correlation = float((residuals[lag:] * residuals[:-lag])[same].mean()) / power
        if correlation < 2 / np.sqrt(pairs):
            break
        total += 2 * correlation
    return total
