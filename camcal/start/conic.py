"""The image of the absolute conic: its constraints from homographies, K from it, and the uncertainty of K.

Numbers in parentheses are those of docs/closed-forms.md.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: Index of Bij in b = (B11, B12, B22, B13, B23, B33), Zhang's order.
_ORDER = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
#: d B / d b, (6, 3, 3): 1 where Bij is that entry of b
_ENTRIES = (np.arange(6)[:, None, None] == _ORDER).astype(float)
#: d (h1 + i h2) / d h by rows of H, for each row
_CIRCULAR = np.array([1, 1j, 0])


def constraints(h: Array) -> Array:
    """The two equations (9) that each homography gives on B = K⁻ᵀ K⁻¹ (Zhang 2000, eqs. 3-8).

    The image of the plane's circular points, c = h1 + i h2, lies on the conic: cᵀ B c = 0. The real part is
    h1ᵀBh1 - h2ᵀBh2, the imaginary part 2 h1ᵀBh2; with the factor 2 the sum of their squares does not depend
    on the choice of axes in the plane.

    Parameters
    ----------
    h : (V, 3, 3) array

    Returns
    -------
    (V, 2, 6) array of coefficients of b
    """
    c0, c1, c2 = np.moveaxis(h[..., 0] + 1j * h[..., 1], -1, 0)
    q = np.stack([c0 * c0, 2 * c0 * c1, c1 * c1, 2 * c0 * c2, 2 * c1 * c2, c2 * c2], -1)
    return np.stack([q.real, q.imag], 1)


def smallest(equations: Array) -> tuple[Array, Array]:
    """The unit vector x that minimises |A x| (10) for A (M, k), and all k singular values, descending."""
    _, singular, vt = np.linalg.svd(_padded(equations), full_matrices=False)
    return vt[-1], singular


def _padded(a: Array) -> Array:
    """Append zero rows to A (M, k) if it has fewer rows than columns."""
    return np.concatenate([a, np.zeros((max(a.shape[1] - len(a), 0), a.shape[1]))])


def camera_matrix(b: Array) -> Array | None:
    """K from b (6,), of any scale and sign; None if B is not positive definite.

    B = λ K⁻ᵀ K⁻¹ is factored by Cholesky (11), which is equivalent to the formulas in Zhang's appendix B.
    """
    conic = b[_ORDER]
    try:
        lower = np.linalg.cholesky(conic * np.sign(conic[2, 2]))
    except np.linalg.LinAlgError:
        return None
    k = np.linalg.inv(lower.T)
    return k / k[2, 2]


def equation_noise(b: Array, h: Array, covariances: Array) -> Array:
    """Covariances (V, 2, 2) of the constraints' residuals at b (6,), from those of the entries of h."""
    gradient = np.einsum("vrij,i->vrj", _coefficient_jacobian(h), b)
    return gradient @ covariances @ np.swapaxes(gradient, 1, 2)


def focal_uncertainty(
    b: Array, basis: Array, h: Array, covariances: Array, equations: Array | None = None
) -> float:
    """The relative uncertainty of the less certain focal length: standard deviation and bias combined.

    Both are to first order (13), for the b that minimises |A b| with |b| = 1. The noise of the homographies
    determines the covariance of the equations' residuals, and adds M = E(dAᵀ dA) to AᵀA, which biases b by
    -(AᵀA)⁺ M b. This bias is the larger part if the planes are hardly tilted.

    Parameters
    ----------
    b : (6,) array
        The estimate, in the span of `basis` (6, k).
    h : (V, 3, 3) array
    covariances : (V, 9, 9) array
        Of the entries of h by rows.
    equations : (V, 2, 6) array, optional
        The `constraints` of h, if already computed.

    Returns
    -------
    float
        The deviation is multiplied by the root of the reduced chi-square of the equations if that exceeds 1, to
        include effects other than noise (distortion, failure of the first-order approximation).
        inf if the equations do not determine b.
    """
    jacobian = _coefficient_jacobian(h)
    gradient = np.einsum("vrij,i->vrj", jacobian, b)  # of the residuals, with respect to the entries of h
    spread = gradient @ covariances
    noise = spread @ np.swapaxes(gradient, 1, 2)
    a = (constraints(h) if equations is None else equations) @ basis
    x = (b @ basis) / (basis * basis).sum(0)  # the columns are orthogonal
    tangent = np.linalg.svd(x[None], full_matrices=True)[2][1:].T  # the scale of b is free
    along = a @ tangent
    _, singular, vt = np.linalg.svd(_padded(along.reshape(-1, along.shape[2])), full_matrices=False)
    if singular[-1] <= np.finfo(float).eps * singular[0]:
        return np.inf
    to_focal = _log_focal_jacobian(b) @ basis @ tangent @ (vt.T / singular**2) @ vt
    # the estimate's response to the residuals of each view, (V, 2 focal lengths, 2 residuals)
    response = np.swapaxes(along @ to_focal.T, 1, 2)
    variance = np.einsum("vfr,vrs,vfs->f", response, noise, response)
    dragged = np.einsum("vrij,vrj->i", jacobian, spread)
    bias = to_focal @ tangent.T @ basis.T @ dragged
    return float(np.sqrt(variance * _misfit(a @ x, noise, len(x) - 1) + bias**2).max())


def _misfit(residuals: Array, noise: Array, unknowns: int) -> float:
    """The reduced chi-square of residuals (V, 2) of covariances (V, 2, 2), at least 1."""
    surplus = residuals.size - unknowns
    if surplus <= 0:
        return 1.0
    floor = np.finfo(float).eps * np.einsum("vii->v", noise).max() + np.finfo(float).tiny
    solved = np.linalg.solve(noise + floor * np.eye(2), residuals[..., None])[..., 0]
    return max(float((residuals * solved).sum()) / surplus, 1.0)


def _coefficient_jacobian(h: Array) -> Array:
    """Derivatives (V, 2, 6, 9) of the constraints' coefficients with respect to the entries of h by rows."""
    c = h[..., 0] + 1j * h[..., 1]
    # qᵢ = cᵀ Eᵢ c, so that dqᵢ/dc = 2 Eᵢ c
    by_c = 2 * np.einsum("ijk,vk->vij", _ENTRIES, c)
    by_h = (by_c[..., None] * _CIRCULAR).reshape(-1, 6, 9)
    return np.stack([by_h.real, by_h.imag], 1)


def _log_focal_jacobian(b: Array) -> Array:
    """d (log fx, log fy) / d b (2, 6), from B = λ K⁻ᵀ K⁻¹.

    With ω = B⁻¹ ~ K Kᵀ: fy² = (ω22 ω33 - ω23²) / ω33², and fx² fy² = det ω / ω33³.
    """
    omega = np.linalg.inv(b[_ORDER])
    d = -omega @ _ENTRIES @ omega
    minor = omega[1, 1] * omega[2, 2] - omega[1, 2] ** 2
    d_minor = d[:, 1, 1] * omega[2, 2] + omega[1, 1] * d[:, 2, 2] - 2 * omega[1, 2] * d[:, 1, 2]
    d_last = d[:, 2, 2] / omega[2, 2]
    d_fy = d_minor / minor - 2 * d_last
    # d log det ω = tr(ω⁻¹ dω) = -tr(Eᵢ ω)
    d_both = -np.einsum("ijk,kj->i", _ENTRIES, omega) - 3 * d_last
    return 0.5 * np.stack([d_both - d_fy, d_fy])
