"""Steps from orthogonal factors of the Jacobian's stacked blocks; the product JᵀJ is never formed.

    Q_vᵀ [B_v A_v r_v] = [R_v  S_v  q_v]     B_v: pose, A_v: camera                                       (1)
                         [ 0   T_v  c_v]
    stack all (T_v, c_v), again Q ᵀ[T c] = [R c];  R δa = -c,  R_v δb = -(q_v + S_v δa)                   (2)

The poses are eliminated view by view and the rest is a small triangle, as with the Schur complement (R is its
Cholesky factor), but a relative error ε in J becomes ε cond(J) instead of the ε cond(J)² of normal equations
(Golub & Van Loan, section 5.3; N. Demmel et al., Square root bundle adjustment, CVPR 2021, for the blocks).
Damping is the same least squares problem with the rows sqrt(λ) D below it (Moré 1978, eq. 3.3).
"""

from __future__ import annotations

import numpy as np

from camcal.records import dataclass
from camcal.solve import rows, tangent
from camcal.solve.problem import Blocks, Problem, State, Step

Array = np.ndarray

#: a diagonal entry of R below this fraction of its column's length is zero up to rounding
_ZERO = 1e-14


@dataclass(frozen=True)
class SquareRoot:
    """The undamped factors at a state.

    Attributes
    ----------
    views : (V, K, K) array
        Upper triangles of each instant's rows, columns in the order pose (6), camera (F), residual (1).
    prior : (M, F + 1) array
        Rows of the lens model's prior, camera and residual.
    """

    views: Array
    prior: Array

    @classmethod
    def of(cls, problem: Problem, state: State) -> SquareRoot:
        """Factor the rows at a state where all points project."""
        free = problem.variables
        size = free + 7
        order = np.r_[free : free + 6, :free, free + 6]
        views = np.zeros((problem.instants, size, size))
        seen = np.zeros(problem.instants, bool)
        for group, block in rows.by_group(problem, state):
            assert block is not None  # the caller has linearised here
            found, at = triangles(block[:, order].transpose(0, 2, 1)), problem.seen.instant[group.members]
            again = seen[at]
            if again.any():  # by another camera
                found[again] = triangles(np.concatenate([views[at[again]], found[again]], 1))
            views[at], seen[at] = found, True
        own = problem.prior(state)
        prior = np.zeros((0, free + 1)) if own is None else np.c_[own[1], own[0]]
        return cls(views, prior)

    def step(self, blocks: Blocks, damping: float, scaled: bool = True) -> tuple[Step, float] | None:
        """The damped step and the decrease predicted by the linear model; None if J is singular.

        `blocks` belong to the same state; damping and `scaled` are those of `Reduced`.
        """
        free = len(blocks.gradient)
        weights = damping_weights(blocks, scaled)
        views = self.views
        if damping > 0:
            added = np.zeros((len(views), 6, views.shape[2]))
            added[:, range(6), range(6)] = np.sqrt(damping * weights[free:].reshape(-1, 6))
            views = triangles(np.concatenate([views, added], 1))
        squares = tangent.diagonal(blocks)
        moving = squares[:free] > 0  # the others have no effect here, such as p3 if p1 = p2 = 0, and are held
        count = int(moving.sum())
        below = [views[:, 6:, 6:].reshape(-1, free + 1), self.prior]
        if damping > 0:
            below.append(np.c_[np.diag(np.sqrt(damping * weights[:free])), np.zeros(free)])
        camera = triangles(np.concatenate(below)[None][..., np.r_[moving, True]])[0]
        pivots = np.r_[abs(np.diag(camera)[:count]), abs(np.einsum("vii->vi", views[:, :6, :6])).ravel()]
        if (
            pivots <= _ZERO * np.sqrt((1 + damping) * squares[np.r_[moving, np.ones(6 * len(views), bool)]])
        ).any():
            return None
        own = np.zeros(free)
        if count:
            own[moving] = -np.linalg.solve(camera[:count, :count], camera[:count, count])
        right = views[:, :6, -1] + views[:, :6, 6:-1] @ own
        poses = -np.linalg.solve(views[:, :6, :6], right[..., None])[..., 0]
        step = Step(own, poses)
        vector = tangent.flat(step)
        slope = tangent.gradient(blocks) @ vector
        return step, float(0.5 * (damping * (weights * vector**2).sum() - slope))

    def with_poses(self, maps: Array) -> SquareRoot:
        """The factors for other coordinates of the poses.

        Parameters
        ----------
        maps : (V, 6, 6) array
            d pose / d (its other coordinates), of each instant.
        """
        own = np.concatenate([self.views[:, :6, :6] @ maps, self.views[:, :6, 6:]], 2)
        views = self.views.copy()
        views[:, :6] = triangles(own)[:, :6]
        return SquareRoot(views, self.prior)

    def reduced(self) -> Array:
        """R of (2), (F, F): the square root of the Schur complement."""
        free = self.views.shape[1] - 7
        stacked = np.concatenate([self.views[:, 6:, 6:-1].reshape(-1, free), self.prior[:, :-1]])
        return triangles(stacked[None])[0]


def damping_weights(blocks: Blocks, scaled: bool) -> Array:
    """D² of the damping, (F + 6 V,): squared lengths of the columns, or the largest of them for all."""
    squares = tangent.diagonal(blocks)
    return squares if scaled else np.full_like(squares, squares.max())


def triangles(stacked: Array) -> Array:
    """Upper triangular factors (V, K, K) of matrices (V, M, K), even if M < K."""
    count, length, size = stacked.shape
    if length < size:
        stacked = np.concatenate([stacked, np.zeros((count, size - length, size))], 1)
    return np.asarray(np.linalg.qr(stacked, mode="r"))
