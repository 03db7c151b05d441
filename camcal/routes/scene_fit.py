"""The fit behind `scene`: the assignment of lines to directions, and the joint fit of camera, attitude and lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares.blocks import BlockNormal, Fitted, minimise
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes.line_geometry import Lines, Nearest, line_rays, nearest_points, slopes, tangents
from camcal.routes.scene_vote import LEAST_LINES, Vote
from camcal.solve.parameters import free_matrix

SQUARE = np.eye(3)  #: orthogonal directions

#: of the picture's width; lines of one direction closer than this share their errors (one wall, one table, one
#: pattern), the less the farther apart they are
REACH = 0.2
#: 1 - leverage of a line below which its residuals say nothing: it alone determines what it is asked for, and rounding
#: decides. A residual of 1 px is then taken for an error of 10.
LEAST_LEFT = 0.01
#: steps of a fit: fewer than ten are needed from a plausible start if the lines determine anything
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
    likelihood : float
        The logarithm of that of the lines' directions (`families`).
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
    likelihood: float
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


@dataclass(frozen=True)
class _State:
    params: Array
    rotation: Array
    angles: Array
    square: Array  #: (3, 3) the directions in the scene, columns; the identity if they are orthogonal


def fit_scene(
    lines: Lines,
    camera: Camera,
    rotation: Array,
    vote: Vote,
    fix: Mapping[str, float | None],
    start: Camera,
    square: Array = SQUARE,
) -> Scene | None:
    """Camera, rotation and line angles from a start; None if a line leaves the domain of the lens.

    `square` (3, 3) holds the directions in the scene as columns, if they are not orthogonal.
    """
    chosen = np.flatnonzero(vote.family >= 0)
    own = lines.take(chosen)
    axes = vote.family[chosen]
    free = free_matrix(camera.lens, camera.params, dict(fix))
    at = line_rays(camera, own.uv)
    if at is None:
        return None
    state = _State(camera.params, rotation, np.zeros(len(own)), square)
    state = replace(state, angles=_angles(at[0], own, state, axes))
    fitted = _round(own, camera.lens, free, axes, state, vote.roots[chosen][own.line])
    if fitted is None:
        return None
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
    """Two unit vectors (L, 3) of the scene orthogonal to each line's direction and to each other."""
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
        vote.likelihood,
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
    """The covariance of camera and rotation with independent lines instead of independent points.

    A line that deviates from its direction, or is not quite straight, deviates as a whole, and the deviations of
    neighbouring lines are correlated. The sandwich of the scores of the lines (White, Econometrica 50, 1982) holds
    whatever the errors inside a line. Residuals are smaller than errors, the more so the fewer lines determine a
    parameter: they are divided by the root of 1 - leverage (Bell & McCaffrey, Survey Methodology 28, 2002, "bias
    reduced linearization"). Products of near lines (Conley, Journal of Econometrics 92, 1999) are added only in
    directions in which they enlarge the covariance: common errors do; where the sum is negative, it is the correlation
    that the fit itself causes. Without these two rules the standard deviations are 10 % too small for independent
    lines (docs/routes.md).
    """
    weight = roots / slopes(at, n)
    d = at[0]
    turned = _normals(s, axes)[1][lines.line]
    by_lens = np.einsum("ni,nip->np", n, at[2]) @ free
    shared = np.concatenate([by_lens, np.cross(n, d)], 1) * weight[:, None]
    own = (turned * d).sum(1) * weight
    residual = (n * d).sum(1) * weight
    squares = np.maximum(_sums(own**2, lines), np.finfo(float).tiny)
    gain = _sums(own[:, None] * shared, lines) / squares[:, None]
    # what is left of the shared part beside the line's own angle, in units in which the normal matrix is the identity
    unit = _inverse_root(normal.reduced())
    alone = (shared - own[:, None] * gain[lines.line]) @ unit
    scores = _sums(residual[:, None] * alone, lines)
    scores = np.einsum("lij,lj->li", _corrections(_sums(alone[:, :, None] * alone[:, None], lines)), scores)
    each = scores.T @ scores
    near, directions = np.linalg.eigh(scores.T @ _shared(lines, axes) @ scores - each)
    together = (directions * np.maximum(near, 0)) @ directions.T
    return unit @ (each + together) @ unit.T / growth**2


def _sums(values: Array, lines: Lines) -> Array:
    """Sums (L, ...) over the points of each line."""
    total = np.zeros((len(lines), *values.shape[1:]))
    np.add.at(total, lines.line, values)
    return total


def _inverse_root(normal: Array) -> Array:
    """U with U Uᵀ the pseudo-inverse of a normal matrix, with the limit of `numpy.linalg.matrix_rank`."""
    values, vectors = np.linalg.eigh(normal)
    known = values > len(values) * np.finfo(float).eps * np.abs(values).max()
    return vectors[:, known] / np.sqrt(values[known])


def _corrections(leverage: Array) -> Array:
    """(I - H)^(-1/2) (L, P, P) of the leverage of each line; a line that alone determines a direction has none left."""
    values, vectors = np.linalg.eigh(leverage)
    left = np.maximum(1 - values, LEAST_LEFT)
    return (vectors / np.sqrt(left)[:, None]) @ vectors.swapaxes(1, 2)


def _shared(lines: Lines, axes: Array) -> Array:
    """The degree (L, L) to which two lines share their errors: those of one direction that are close to each other."""
    assert lines.image_size is not None
    counts = np.bincount(lines.line, minlength=len(lines))
    middle = np.stack([np.bincount(lines.line, x, len(lines)) / counts for x in lines.uv.T], 1)
    apart = np.abs(middle[:, None] - middle[None]) / (REACH * max(lines.image_size))
    return np.where(axes[:, None] == axes, np.maximum(1 - apart, 0).prod(2), 0.0)
