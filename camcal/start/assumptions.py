"""Assumptions on K, from the fewest to the most, and the search for the first set that yields a camera.

Coordinates are the unit ones of `unit_coordinates`: origin at the image's centre, half its diagonal long.
"""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Correspondences
from camcal.records import dataclass
from camcal.start import conic

Array = np.ndarray

#: A singular value below this fraction of the largest possible one counts as 0, because of rounding.
UNDETERMINED = 1e-8
#: A focal length with a larger relative uncertainty is not considered determined.
UNCERTAIN = 0.2
#: The principal point of a plausible camera lies nearer to the image's centre, in half diagonals.
FAR_OUTSIDE = 2.0


@dataclass(frozen=True)
class Assumed:
    """A set of assumptions: `basis` (6, k) spans the b = (B11, B12, B22, B13, B23, B33) that they allow.

    `held` are the same under their `--fix` names, without the skew.
    """

    basis: Array
    assumptions: tuple[str, ...]
    held: tuple[str, ...] = ()

    @property
    def unknowns(self) -> int:
        """The number of entries of K that remain free."""
        return self.basis.shape[1] - 1


def _basis(*groups: tuple[int, ...]) -> Array:
    basis = np.zeros((6, len(groups)))
    for column, entries in enumerate(groups):
        basis[list(entries), column] = 1
    return basis


_CENTRE, _SQUARE = "the principal point is {centre}", "one focal length, fx = fy"
SETS = (
    Assumed(_basis((0,), (1,), (2,), (3,), (4,), (5,)), ()),
    Assumed(_basis((0,), (2,), (3,), (4,), (5,)), ("skew is 0",)),
    Assumed(_basis((0, 2), (3,), (4,), (5,)), ("skew is 0", _SQUARE), ("aspect",)),
    Assumed(_basis((0,), (2,), (5,)), ("skew is 0", _CENTRE), ("cx", "cy")),
    Assumed(_basis((0, 2), (5,)), ("skew is 0", _CENTRE, _SQUARE), ("aspect", "cx", "cy")),
)


@dataclass(frozen=True)
class Found:
    """K in unit coordinates, or None, and how it was obtained.

    Attributes
    ----------
    matrix : (3, 3) array or None
    assumptions : tuple of str
    held : tuple of str
        The assumed parameters of K under their `--fix` names, without the skew.
    rejected : tuple of str
        The weaker assumptions that were tried, each with the reason for its rejection.
    condition : float
        Of the equations that were solved.
    uncertainty : float
        Relative, of the focal length; see `conic.focal_uncertainty`.
    """

    matrix: Array | None = None
    assumptions: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    condition: float = np.inf
    uncertainty: float = np.inf


def unit_coordinates(correspondences: Correspondences) -> tuple[Array, str]:
    """The matrix (3, 3) from pixels to unit coordinates, and a description of its origin."""
    if correspondences.image_size is not None:
        size = np.array(correspondences.image_size, float)
        centre, where = (size - 1) / 2, "the centre of the image"
    else:
        low = np.min([v.uv.min(0) for v in correspondences.views], axis=0)
        high = np.max([v.uv.max(0) for v in correspondences.views], axis=0)
        size, centre = high - low, (low + high) / 2
        where = "the middle of all image points (no image size is known)"
    radius = np.hypot(*size) / 2
    return np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, radius]]) / radius, where


def climb(h: Array, covariances: Array, skew: bool, where: str, length: float = 1.0) -> Found:
    """K from homographies (V, 3, 3) with the fewest assumptions that give a real, plausible, well-determined camera.

    If none is certain, the least uncertain one is taken; if none is real, `matrix` is None.
    `covariances` (V, 9, 9) are those of the entries of h by rows; `where` describes the origin. A `length`
    other than 1 is a pixel in unit coordinates: b is then estimated in pixels, without the scaling.
    """
    equations = conic.constraints(h)
    columns = np.array([length**-2.0] * 3 + [1 / length] * 2 + [1.0])
    rejected: list[str] = []
    best = Found()
    for assumed in SETS[0 if skew else 1 :]:
        said = tuple(a.format(centre=where) for a in assumed.assumptions)
        label = ", ".join(said) or "nothing assumed"
        x, singular = conic.smallest((equations.reshape(-1, 6) * columns) @ assumed.basis)
        b = columns * (assumed.basis @ x)
        k, reason = _plausible(b, singular, assumed, len(h))
        if k is None:
            rejected.append(f"{label}: {reason}")
            continue
        uncertainty = conic.focal_uncertainty(b, assumed.basis, h, covariances, equations)
        if best.matrix is None or uncertainty < best.uncertainty:
            condition = float(singular[0] / singular[-2])
            best = Found(k, said, assumed.held, tuple(rejected), condition, uncertainty)
        if uncertainty <= UNCERTAIN:
            return best
        rejected.append(f"{label}: the focal length is uncertain by {uncertainty:.0%}")
    return best if best.matrix is not None else Found(rejected=tuple(rejected))


def climb_weighted(h: Array, covariances: Array, skew: bool, where: str) -> Found:
    """As `climb`, with each view's equations weighted by the inverse of their noise.

    A second attempt, for data in which views of little weight (small, distant boards) dominate the others. It is not
    the first choice, because with an undistorted model of a distorting lens the residuals are not dominated by noise.
    """
    guess = np.array([1.0, 0, 1, 0, 0, 1])  # f = half the diagonal: only the views' ratios matter
    noise = np.einsum("vii->v", conic.equation_noise(guess, h, covariances))
    scale = np.sqrt(np.sqrt(noise.min() / noise))[:, None, None]  # equations go with the square of h
    return climb(h * scale, covariances * scale**2, skew, where)


def _plausible(b: Array, singular: Array, assumed: Assumed, count: int) -> tuple[Array | None, str]:
    """K of a conic if it is determined, real and has its principal point near the image; otherwise the reason."""
    if 2 * count < assumed.unknowns:
        return None, f"{count} view{'s' * (count > 1)} do{'es' * (count == 1)} not determine it"
    if singular[-2] < UNDETERMINED * np.sqrt(count):
        return None, "the views do not determine it"
    k = conic.camera_matrix(b)
    if k is None:
        return None, "no real camera fits (the conic is not positive definite)"
    if np.abs(k[:2, 2]).max() > FAR_OUTSIDE:
        return None, "the estimated principal point is far outside the image"
    return k, ""
