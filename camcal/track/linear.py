"""Small dense steps in square-root form, the basis of every recursion in this package.

A covariance P is kept as a factor L with P = L Lᵀ. Orthogonal transformations alone carry it from frame to
frame, so that it can neither lose its symmetry nor become indefinite, however long the stream
(Kaminski, Bryson & Schmidt, IEEE Trans. Automatic Control 16, 1971).

LAPACK is called directly: with matrices this small, numpy's checks cost more than the arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

Array = np.ndarray

#: ratio of pivots, or of singular values, from which on a direction is determined; below it six of 16 digits, those of
#: the image points, are not left
UNDETERMINED = 1e-10


class Compressed(NamedTuple):
    """The information of a frame about p parameters, r = J δ + noise of unit variance, in p equations.

    Attributes
    ----------
    a : (p, p) array, upper triangular
    z : (p,) array; z = a δ + noise of unit variance
    rest : float
        Sum of squares that no δ explains: chi-squared of `dof` degrees of freedom times the noise variance.
    dof : int
    """

    a: Array
    z: Array
    rest: float
    dof: int


def compress(design: Array) -> Compressed:
    """Reduce whitened equations to as many as there are parameters, by QR.

    Parameters
    ----------
    design : (p + 1, m) array, overwritten
        The rows of Jᵀ, then rᵀ.
    """
    width, m = design.shape
    p = width - 1
    if m < width:
        padded = np.zeros((width, width))
        padded[:, :m] = design
        design = padded
    r = _upper(design, width)
    a = r[:p, :p]
    return Compressed(a, r[:p, p], float(r[p, p] ** 2), max(m - p, 0))


def triangle(rows: Array) -> Array:
    """The lower triangular L (n, n) with L Lᵀ = rows rowsᵀ; rows (n, m), m >= n, are overwritten."""
    return _upper(rows, len(rows)).T


def _upper(columns: Array, n: int) -> Array:
    """The triangle (n, n) of the QR of columnsᵀ; a C-ordered array is LAPACK's order transposed."""
    qr, _, _, info = lapack.dgeqrf(columns.T, overwrite_a=1)
    if info:
        raise ValueError(f"dgeqrf: argument {-info} is illegal")
    r = qr[:n]
    return r * _mask(n)


_MASKS: dict[int, Array] = {}


def _mask(n: int) -> Array:
    """Ones on and above the diagonal: a product with it is faster than numpy's triu."""
    if n not in _MASKS:
        _MASKS[n] = np.triu(np.ones((n, n)))
    return _MASKS[n]


def solve_upper(r: Array, b: Array, transposed: bool = False) -> Array:
    """Solve r x = b (or rᵀ x = b) with r upper triangular; LinAlgError if r is singular."""
    x, info = lapack.dtrtrs(r, b, trans=int(transposed))
    if info:
        raise np.linalg.LinAlgError("singular triangular matrix")
    return x


def cholesky(matrix: Array) -> Array:
    """The lower factor of a positive definite matrix; LinAlgError if it is not positive definite."""
    factor, info = lapack.dpotrf(matrix, lower=1)
    if info:
        raise np.linalg.LinAlgError("not positive definite")
    return factor


def solve_lower(factor: Array, b: Array) -> Array:
    """Solve L x = b with L lower triangular."""
    x, info = lapack.dtrtrs(factor, b, lower=1)
    if info:
        raise np.linalg.LinAlgError("singular triangular matrix")
    return x


def solve_factored(factor: Array, b: Array) -> Array:
    """Solve L Lᵀ x = b."""
    x, info = lapack.dpotrs(factor, b, lower=1)
    if info:
        raise np.linalg.LinAlgError("singular matrix")
    return x


def joseph(gain: Array, a: Array, factor: Array) -> Array:
    """The covariance factor after x += gain (z - a δ), for any gain, optimal or not.

    P⁺ = (I - G A) P (I - G A)ᵀ + G Gᵀ (Bucy & Joseph, 1968), by QR of [(I - G A) L, G].

    Parameters
    ----------
    gain : (n, p) array
    a : (p, p) array, on the first p of n state variables
    factor : (n, n) array, the factor before
    """
    p = len(a)
    n = len(factor)
    rows = np.empty((n, n + p))
    np.subtract(factor, gain @ (a @ factor[:p]), out=rows[:, :n])
    rows[:, n:] = gain
    return triangle(rows)
