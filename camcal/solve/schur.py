"""The damped normal equations with the poses eliminated (Schur complement).

    [ U  W ] [δa]     [a]        S = U − Σ W_v V_v⁻¹ W_vᵀ,   S δa = −(a − Σ W_v V_v⁻¹ b_v)              (1)
    [ Wᵀ V ] [δb] = − [b]        δb_v = −V_v⁻¹ (b_v + W_vᵀ δa)                                          (2)

V is block diagonal, one 6x6 block per view (Triggs et al., Bundle Adjustment: A Modern Synthesis, 2000, section
6.1), so the cost grows linearly with the number of views. The blocks are factored all at once, with the views
along the last axis: a few dozen vector operations instead of one small LAPACK call per view.
"""

from __future__ import annotations

import numpy as np

from camcal.solve.problem import Blocks, Step

Array = np.ndarray

#: Number of parameters above which scipy is used, which has triangular solvers; numpy factors the triangle again. For a
#: camera and a board of 70 free points, importing scipy (.15 s) takes longer than this does in a calibration.
MANY = 250


def eliminate(bordered: Array) -> bool:
    """Cholesky factors of many small matrices at once, and the forward substitution with them, in place.

    The right sides are appended to the matrices, so that each pivot's row is scaled and subtracted from those below it
    once for both: five vector operations per pivot, with the blocks along the last axis.

    Parameters
    ----------
    bordered : (n, n + K, V) array
        Symmetric positive definite along the first n columns, the right sides after them. Replaced by Lᵀ (its lower
        triangle contains intermediate values) and by L⁻¹ times the right sides.

    Returns
    -------
    bool
        False if a matrix is not positive definite.
    """
    n = len(bordered)
    with np.errstate(all="ignore"):  # a non-positive pivot yields NaN, which is detected at the end
        for j in range(n):
            row = bordered[j, j:]
            row *= 1.0 / np.sqrt(row[0])
            if j + 1 < n:
                bordered[j + 1 :, j + 1 :] -= row[1 : n - j, None] * row[1:]
        # the last pivot depends on all before it
        return bool(np.isfinite(bordered[n - 1, n - 1]).all()) if n else True


def back_substitution(rows: Array, right: Array) -> Array:
    """Solve Lᵀ x = right (n, V) for Lᵀ (n, n or more, V) of `eliminate`."""
    x = right.copy()
    for i in reversed(range(len(x))):
        x[i] /= rows[i, i]
        x[:i] -= rows[:i, i] * x[i]
    return x


class Reduced:
    """The normal equations of one linearisation, factored for one damping value.

    Parameters
    ----------
    blocks : Blocks
    damping : float
        λ of Marquardt: each diagonal element is multiplied by 1 + λ.
    scaled : bool
        False for Levenberg's damping, λ times the largest diagonal element added to all of them, and for a
        solution without scaling.

    Attributes
    ----------
    matrix : (F, F) array, S of (1)
    solvable : bool, False if a block or S is not positive definite
    weakest : float
        The smallest squared pivot against the squared length of its column, after `step`: about the
        reciprocal of the squared condition number.
    """

    def __init__(self, blocks: Blocks, damping: float = 0.0, scaled: bool = True):
        self.blocks, self.damping = blocks, damping
        count = len(blocks.gradient)
        size = blocks.poses.shape[1]
        diagonal = np.arange(size)
        bordered = np.empty((size, size + count + 1, len(blocks.poses)))
        bordered[:, :size] = blocks.poses.transpose(1, 2, 0)
        bordered[:, size:-1] = blocks.coupling.transpose(2, 1, 0)
        bordered[:, -1] = blocks.pose_gradients.T
        self.pose_diagonal = bordered[diagonal, diagonal]
        self.diagonal = blocks.intrinsics.diagonal().copy()
        self.scaled, self.weakest = scaled, 0.0
        if not scaled:
            largest = max(self.pose_diagonal.max(initial=0.0), self.diagonal.max(initial=0.0))
            self.pose_diagonal[:], self.diagonal[:] = largest, largest
        if damping:
            bordered[diagonal, diagonal] += damping * self.pose_diagonal
        self.solvable = eliminate(bordered)
        if not self.solvable:
            return
        self.factor, self.half = bordered[:, :size], bordered[:, size:]
        flat = np.ascontiguousarray(self.half.transpose(1, 0, 2).reshape(count + 1, -1))  # as of many views
        product = flat @ flat.T
        self.matrix = blocks.intrinsics - product[:count, :count]
        if damping:
            self.matrix.flat[:: count + 1] += damping * self.diagonal
        self.gradient = blocks.gradient - product[:count, count]

    def step(self, more: Array | None = None) -> tuple[Step, float] | None:
        """The step of (1) and (2), and the decrease of the cost predicted by the linear model.

        None if the equations cannot be solved at this damping. `more` (F, F) is added to S: curvature
        that JᵀJ does not contain.
        """
        if not self.solvable:
            return None
        matrix = self.matrix if more is None else self.matrix + more
        solved = solve_scaled(matrix, -self.gradient, self.scaled)
        if solved is None:
            return None
        own, pivots = solved
        self.weakest = self._weakest(pivots)
        poses = self.poses(own)
        b = self.blocks
        # ½ (δᵀ λ D δ − gᵀδ): what the quadratic model loses along the damped step
        moved = np.ascontiguousarray(poses.T)
        slope = b.gradient @ own + b.pose_gradients.ravel() @ moved.ravel()
        # summed as by `stack`
        damp = self.diagonal @ (own * own) + (self.pose_diagonal * poses * poses).sum(-1).sum(0)
        return Step(own, moved), float(0.5 * (self.damping * damp - slope))

    def poses(self, own: Array) -> Array:
        """The steps (6, V) of the poses that belong to a step (F,) of the camera: (2)."""
        return back_substitution(self.factor, np.append(-own, -1.0) @ self.half)

    def _weakest(self, pivots: Array) -> float:
        """The smallest squared pivot of the poses and of the camera, against its original column."""
        diagonal = np.arange(len(self.factor))
        poses = (self.factor[diagonal, diagonal] ** 2 / self.pose_diagonal).min(initial=1.0)
        weakest = (pivots / np.where(self.diagonal > 0, self.diagonal, 1.0)).min(initial=poses)
        return float(weakest) / (1.0 + self.damping)


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
    diagonal = matrix.diagonal()
    if not (diagonal > 0).all():
        idle = ~matrix.any(0)  # parameters without effect here, such as p3 if p1 = p2 = 0, are held
        if not (diagonal > 0)[~idle].all():
            return None
        matrix = matrix + np.diag(idle.astype(float))
        diagonal = matrix.diagonal()
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
        return np.linalg.solve(matrix, right), factor.diagonal()
    except np.linalg.LinAlgError:  # of either: rounding may leave pivots to the one and not to the other
        return None
