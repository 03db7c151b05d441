"""The damped normal equations with the poses eliminated (Schur complement).

    [ U  W ] [δa]     [a]        S = U − Σ W_v V_v⁻¹ W_vᵀ,   S δa = −(a − Σ W_v V_v⁻¹ b_v)              (1)
    [ Wᵀ V ] [δb] = − [b]        δb_v = −V_v⁻¹ (b_v + W_vᵀ δa)                                          (2)

V is block diagonal, one 6x6 block a view (Triggs et al., Bundle Adjustment: A Modern Synthesis, 2000, section
6.1), so the cost grows linearly with the number of views. The blocks are factored all at once, with the views
along the last axis: a few dozen vector operations in place of one small LAPACK call a view.
"""

from __future__ import annotations

import numpy as np

from camcal.solve.problem import Blocks, Step

Array = np.ndarray

#: Parameters from which on a solution takes scipy, which solves with a triangle as such; numpy factors it once more.
#: For a camera and a board of 70 free points, the import (.15 s) takes longer than that does in a calibration.
MANY = 250


def cholesky(blocks: Array) -> Array | None:
    """Cholesky factors of many small matrices at once.

    Parameters
    ----------
    blocks : (n, n, V) array, symmetric positive definite along the first two axes

    Returns
    -------
    (n, n, V) array, lower triangular with the *reciprocal* of the pivots on the diagonal; None where a
    matrix is not positive definite
    """
    n = len(blocks)
    factor = np.zeros_like(blocks)
    with np.errstate(all="ignore"):  # a pivot that is not positive makes NaN, and shows at the end
        for j in range(n):
            column = blocks[j:, j]
            if j:
                column = column - np.einsum("ikv,kv->iv", factor[j:, :j], factor[j, :j])
            factor[j, j] = 1.0 / np.sqrt(column[0])
            factor[j + 1 :, j] = column[1:] * factor[j, j]
    return factor if np.isfinite(factor).all() else None


def forward_substitution(factor: Array, right: Array) -> Array:
    """Solve L y = right (n, ..., V) for factors of `cholesky` (n, n, V)."""
    y = right.copy()
    middle = (1,) * (right.ndim - 2)
    shaped = factor.reshape(*factor.shape[:2], *middle, factor.shape[2])
    for i in range(len(y)):
        for j in range(i):
            y[i] -= shaped[i, j] * y[j]
        y[i] *= shaped[i, i]
    return y


def back_substitution(factor: Array, right: Array) -> Array:
    """Solve Lᵀ x = right (n, V) for factors of `cholesky` (n, n, V)."""
    x = right.copy()
    for i in reversed(range(len(x))):
        for j in range(i + 1, len(x)):
            x[i] -= factor[j, i] * x[j]
        x[i] *= factor[i, i]
    return x


class Reduced:
    """The normal equations of one linearisation, factored for one damping value.

    Parameters
    ----------
    blocks : Blocks
    damping : float
        λ of Marquardt: each diagonal element is multiplied by 1 + λ.
    scaled : bool
        False for Levenberg's damping instead, λ times the largest diagonal element on all of them, and for a
        solution without scaling.

    Attributes
    ----------
    matrix : (F, F) array, S of (1)
    solvable : bool, False where a block or S is not positive definite
    weakest : float
        The smallest squared pivot against the squared length of its column, after `step`: about the
        reciprocal of the squared condition number.
    """

    def __init__(self, blocks: Blocks, damping: float = 0.0, scaled: bool = True):
        self.blocks, self.damping = blocks, damping
        count = len(blocks.gradient)
        size = blocks.poses.shape[1]
        diagonal = np.arange(size)
        poses = np.ascontiguousarray(blocks.poses.transpose(1, 2, 0))
        self.pose_diagonal = poses[diagonal, diagonal].copy()
        self.diagonal = np.diag(blocks.intrinsics).copy()
        self.scaled, self.weakest = scaled, 0.0
        if not scaled:
            largest = max(self.pose_diagonal.max(initial=0.0), self.diagonal.max(initial=0.0))
            self.pose_diagonal[:], self.diagonal[:] = largest, largest
        poses[diagonal, diagonal] += damping * self.pose_diagonal
        factor = cholesky(poses)
        self.solvable = factor is not None
        if factor is None:
            return
        self.factor = factor
        right = np.empty((size, count + 1, len(blocks.poses)))
        right[:, :count] = blocks.coupling.transpose(2, 1, 0)
        right[:, count] = blocks.pose_gradients.T
        self.half = forward_substitution(factor, right)
        flat = self.half.transpose(1, 0, 2).reshape(count + 1, -1)
        product = flat @ flat.T
        self.matrix = blocks.intrinsics - product[:count, :count]
        self.matrix[np.diag_indices(count)] += damping * self.diagonal
        self.gradient = blocks.gradient - product[:count, count]

    def step(self, more: Array | None = None) -> tuple[Step, float] | None:
        """The step of (1) and (2), and the decrease of the cost predicted by the linear model.

        None where the equations cannot be solved at this damping. `more` (F, F) is added to S: curvature
        that JᵀJ does not have.
        """
        if not self.solvable:
            return None
        matrix = self.matrix if more is None else self.matrix + more
        solved = solve_scaled(matrix, -self.gradient, self.scaled)
        if solved is None:
            return None
        own, pivots = solved
        self.weakest = self._weakest(pivots)
        count = len(own)
        right = self.half[:, count] + np.einsum("ikv,k->iv", self.half[:, :count], own)
        poses = -back_substitution(self.factor, right)
        b = self.blocks
        # ½ (δᵀ λ D δ − gᵀδ): what the quadratic model loses along the damped step
        slope = b.gradient @ own + np.einsum("vi,iv->", b.pose_gradients, poses)
        damp = (self.diagonal * own**2).sum() + (self.pose_diagonal * poses**2).sum()
        return Step(own, np.ascontiguousarray(poses.T)), float(0.5 * (self.damping * damp - slope))

    def _weakest(self, pivots: Array) -> float:
        """The smallest pivot, over the poses (whose factors hold reciprocal pivots) and the camera's original
        columns.
        """
        diagonal = np.arange(len(self.factor))
        lengths = self.pose_diagonal * (1.0 + self.damping)
        poses = 1.0 / float((self.factor[diagonal, diagonal] ** 2 * lengths).max(initial=1.0))
        lengths = np.where(self.diagonal > 0, self.diagonal, 1.0) * (1.0 + self.damping)
        return float((pivots / lengths).min(initial=poses))


def solve_scaled(matrix: Array, right: Array, scaled: bool = True) -> tuple[Array, Array] | None:
    """Solve a symmetric positive definite system after scaling its diagonal to 1; None if it is not positive
    definite.

    Returns
    -------
    solution : (F,) array
    pivots : (F,) array
        Squared, in the units of the diagonal.
    """
    if not len(right):
        return right.copy(), right.copy()
    diagonal = np.diag(matrix)
    if not (diagonal > 0).all():
        idle = ~matrix.any(0)  # nothing depends on these here, as p3 where p1 = p2 = 0: they stay
        if not (diagonal > 0)[~idle].all():
            return None
        matrix = matrix + np.diag(idle.astype(float))
        diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(diagonal) if scaled else np.ones(len(right))
    solved = _positive_definite(matrix * scale * scale[:, None], right * scale)
    if solved is None:
        return None
    return scale * solved[0], (solved[1] / scale) ** 2


def _positive_definite(matrix: Array, right: Array) -> tuple[Array, Array] | None:
    """The solution (F,) of a system, and the pivots (F,) of its Cholesky factor; None if it is not positive
    definite.
    """
    if len(right) > MANY:
        from scipy.linalg.lapack import dposv  # see above

        factor, solution, failed = dposv(matrix, right, lower=1)
        return None if failed else (solution, np.diag(factor))
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return None
    half = np.linalg.solve(factor, right)
    return np.linalg.solve(factor.T, half), np.diag(factor)
