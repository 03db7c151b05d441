"""The condition number of the refinement's Jacobian, from its orthogonal factors.

cond J decides how many digits a step, or a covariance, can keep; in normal equations its square does. The
largest and the smallest singular value come by Lanczos iterations with J and J⁻¹ as products with blocks, so
that no matrix of all unknowns is formed.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from camcal.solve.problem import Problem, State
from camcal.solve.square_root import SquareRoot

Array = np.ndarray

#: condition numbers are wanted to two digits, squares of singular values are what is iterated
_ACCURACY = 1e-3


def condition(problem: Problem, state: State, scaled: bool = True) -> float:
    """The ratio of the largest singular value of J to the smallest; inf where J is singular.

    Parameters
    ----------
    problem : Problem
        Its `normalise` decides about which point poses turn.
    state : State
        One that projects.
    scaled : bool
        Columns of J scaled to unit length, as steps are solved; else as they are.
    """
    factors = _Factors(SquareRoot.of(problem, state))
    lengths = factors.lengths()
    if not (lengths > 0).all() or not factors.regular():
        return float("inf")
    scale = 1.0 / lengths if scaled else np.ones(len(lengths))
    largest = _largest(lambda v: scale * factors.transposed(factors.times(scale * v)), len(lengths))
    inverse = _largest(lambda v: factors.solve(factors.solve_transposed(v / scale)) / scale, len(lengths))
    return float(np.sqrt(largest * inverse))


def _largest(product, size: int) -> float:  # type: ignore[no-untyped-def]
    """The largest eigenvalue of a symmetric product."""
    if size == 1:
        return float(product(np.ones(1))[0])
    start = np.random.default_rng(0).normal(size=size)  # not one that symmetry makes orthogonal to the answer
    operator = LinearOperator((size, size), matvec=product, dtype=float)
    try:
        return float(eigsh(operator, 1, which="LA", v0=start, tol=_ACCURACY, return_eigenvectors=False)[0])
    except ArpackNoConvergence as error:
        return float(error.eigenvalues[0]) if len(error.eigenvalues) else float("inf")


class _Factors:
    """J = Q [R_v S_v; 0 R] by blocks; vectors (F + 6 V,), camera first."""

    def __init__(self, root: SquareRoot):
        self.poses, self.mixed = root.views[:, :6, :6], root.views[:, :6, 6:-1]
        self.camera = root.reduced()
        self.free = self.camera.shape[0]

    def lengths(self) -> Array:
        """Lengths of the columns of J."""
        camera = (self.mixed**2).sum((0, 1)) + (self.camera**2).sum(0)
        return np.sqrt(np.concatenate([camera, (self.poses**2).sum(1).ravel()]))

    def regular(self) -> bool:
        """Whether no diagonal entry of the triangles is zero."""
        return bool(np.diag(self.camera).all() and np.einsum("vii->vi", self.poses).all())

    def _split(self, v: Array) -> tuple[Array, Array]:
        return v[: self.free], v[self.free :].reshape(-1, 6)

    def times(self, v: Array) -> Array:
        """R v."""
        a, b = self._split(v)
        poses = np.einsum("vij,vj->vi", self.poses, b) + self.mixed @ a
        return np.concatenate([self.camera @ a, poses.ravel()])

    def transposed(self, v: Array) -> Array:
        """Rᵀ v."""
        a, b = self._split(v)
        camera = self.camera.T @ a + np.einsum("vif,vi->f", self.mixed, b)
        return np.concatenate([camera, np.einsum("vij,vi->vj", self.poses, b).ravel()])

    def solve(self, v: Array) -> Array:
        """R⁻¹ v."""
        a, b = self._split(v)
        camera = solve_triangular(self.camera, a) if self.free else a
        poses = np.linalg.solve(self.poses, (b - self.mixed @ camera)[..., None])[..., 0]
        return np.concatenate([camera, poses.ravel()])

    def solve_transposed(self, v: Array) -> Array:
        """R⁻ᵀ v."""
        a, b = self._split(v)
        poses = np.linalg.solve(self.poses.transpose(0, 2, 1), b[..., None])[..., 0]
        rest = a - np.einsum("vif,vi->f", self.mixed, poses)
        camera = solve_triangular(self.camera, rest, trans="T") if self.free else rest
        return np.concatenate([camera, poses.ravel()])
