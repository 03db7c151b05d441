"""The condition number of the refinement's Jacobian, from its orthogonal factors.

cond J determines how many digits of a step, or of a covariance, are accurate; with normal equations its square
does. The largest and the smallest singular value are computed by Lanczos iterations with block products of J and
J⁻¹, so that no matrix of all unknowns is formed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from camcal.solve.square_root import SquareRoot

Array = np.ndarray

#: for condition numbers to two digits; squares of singular values are iterated
_ACCURACY = 1e-3
#: largest number of iterations; some twenty are sufficient
_STEPS = 100
#: iterations between two tests of the accuracy, which take longer than an iteration
_BETWEEN = 4


def condition(root: SquareRoot, scaled: bool = True) -> float:
    """The ratio of the largest singular value of J to the smallest; inf if J is singular.

    Parameters
    ----------
    root : SquareRoot
        The factors of J.
    scaled : bool
        Scale the columns of J to unit length, as for steps.
    """
    factors = _Factors(root)
    lengths = factors.lengths()
    if not (lengths > 0).all() or not factors.regular:
        return float("inf")
    scale = 1.0 / lengths if scaled else np.ones(len(lengths))
    largest = _largest(lambda v: scale * factors.transposed(factors.times(scale * v)), len(lengths))
    inverse = _largest(lambda v: factors.solve(factors.solve_transposed(v / scale)) / scale, len(lengths))
    return float(np.sqrt(largest * inverse))


def _largest(product: Callable[[Array], Array], size: int) -> float:
    """The largest eigenvalue of a symmetric product, by Lanczos iterations with full reorthogonalisation.

    Golub & Van Loan, Matrix Computations, 2013, section 10.3; |β s| bounds the error of a Ritz value (10.1.12).
    """
    start = np.cos(
        np.arange(size) ** 2
    )  # irregular, so that symmetry cannot make it orthogonal to the result
    basis = np.zeros((min(size, _STEPS), size))
    inner = np.zeros((len(basis), len(basis)))
    vector, value = start / np.linalg.norm(start), 0.0
    for i in range(len(basis)):
        basis[i] = vector
        vector = product(vector)
        inner[i, i] = basis[i] @ vector
        for _ in range(2):  # twice suffices for orthogonality to rounding
            vector = vector - basis[: i + 1].T @ (basis[: i + 1] @ vector)
        rest = float(np.linalg.norm(vector))
        if (i + 1) % _BETWEEN == 0 or i + 1 == len(basis) or not rest > 0:
            values, vectors = np.linalg.eigh(inner[: i + 1, : i + 1])
            value = float(values[-1])
            if not rest * abs(vectors[-1, -1]) > _ACCURACY * value or i + 1 == len(basis):
                break
        inner[i, i + 1] = inner[i + 1, i] = rest
        vector = vector / rest
    return value


class _Factors:
    """J = Q [R_v S_v; 0 R] by blocks; vectors (F + 6 V,), camera first."""

    def __init__(self, root: SquareRoot):
        self.poses, self.mixed = root.views[:, :6, :6], root.views[:, :6, 6:-1]
        self.camera = root.reduced()
        self.free = self.camera.shape[0]
        self.regular = bool(np.diag(self.camera).all() and np.einsum("vii->vi", self.poses).all())
        if self.regular:
            self.own, self.each = np.linalg.inv(self.camera), np.linalg.inv(self.poses)

    def lengths(self) -> Array:
        """Lengths of the columns of J."""
        camera = (self.mixed**2).sum((0, 1)) + (self.camera**2).sum(0)
        return np.sqrt(np.concatenate([camera, (self.poses**2).sum(1).ravel()]))

    def _split(self, v: Array) -> tuple[Array, Array]:
        return v[: self.free], v[self.free :].reshape(-1, 6)

    def times(self, v: Array) -> Array:
        """R v."""
        a, b = self._split(v)
        return np.concatenate([self.camera @ a, (_each(self.poses, b) + self.mixed @ a).ravel()])

    def transposed(self, v: Array) -> Array:
        """Rᵀ v."""
        a, b = self._split(v)
        camera = self.camera.T @ a + np.tensordot(b, self.mixed, 2)
        return np.concatenate([camera, _each(self.poses.transpose(0, 2, 1), b).ravel()])

    def solve(self, v: Array) -> Array:
        """R⁻¹ v."""
        a, b = self._split(v)
        camera = self.own @ a
        return np.concatenate([camera, _each(self.each, b - self.mixed @ camera).ravel()])

    def solve_transposed(self, v: Array) -> Array:
        """R⁻ᵀ v."""
        a, b = self._split(v)
        poses = _each(self.each.transpose(0, 2, 1), b)
        return np.concatenate([self.own.T @ (a - np.tensordot(poses, self.mixed, 2)), poses.ravel()])


def _each(matrices: Array, vectors: Array) -> Array:
    """The product of each matrix (V, 6, 6) and its vector (V, 6)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
