"""Homographies of many views at once, in normalised coordinates.

The equations of a homography fall into three blocks, one per row, that share a single matrix of second
moments. The two upper rows are eliminated, which leaves a 3x3 problem per view (Harker & O'Leary,
Computation of Homographies, BMVC 2005; docs/closed-forms.md, eqs. 7 and 8); the moments of all views come
from one batched product.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from camcal.geometry import projective
from camcal.geometry.numbers import distinct
from camcal.records import dataclass

Array = np.ndarray

#: The index of x_i x_j in the list of the six different products of (x, y, 1).
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_FIRST, _SECOND = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def homographies(xy: Array, uv: Array, weights: Array | None = None, steps: int = 1) -> Array:
    """Homographies H of views with the same number of points, uv ~ H (x, y, 1).

    An algebraic estimate on coordinates normalised as by Hartley, then Gauss-Newton steps on the reprojection
    error: these restore the digits that forming second moments costs, and with noise lead to the maximum
    likelihood estimate (Hartley & Zisserman, sections 4.4.4 and 4.5).

    Parameters
    ----------
    xy : (V, N, 2) array
        Points of the plane, N >= 4, not on a line.
    uv : (V, N, 2) array
        Their images, px.
    weights : (V, N) array, optional
        1 / sigma² of each point.
    steps : int
        Gauss-Newton steps; one that does not lower the error of a view is not taken there.

    Returns
    -------
    (V, 3, 3) array of unit Frobenius norm, with a positive depth (third coordinate) at the points' centroid.
    """
    return solve(xy, uv, weights, steps)[0]


def solve(xy: Array, uv: Array, weights: Array | None = None, steps: int = 2) -> tuple[Array, Array, Array]:
    """Return homographies as `homographies` does, together with the quantities that judge them; see
    `Equations.solve`.
    """
    return Equations.of(xy, uv, weights).solve(steps)


@dataclass(frozen=True)
class Equations:
    """Points of V views in normalised coordinates, with the points along the contiguous axis.

    Attributes
    ----------
    x : (V, 3, N) array
        Homogeneous points of the plane.
    y : (V, 3, N) array
        Homogeneous image points.
    products : (V, 6, N) array
        The different products of two coordinates of x.
    w : (V, N) array
        Weights.
    t_xy, t_uv : (V, 3, 3) arrays
        The normalising similarities.
    """

    x: Array
    y: Array
    products: Array
    w: Array
    t_xy: Array
    t_uv: Array

    @classmethod
    def of(cls, xy: Array, uv: Array, weights: Array | None = None, normalise: bool = True) -> Equations:
        """Normalise points xy (V, N, 2), their images uv (V, N, 2) and take weights (V, N) = 1 / sigma²."""
        if normalise:
            t_xy, t_uv = projective.normalisation(xy), projective.normalisation(uv)
        else:
            t_xy = t_uv = np.broadcast_to(np.eye(3), (len(xy), 3, 3))
        x = _similar(t_xy, xy)
        w = np.ones(xy.shape[:2]) if weights is None else weights
        return cls(x, _similar(t_uv, uv), x[:, _FIRST] * x[:, _SECOND], w, t_xy, t_uv)

    def solve(self, steps: int) -> tuple[Array, Array, Array]:
        """Return the algebraic estimate improved by Gauss-Newton steps; steps that do not lower a view's error are
        rejected.

        Returns
        -------
        h : (V, 3, 3) array
        gap : (V,) array
            The second smallest singular value of the reduced equations against the size of the unreduced
            ones; near 0 where the points leave more than one homography.
        cost : (V,) array
            Weighted sum of squared residuals, px².
        """
        with np.errstate(all="ignore"):  # degenerate views become NaN here and show in the gap
            h, gap = self._algebraic()
            state: tuple[Array, ...] = self._residuals(h)
            for _ in range(steps):
                trial = h + self._gauss_newton(h, *state[:3])
                new = self._residuals(trial)
                better = new[3] < state[3]
                if not better.any():
                    break
                if better.all():
                    h, state = trial, new
                else:
                    pick = better[:, None, None]
                    h = np.where(pick, trial, h)
                    state = tuple(np.where(_like(better, a), a, b) for a, b in zip(new, state, strict=True))
            depth = np.einsum("vk,vk->v", h[:, 2], self.x.mean(-1))  # of the centroid
            h = h * np.where(depth < 0, -1.0, 1.0)[:, None, None]
            h = np.linalg.inv(self.t_uv) @ h @ self.t_xy
            h = h / np.linalg.norm(h, axis=(1, 2), keepdims=True)
            return h, gap, state[3] / self.t_uv[:, 0, 0] ** 2

    def covariances(self, h: Array) -> Array:
        """Covariances (V, 9, 9) of the entries of homographies, by rows, at the scale h (V, 3, 3) has.

        First order, from the Gauss-Newton normal matrix, for image coordinates of variance 1 / weight (1 px²
        without weights). The scale of h is the gauge: it does not vary.
        """
        back = np.linalg.inv(self.t_uv)
        normalised = self.t_uv @ h @ np.linalg.inv(self.t_xy)
        image = normalised @ self.x
        u, v = image[:, 0] / image[:, 2], image[:, 1] / image[:, 2]
        s, su, sv, sr = self._normal_blocks(self.w / image[:, 2] ** 2, u, v)
        eye = np.broadcast_to(np.eye(3), s.shape)
        inverse = _solve(s, eye)
        to_h1, to_h2 = inverse @ su, inverse @ sv
        unit = normalised[:, 2, :, None] / np.linalg.norm(normalised[:, 2], axis=1)[:, None, None]
        free = eye - unit @ np.swapaxes(unit, 1, 2)
        third = free @ _solve(_gauged(sr - su @ to_h1 - sv @ to_h2, normalised[:, 2]), eye) @ free
        through = np.concatenate([to_h1, to_h2, eye], 1)
        covariance = through @ third @ np.swapaxes(through, 1, 2)
        covariance[:, :3, :3] += inverse
        covariance[:, 3:6, 3:6] += inverse
        # H in px is back H' t_xy; its entries, by rows, are (back x t_xyᵀ) times those of H'
        to_px = (back[:, :, None, :, None] * np.swapaxes(self.t_xy, 1, 2)[:, None, :, None, :]).reshape(
            -1, 9, 9
        )
        return self.t_uv[:, :1, :1] ** 2 * (to_px @ covariance @ np.swapaxes(to_px, 1, 2))

    def _normal_blocks(self, q: Array, u: Array, v: Array) -> Array:
        """Second moments Σ f x xᵀ for f = q, qu, qv, q(u² + v²), as (4, V, 3, 3)."""
        factors = np.empty((len(q), 4, q.shape[1]))
        factors[:, 0], factors[:, 1], factors[:, 2] = q, q * u, q * v
        factors[:, 3] = factors[:, 1] * u + factors[:, 2] * v
        moments = factors @ np.swapaxes(self.products, 1, 2)
        return np.moveaxis(moments[:, :, _SYMMETRIC], 1, 0)

    def _algebraic(self) -> tuple[Array, Array]:
        """Minimise Σ w |(h1·x - u h3·x, h2·x - v h3·x)|² with |h3| = 1; also the gap of the equations."""
        s, su, sv, sr = self._normal_blocks(self.w, self.y[:, 0], self.y[:, 1])
        upper = _solve(s, np.concatenate([su, sv], -1))
        to_h1, to_h2 = upper[..., :3], upper[..., 3:]
        reduced = sr - su @ to_h1 - sv @ to_h2
        finite = np.isfinite(reduced).all((1, 2))
        values, vectors = np.linalg.eigh(np.where(finite[:, None, None], reduced, 0.0))
        h3 = vectors[..., :1]
        # against the equations before the elimination: of three points nothing but rounding is left after it
        gap = np.sqrt(np.maximum(values[:, 1], 0) / np.einsum("vii->v", sr))
        h = np.swapaxes(np.concatenate([to_h1 @ h3, to_h2 @ h3, h3], 2), 1, 2)
        return h, np.where(finite, gap, 0.0)

    def _residuals(self, h: Array) -> tuple[Array, Array, Array, Array]:
        """Predicted - observed (V, 2, N), predictions, depths (V, N), weighted sums of squares (V,)."""
        image = h @ self.x
        predicted = image[:, :2] / image[:, 2:]
        residual = predicted - self.y[:, :2]
        return residual, predicted, image[:, 2], np.einsum("vn,vkn,vkn->v", self.w, residual, residual)

    def _gauss_newton(self, h: Array, residual: Array, predicted: Array, depth: Array) -> Array:
        """The Gauss-Newton step of the homographies, orthogonal to h in the third row (its scale is free)."""
        u, v = predicted[:, 0], predicted[:, 1]
        s, su, sv, sr = self._normal_blocks(self.w / depth**2, u, v)
        pulls = np.empty((len(u), 3, u.shape[1]))
        pulls[:, :2] = residual * (self.w / depth)[:, None]
        pulls[:, 2] = -u * pulls[:, 0] - v * pulls[:, 1]
        g = pulls @ np.swapaxes(self.x, 1, 2)
        upper = _solve(s, np.concatenate([su, sv, g[:, 0, :, None], g[:, 1, :, None]], -1))
        to_h1, to_h2, first, second = upper[..., :3], upper[..., 3:6], upper[..., 6:7], upper[..., 7:]
        reduced = sr - su @ to_h1 - sv @ to_h2
        right = g[:, 2, :, None] + su @ first + sv @ second
        third = -_solve(_gauged(reduced, h[:, 2]), right)
        return np.swapaxes(np.concatenate([to_h1 @ third - first, to_h2 @ third - second, third], 2), 1, 2)


def by_count(counts: Iterable[int]) -> Iterator[Array]:
    """Indices of the views that hold the same number of points, one array per number."""
    numbers = np.fromiter(counts, int)
    for count in distinct(numbers):
        yield np.flatnonzero(numbers == count)


def transfer(h: Array, xy: Array) -> Array:
    """Images (V, N, 2) of the points (V, N, 2) under homographies (V, 3, 3)."""
    return projective.dehomogenise(projective.homogeneous(xy) @ np.swapaxes(h, -1, -2))


def within_quads(quads: Array, at: Array) -> tuple[Array, Array]:
    """The points of squares that are seen as quadrilaterals (K, 4, 2): their x and y, (K, n, n) each.

    The homography from the unit square has a closed form (Heckbert, Fundamentals of Texture Mapping and Image Warping,
    1989, section 2.2.3).

    Parameters
    ----------
    quads : (K, 4, 2) array
        Images of the corners (0, 0), (1, 0), (1, 1), (0, 1).
    at : (n,) array
        Fractions of the sides; the second along the first axis of a result, the first along its second one.
    """
    p0, p1, p2, p3 = quads.transpose(1, 2, 0)  # (2, K) each
    one, other, total = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    with np.errstate(all="ignore"):  # NaN where three corners lie on a line
        area = one[0] * other[1] - other[0] * one[1]
        g = (total[0] * other[1] - other[0] * total[1]) / area
        h = (one[0] * total[1] - total[0] * one[1]) / area
        across, down = (p1 - p0 + g * p1)[..., None], (p3 - p0 + h * p3)[..., None, None]
        depth = (g[:, None] * at + 1)[:, None] + h[:, None, None] * at[:, None]
        x, y = ((across * at + p0[..., None])[:, :, None] + down * at[:, None]) / depth
    return x, y


def _similar(t: Array, points: Array) -> Array:
    """Return normalised homogeneous coordinates, laid out (V, 3, N) so that the long axis is contiguous."""
    out = np.ones((points.shape[0], 3, points.shape[1]))
    out[:, :2] = np.swapaxes(points, 1, 2) * t[:, 0, 0, None, None] + t[:, :2, 2:]
    return out


def _gauged(reduced: Array, h3: Array) -> Array:
    """Return the reduced normal matrix (V, 3, 3), singular along h3 (V, 3), regularised in that direction."""
    unit = h3 / np.linalg.norm(h3, axis=-1, keepdims=True)
    size = np.einsum("vii->v", reduced)
    return reduced + size[:, None, None] * unit[:, :, None] * unit[:, None, :]


def _like(mask: Array, values: Array) -> Array:
    """Return a mask (V,) reshaped to select views of values (V, ...)."""
    return mask.reshape(-1, *[1] * (values.ndim - 1))


def _solve(a: Array, b: Array) -> Array:
    """Solve a x = b for symmetric (V, 3, 3) by the adjugate; NaN or inf where a is singular."""
    (p, q, r), (t, u), v = a[:, 0].T, a[:, 1, 1:].T, a[:, 2, 2]
    adjugate = np.empty_like(a)
    adjugate[:, 0, 0], adjugate[:, 1, 1], adjugate[:, 2, 2] = t * v - u * u, p * v - r * r, p * t - q * q
    adjugate[:, 0, 1] = adjugate[:, 1, 0] = r * u - q * v
    adjugate[:, 0, 2] = adjugate[:, 2, 0] = q * u - r * t
    adjugate[:, 1, 2] = adjugate[:, 2, 1] = q * r - p * u
    determinant = p * adjugate[:, 0, 0] + q * adjugate[:, 0, 1] + r * adjugate[:, 0, 2]
    return (adjugate @ b) / determinant[:, None, None]
