"""The fit behind `scene`: the assignment of lines to directions, and the joint fit of camera, attitude and lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array
from camcal.routes.line_geometry import Lines, Nearest, line_rays, nearest_points, slopes, tangents
from camcal.routes.scene_start import misses
from camcal.solve.parameters import free_matrix

SQUARE = np.eye(3)  #: orthogonal directions

#: lines of a direction at least: two always meet, the third says that they do so at one point
LEAST_LINES = 3
#: px; noise of the ends of segments
NOISE = 0.3
#: rad; edges of buildings and furniture are out of their directions, and the directions out of square, by about this,
#: standard deviation (0.9 degrees, from twelve pictures of streets and rooms). Lines of tables are taken as exact.
LOOSE = 0.015
#: in standard deviations; a line belongs to a direction where its ends miss the line from its middle to the vanishing
#: point by less: from the start, whose directions come from two lines each, to three
BOUNDS = (6.0, 4.5, 3.0, 3.0, 3.0, 3.0)
#: in standard deviations; clutter is spread evenly within the bound, and the weight of a line falls with its distance
#: as 1 / (1 + (m / SOFT)²) (Cauchy)
SOFT = 1.0
#: of `Vote.growth`: for normal residuals it is 0.62; below this the residuals are clutter
LEAST_GROWTH = 0.3
#: renewals of the denominators of a fit on the way, and of the last one
RENEWALS, LAST = 1, 3
#: steps of a fit: from a start within the bounds fewer than ten are taken where the lines determine anything
STEPS = 25


@dataclass(frozen=True)
class Scene:
    """The result for one picture.

    Attributes
    ----------
    camera, start : Camera
    covariance : (P, P) array
        Of the camera's parameters.
    rotation : (3, 3) array
        cam_from_scene; columns are the directions of the families.
    rotation_sigma : (3,) array, rad
        About the camera's axes.
    family : (L,) int array
        The direction of each line, -1 for none.
    rms : float
        Of the distances of the points from their lines, px.
    fixed : tuple of str
    assumed : tuple of str
        Parameters that were held because the lines leave them undetermined.
    """

    camera: Camera
    start: Camera
    covariance: Array
    rotation: Array
    rotation_sigma: Array
    family: Array
    rms: float
    fixed: tuple[str, ...]
    assumed: tuple[str, ...]

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of lines of each direction."""
        a, b, c = np.bincount(self.family[self.family >= 0], minlength=3).tolist()
        return a, b, c

    @property
    def directions(self) -> list[int]:
        """The directions with enough lines."""
        return [i for i, n in enumerate(self.counts) if n >= LEAST_LINES]


class Vote(NamedTuple):
    """The assignment of lines to directions.

    Attributes
    ----------
    family : (L,) int array
        -1 for none.
    roots : (L,) array
        Of the weights.
    growth : float
        How the scores grow with the residuals, beside what the weighted Jacobian says, as the weights fall:
        Σ ψ' / Σ w (Huber, Robust statistics, 1981, section 7.6).
    """

    family: Array
    roots: Array
    growth: float


Seen = tuple[Array, Array]  #: end points (L, 2, 2) and their standard deviations (L,)


@dataclass(frozen=True)
class _State:
    params: Array
    rotation: Array
    angles: Array
    square: Array  #: (3, 3) the directions in the scene, columns; the identity where they are orthogonal


def families(seen: Seen, camera: Camera, rotation: Array, bound: float) -> Vote:
    """The direction of each line, -1 if none or two are within the bound, and its weight."""
    ends, noise = seen
    flat = ends if camera.lens.size <= 5 else _flat(camera, ends)
    miss = misses(flat, camera.params[2:4], float(camera.params[0]), rotation) / noise[:, None]
    order = np.sort(miss, axis=1)
    clear = (order[:, 0] <= bound) & (order[:, 1] > 2 * order[:, 0])
    family = np.where(clear, miss.argmin(1), -1)
    few = np.bincount(family[family >= 0], minlength=3) < LEAST_LINES
    family = np.where((family >= 0) & few[family], -1, family)
    square = (order[:, 0] / SOFT) ** 2
    weight, slope = 1 / (1 + square), (1 - square) / (1 + square) ** 2
    used = family >= 0
    growth = float(slope[used].sum() / weight[used].sum()) if used.any() else 1.0
    return Vote(family, np.sqrt(weight) / noise, max(growth, LEAST_GROWTH))


def spreads(lines: Lines, loose: float) -> Array:
    """Standard deviations (L,) of the ends of lines that belong to a direction, px."""
    ends = line_ends(lines)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.hypot(NOISE, loose * length / 2)


def _flat(camera: Camera, ends: Array) -> Array:
    rays = camera.unproject(ends)
    return rays[..., :2] / rays[..., 2:] * camera.params[:2] + camera.params[2:4]


def line_ends(lines: Lines) -> Array:
    """End points (L, 2, 2) of the straight lines nearest to the points."""
    out = np.empty((len(lines), 2, 2))
    for i in range(len(lines)):
        uv = lines.uv[lines.line == i]
        centre = uv.mean(0)
        main = np.linalg.eigh((uv - centre).T @ (uv - centre))[1][:, 1]
        along = (uv - centre) @ main
        out[i] = centre + np.outer([along.min(), along.max()], main)
    return out


def fit_scene(
    lines: Lines,
    camera: Camera,
    rotation: Array,
    vote: Vote,
    fix: Mapping[str, float | None],
    start: Camera,
    square: Array = SQUARE,
    renewals: int = RENEWALS,
) -> Scene | None:
    """Camera, rotation and line angles from a start; None if a line leaves the domain of the lens.

    `square` (3, 3) holds the directions in the scene as columns, where they are not orthogonal.
    """
    chosen = np.flatnonzero(vote.family >= 0)
    own = lines.take(chosen)
    axes = vote.family[chosen]
    free = free_matrix(camera.lens, camera.params, dict(fix))
    fitted: Fitted[_State] | None = None
    state = _State(camera.params, rotation, np.zeros(len(own)), square)
    for _ in range(renewals):  # of the denominators, as in `lines`
        at = line_rays(Camera(camera.lens, state.params), own.uv)
        if at is None:
            return None
        state = replace(state, angles=_angles(at[0], own, state, axes))
        fitted = _round(own, camera.lens, free, axes, state, vote.roots[chosen][own.line])
        if fitted is None:
            return None
        state = fitted.state
    assert fitted is not None
    return _scene(own, vote.roots[chosen][own.line], vote, camera, free, fitted, axes, start)


def _angles(rays: Array, lines: Lines, state: _State, axes: Array) -> Array:
    """The α (L,) of the planes nearest to the rays."""
    first, second = _basis(axes, state.square)
    turned = rays @ state.rotation
    a, b = (turned * first[lines.line]).sum(1), (turned * second[lines.line]).sum(1)
    sums = [np.bincount(lines.line, x, len(lines)) for x in (a * a, a * b, b * b)]
    # minimise Σ (a cos α + b sin α)²
    return 0.5 * np.arctan2(2 * sums[1], sums[0] - sums[2]) + np.pi / 2


def _basis(axes: Array, square: Array) -> tuple[Array, Array]:
    """Two unit vectors (L, 3) of the scene at right angles to each line's direction and to each other."""
    across = tangents(square.T)
    return across[axes, :, 0], across[axes, :, 1]


def _normals(state: _State, axes: Array) -> tuple[Array, Array]:
    """n (L, 3) and its derivative by α, in the camera's frame."""
    first, second = _basis(axes, state.square)
    c, s = np.cos(state.angles)[:, None], np.sin(state.angles)[:, None]
    return (c * first + s * second) @ state.rotation.T, (-s * first + c * second) @ state.rotation.T


def _round(
    lines: Lines, lens: Lens, free: Array, axes: Array, state: _State, roots: Array
) -> Fitted[_State] | None:
    near = nearest_points(Camera(lens, state.params), lines.uv, _normals(state, axes)[0][lines.line])
    if near is None:
        return None
    near = Nearest(near.uv, near.weight * roots, near.distance * roots)

    def linearise(s: _State) -> BlockNormal | None:
        now = line_rays(Camera(lens, s.params), near.uv)
        return None if now is None else _normal(now, s, axes, lines, free, near)

    def moved(s: _State, step: Array, own: Array) -> _State:
        count = free.shape[1]
        turn = rotations.exp(step[count:])
        return _State(s.params + free @ step[:count], turn @ s.rotation, s.angles + own[:, 0], s.square)

    return minimise(linearise, moved, state, STEPS)


def _normal(
    at: tuple[Array, Array, Array], s: _State, axes: Array, lines: Lines, free: Array, near: Nearest
) -> BlockNormal:
    d, _, by_params = at
    n, turned = _normals(s, axes)
    n, turned = n[lines.line], turned[lines.line]
    by_lens = np.einsum("ni,nip->np", n, by_params) @ free
    shared = np.concatenate([by_lens, np.cross(n, d)], 1) * near.weight[:, None]
    own = ((turned * d).sum(1) * near.weight)[:, None]
    residual = (n * d).sum(1) * near.weight + near.distance
    return BlockNormal.of_groups(residual, shared, own, lines.line, len(lines))


def _scene(
    lines: Lines,
    roots: Array,
    vote: Vote,
    camera: Camera,
    free: Array,
    fitted: Fitted[_State],
    axes: Array,
    start: Camera,
) -> Scene | None:
    state = fitted.state
    found = replace(camera, params=state.params)
    at = line_rays(found, lines.uv)
    if at is None:
        return None
    n = _normals(state, axes)[0][lines.line]
    off = (n * at[0]).sum(1) / slopes(at, n)
    freedom = max(len(off) - len(lines) - free.shape[1] - 3, 1)
    covariance = _clustered(fitted.normal, at, state, axes, lines, free, n, roots, vote.growth)
    count = free.shape[1]
    fixed = tuple(name for name, row in zip(camera.lens.names, free, strict=True) if not row.any())
    return Scene(
        found,
        start,
        free @ covariance[:count, :count] @ free.T,
        state.rotation,
        np.sqrt(np.maximum(np.diagonal(covariance)[count:], 0)),
        vote.family,
        float(np.sqrt(off @ off / freedom)),
        fixed,
        (),
    )


def _clustered(
    normal: BlockNormal,
    at: tuple[Array, Array, Array],
    s: _State,
    axes: Array,
    lines: Lines,
    free: Array,
    n: Array,
    roots: Array,
    growth: float,
) -> Array:
    """The covariance of camera and rotation with the lines, not the points, as what is independent.

    A line that is not quite in its direction, or not quite straight, is off as a whole. The sandwich of the scores of
    the lines (White, Econometrica 50, 1982) holds whatever the errors inside a line; L / (L - p) corrects for the
    parameters.
    """
    weight = roots / slopes(at, n)
    reduced = np.linalg.pinv(normal.reduced(), hermitian=True)
    d = at[0]
    turned = _normals(s, axes)[1][lines.line]
    by_lens = np.einsum("ni,nip->np", n, at[2]) @ free
    shared = np.concatenate([by_lens, np.cross(n, d)], 1) * weight[:, None]
    own = (turned * d).sum(1) * weight
    residual = (n * d).sum(1) * weight
    squares = np.maximum(np.bincount(lines.line, own**2, len(lines)), np.finfo(float).tiny)
    gain = np.stack([np.bincount(lines.line, own * c, len(lines)) for c in shared.T], 1) / squares[:, None]
    alone = (
        shared - own[:, None] * gain[lines.line]
    )  # what is left of the shared part beside the line's own angle
    scores = np.stack([np.bincount(lines.line, residual * c, len(lines)) for c in alone.T], 1)
    factor = len(lines) / max(len(lines) - shared.shape[1], 1) / growth**2
    return factor * reduced @ (scores.T @ scores) @ reduced
