"""Homographies of many views at once, on normalised coordinates.

The equations of a homography fall into three blocks, one per row, that share a single matrix of second
moments. The two upper rows are eliminated, which leaves a 3x3 problem per view (Harker & O'Leary,
Computation of Homographies, BMVC 2005); the moments of all views come from one batched product.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from camcal.geometry import projective

Array = np.ndarray

#: Where x_i x_j stands in the list of the six different products of (x, y, 1).
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
    """Homographies as `homographies` gives them, with what is needed to judge them.

    Returns
    -------
    h : (V, 3, 3) array
    gap : (V,) array
        The second smallest singular value of the (reduced) equations against the largest; near 0 where the
        points leave more than one homography.
    cost : (V,) array
        Weighted sum of squared residuals, px².
    """
    t_xy, t_uv = projective.normalisation(xy), projective.normalisation(uv)
    x = _similar(t_xy, xy)
    y = _similar(t_uv, uv)
    w = np.ones(x.shape[::2]) if weights is None else weights / weights.mean(-1, keepdims=True)
    products = x[:, _FIRST] * x[:, _SECOND]
    with np.errstate(all="ignore"):  # degenerate views become NaN here and show in the gap
        h, gap = _algebraic(products, y, w)
        residual, u, depth = _residuals(h, x, y)
        cost = np.einsum("vn,vkn,vkn->v", w, residual, residual)
        for _ in range(steps):
            trial = h + _gauss_newton(h, x, products, residual, u, depth, w)
            new_residual, new_u, new_depth = _residuals(trial, x, y)
            new_cost = np.einsum("vn,vkn,vkn->v", w, new_residual, new_residual)
            better = new_cost < cost
            if not better.any():
                break
            pick = better[:, None, None]
            h, residual = np.where(pick, trial, h), np.where(pick, new_residual, residual)
            u, depth = np.where(pick, new_u, u), np.where(better[:, None], new_depth, depth)
            cost = np.where(better, new_cost, cost)
        h = h * np.where(h[:, 2:, 2:] < 0, -1.0, 1.0)
        scale = t_uv[:, 0, 0] ** 2 / (1.0 if weights is None else weights.mean(-1))
        h = np.linalg.inv(t_uv) @ h @ t_xy
        return h / np.linalg.norm(h, axis=(1, 2), keepdims=True), gap, cost / scale


def covariances(h: Array, xy: Array, uv: Array, weights: Array | None = None) -> Array:
    """Covariances (V, 9, 9) of the entries of homographies, by rows, at the scale h (V, 3, 3) has.

    First order, from the Gauss-Newton normal matrix, for points whose coordinates have the variance 1 /
    weight (1 px² without weights). The scale of h is the gauge: it does not vary.
    """
    t_xy, t_uv = projective.normalisation(xy), projective.normalisation(uv)
    back = np.linalg.inv(t_uv)
    x = _similar(t_xy, xy)
    image = (t_uv @ h @ np.linalg.inv(t_xy)) @ x
    h3 = np.linalg.inv(np.swapaxes(t_xy, 1, 2)) @ h[:, 2, :, None]
    q = (1.0 if weights is None else weights) / image[:, 2] ** 2
    u, v = image[:, :2].swapaxes(0, 1) / image[:, 2]
    s, su, sv, sr = _normal_blocks(x[:, _FIRST] * x[:, _SECOND], q, u, v)
    inverse = _solve(s, np.broadcast_to(np.eye(3), s.shape))
    to_h1, to_h2 = inverse @ su, inverse @ sv
    reduced = sr - su @ to_h1 - sv @ to_h2
    third = _solve(_gauged(reduced, h3[..., 0]), np.broadcast_to(np.eye(3), s.shape))
    unit = h3 / np.linalg.norm(h3, axis=1, keepdims=True)
    free = np.eye(3) - unit @ np.swapaxes(unit, 1, 2)
    third = free @ third @ free
    through = np.concatenate([to_h1, to_h2, np.broadcast_to(np.eye(3), s.shape)], 1)
    covariance = through @ third @ np.swapaxes(through, 1, 2)
    covariance[:, :3, :3] += inverse
    covariance[:, 3:6, 3:6] += inverse
    # rows of H in px: H = back H' t_xy, so its entries are (back x t_xyᵀ) those of H'
    to_px = np.einsum("vij,vlk->vikjl", back, t_xy).reshape(-1, 9, 9)
    return t_uv[:, 0, 0, None, None] ** 2 * (to_px @ covariance @ np.swapaxes(to_px, 1, 2))


def by_count(counts: Iterable[int]) -> Iterator[Array]:
    """Indices of the views that hold the same number of points, one array per number."""
    numbers = np.fromiter(counts, int)
    for count in np.unique(numbers):
        yield np.flatnonzero(numbers == count)


def transfer(h: Array, xy: Array) -> Array:
    """Images (V, N, 2) of the points (V, N, 2) under homographies (V, 3, 3)."""
    return projective.dehomogenise(projective.homogeneous(xy) @ np.swapaxes(h, -1, -2))


def _similar(t: Array, points: Array) -> Array:
    """Normalised homogeneous coordinates, laid out (V, 3, N) so that the long axis is contiguous."""
    out = np.ones((points.shape[0], 3, points.shape[1]))
    out[:, :2] = np.swapaxes(points, 1, 2) * t[:, 0, 0, None, None] + t[:, :2, 2:]
    return out


def _normal_blocks(products: Array, q: Array, u: Array, v: Array) -> Array:
    """Second moments Σ f x xᵀ for f = q, qu, qv, q(u² + v²), as (4, V, 3, 3); products are (V, 6, N)."""
    factors = np.empty((len(q), 4, q.shape[1]))
    factors[:, 0], factors[:, 1], factors[:, 2] = q, q * u, q * v
    factors[:, 3] = factors[:, 1] * u + factors[:, 2] * v
    return np.moveaxis((factors @ np.swapaxes(products, 1, 2))[:, :, _SYMMETRIC], 1, 0)


def _gauged(reduced: Array, h3: Array) -> Array:
    """The reduced normal matrix (V, 3, 3), singular along h3 (V, 3), made regular there."""
    unit = h3 / np.linalg.norm(h3, axis=-1, keepdims=True)
    size = np.einsum("vii->v", reduced)
    return reduced + size[:, None, None] * unit[:, :, None] * unit[:, None, :]


def _algebraic(products: Array, y: Array, w: Array) -> tuple[Array, Array]:
    """Minimise Σ w |(h1·x - u h3·x, h2·x - v h3·x)|² with |h3| = 1; also the gap of the reduced equations."""
    u, v = y[:, 0], y[:, 1]
    s, su, sv, sr = _normal_blocks(products, w, u, v)
    upper = _solve(s, np.concatenate([su, sv], -1))
    to_h1, to_h2 = upper[..., :3], upper[..., 3:]
    reduced = sr - su @ to_h1 - sv @ to_h2
    finite = np.isfinite(reduced).all((1, 2))
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], reduced, 0.0))
    h3 = vectors[..., 0]
    gap = np.sqrt(np.maximum(values[:, 1], 0) / np.maximum(values[:, 2], np.finfo(float).tiny))
    h = np.stack([np.einsum("vij,vj->vi", m, h3) for m in (to_h1, to_h2)] + [h3], 1)
    return h, np.where(finite, gap, 0.0)


def _residuals(h: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Predicted - observed (V, 2, N), the predictions, and the depths (V, N)."""
    image = h @ x
    predicted = image[:, :2] / image[:, 2:]
    return predicted - y[:, :2], predicted, image[:, 2]


def _gauss_newton(
    h: Array, x: Array, products: Array, residual: Array, predicted: Array, depth: Array, w: Array
) -> Array:
    """The Gauss-Newton step of the homographies, orthogonal to h in the third row (its scale is free)."""
    u, v = predicted[:, 0], predicted[:, 1]
    q = w / depth**2
    s, su, sv, sr = _normal_blocks(products, q, u, v)
    pull = residual * (w / depth)[:, None]
    g1, g2, g3 = np.moveaxis(
        np.stack([pull[:, 0], pull[:, 1], -u * pull[:, 0] - v * pull[:, 1]], 1) @ np.swapaxes(x, 1, 2), 1, 0
    )
    upper = _solve(s, np.concatenate([su, sv, g1[..., None], g2[..., None]], -1))
    reduced = sr - su @ upper[..., :3] - sv @ upper[..., 3:6]
    right = g3 + np.einsum("vij,vj->vi", su, upper[..., 6]) + np.einsum("vij,vj->vi", sv, upper[..., 7])
    step3 = -_solve(_gauged(reduced, h[:, 2]), right[..., None])[..., 0]
    step1 = np.einsum("vij,vj->vi", upper[..., :3], step3) - upper[..., 6]
    step2 = np.einsum("vij,vj->vi", upper[..., 3:6], step3) - upper[..., 7]
    return np.stack([step1, step2, step3], 1)


def _solve(a: Array, b: Array) -> Array:
    """Solve a x = b for symmetric (V, 3, 3) by the adjugate; NaN or inf where a is singular."""
    adjugate = np.stack(
        [
            np.cross(a[:, 1], a[:, 2]),
            np.cross(a[:, 2], a[:, 0]),
            np.cross(a[:, 0], a[:, 1]),
        ],
        -1,
    )
    determinant = np.einsum("vi,vi->v", a[:, 0], adjugate[..., 0])
    return (adjugate @ b) / determinant[:, None, None]
