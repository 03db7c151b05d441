"""Kronecker products of many matrices, and rotations from solutions of Kronecker systems."""

from __future__ import annotations

import numpy as np

from camcal.model.pose import Array


def kron(a: Array, b: Array) -> Array:
    """A ⊗ B (M, p r, q s) of matrices (M, p, q) and (M, r, s): vec(A X Bᵀ) = (A ⊗ B) vec X, vec by rows."""
    m, p, q = a.shape
    _, r, s = b.shape
    return np.einsum("mij,mkl->mikjl", a, b).reshape(m, p * r, q * s)


def spanned(vector: Array) -> Array:
    """The matrix (3, 3) of a vector (9,), rows one after the other, scaled to determinant 1."""
    matrix = vector.reshape(3, 3)
    return matrix / np.cbrt(np.linalg.det(matrix))
