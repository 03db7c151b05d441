"""The image of the absolute conic: what homographies say about it, K from it, and how well they determine it.

Numbers in parentheses are those of docs/closed-forms.md.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: Where Bij stands in b = (B11, B12, B22, B13, B23, B33), Zhang's order.
_ORDER = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])


def constraints(h: Array) -> Array:
    """The two equations that each homography gives on B = K⁻ᵀ K⁻¹ (Zhang 2000, eqs. 3-8).

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
    """The unit vector x that minimises |A x| for A (M, k), and all k singular values, descending."""
    k = equations.shape[1]
    padded = np.concatenate([equations, np.zeros((max(k - len(equations), 0), k))])
    _, singular, vt = np.linalg.svd(padded, full_matrices=False)
    return vt[-1], singular


def camera_matrix(b: Array) -> Array | None:
    """K from b (6,), of any scale and sign; None where B is not positive definite.

    B = λ K⁻ᵀ K⁻¹ is factored by Cholesky, which gives what Zhang's appendix B writes out.
    """
    conic = b[_ORDER]
    try:
        lower = np.linalg.cholesky(conic * np.sign(conic[2, 2]))
    except np.linalg.LinAlgError:
        return None
    k = np.linalg.inv(lower.T)
    return k / k[2, 2]


def equation_noise(b: Array, h: Array, covariances: Array) -> Array:
    """Covariances (V, 2, 2) of the equations at b, from those of the homographies' entries (V, 9, 9).

    d(cᵀBc) = 2 (Bc)ᵀ dc, dc = dh1 + i dh2.
    """
    gradient = 2 * (h[..., 0] + 1j * h[..., 1]) @ b[_ORDER]
    entries = (gradient[:, :, None] * np.array([1, 1j, 0])).reshape(-1, 9)
    g = np.stack([entries.real, entries.imag], 1)
    return g @ covariances @ np.swapaxes(g, 1, 2)


def focal_uncertainty(b: Array, basis: Array, equations: Array, noise: Array) -> float:
    """First-order relative standard deviation of the less certain focal length.

    Parameters
    ----------
    b : (6,) array
        The estimate, in the span of `basis` (6, k).
    equations : (V, 2, 6) array
    noise : (V, 2, 2) array
        Their covariances at b.

    Returns
    -------
    float
        Enlarged by the root of the reduced chi-square of the equations where that exceeds 1: what the noise
        does not explain (the lens's distortion, or a breakdown of first order) counts as well. inf where the
        equations do not determine b.
    """
    trace = np.einsum("vii->v", noise)
    floor = np.finfo(float).eps * trace.max() + np.finfo(float).tiny
    white = np.linalg.inv(np.linalg.cholesky(noise + floor * np.eye(2))) @ equations
    a = white.reshape(-1, 6) @ basis
    x = np.linalg.lstsq(basis, b, rcond=None)[0]
    # directions that leave the scale of b alone
    tangent = np.linalg.svd(x[None], full_matrices=True)[2][1:].T
    free = tangent.shape[1]
    padded = np.concatenate([a @ tangent, np.zeros((free, free))])
    _, singular, vt = np.linalg.svd(padded, full_matrices=False)
    if singular[-1] <= np.finfo(float).eps * singular[0]:
        return np.inf
    variances = ((_log_focal_jacobian(b) @ basis @ tangent @ (vt.T / singular)) ** 2).sum(1)
    surplus = len(a) - free
    misfit = float(((a @ x) ** 2).sum()) / surplus if surplus > 0 else 1.0
    return float(np.sqrt(variances.max() * max(misfit, 1.0)))


def _log_focal_jacobian(b: Array) -> Array:
    """d (log fx, log fy) / d b (2, 6), from B = λ K⁻ᵀ K⁻¹.

    With ω = B⁻¹ ~ K Kᵀ: fy² = (ω22 ω33 - ω23²) / ω33², and fx² fy² = det ω / ω33³.
    """
    omega = np.linalg.inv(b[_ORDER])
    out = np.zeros((2, 6))
    for i in range(6):
        d = -omega @ (i == _ORDER) @ omega
        minor = omega[1, 1] * omega[2, 2] - omega[1, 2] ** 2
        d_minor = d[1, 1] * omega[2, 2] + omega[1, 1] * d[2, 2] - 2 * omega[1, 2] * d[1, 2]
        d_fy = d_minor / minor - 2 * d[2, 2] / omega[2, 2]
        d_both = np.trace(np.linalg.solve(omega, d)) - 3 * d[2, 2] / omega[2, 2]
        out[:, i] = (d_both - d_fy) / 2, d_fy / 2
    return out
