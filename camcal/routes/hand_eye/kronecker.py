"""Kronecker products of many matrices, and rotations from solutions of Kronecker systems."""

from __future__ import annotations

import numpy as np

from camcal.model.pose import Array


def kron(a: Array, b: Array) -> Array:
    """A ⊗ B (..., p r, q s) of matrices (..., p, q) and (..., r, s): vec(A X Bᵀ) = (A ⊗ B) vec X, vec by rows."""
    shape = *a.shape[:-2], a.shape[-2] * b.shape[-2], a.shape[-1] * b.shape[-1]
    return np.einsum("...ij,...kl->...ikjl", a, b).reshape(shape)


def spanned(vector: Array) -> Array:
    """The matrices (..., 3, 3) of vectors (..., 9), row by row, scaled to determinant 1."""
    matrix = vector.reshape(*vector.shape[:-1], 3, 3)
    return np.asarray(matrix / np.cbrt(np.linalg.det(matrix))[..., None, None])
