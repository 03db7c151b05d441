"""The damped normal equations of a calibration with a free board, eliminating its points before the poses.

The equations of different points are not coupled, nor are those of different poses, so that either kind can be
eliminated block by block (Triggs et al., Bundle Adjustment: A Modern Synthesis, 2000, section 6.1). Eliminating poses
leaves a dense system of the camera and all points, 3 M unknowns; eliminating points, one of the camera and all poses,
6 V:

    [ A  Wᵀ ] [δc]     [c]        S = A − Wᵀ D⁻¹ W,   S δc = −(c − Wᵀ D⁻¹ d)                              (1)
    [ W  D  ] [δx] = − [d]        δx = −D⁻¹ (d + W δc)                                                    (2)

with D the 3x3 blocks of the points and c camera and poses. This is many times faster for large boards in few views.
"""

from __future__ import annotations

import numpy as np

from camcal.solve.board import point_slots
from camcal.solve.problem import Blocks, Step
from camcal.solve.schur import solve_scaled

Array = np.ndarray


class PointsFirst:
    """One linearisation, factored for one damping value; see `camcal.solve.schur.Reduced`.

    Parameters
    ----------
    blocks : Blocks
        Of a `BoardProblem`: the last B of its intrinsics are coordinates of points.
    damping : float
        λ of Marquardt.
    coordinates : (B,) int array
        Their indices among the board's 3 M coordinates, ascending.

    Attributes
    ----------
    weakest : float
        After `step`: the smallest squared pivot relative to the squared length of its column.
    """

    def __init__(self, blocks: Blocks, damping: float, coordinates: Array):
        self.blocks, self.damping, self.coordinates = blocks, damping, coordinates
        self.own = len(blocks.gradient) - len(coordinates)
        self.weakest, self.solvable = 0.0, True
        points = int(coordinates.max(initial=-1)) // 3 + 1
        self.lengths, damped = self._own_blocks(points)
        try:
            self.inverse = np.linalg.inv(np.linalg.cholesky(damped))
        except np.linalg.LinAlgError:
            self.solvable = False
            return
        self.half = (self.inverse @ self._mixed(points)).reshape(3 * points, -1)

    def _own_blocks(self, points: int) -> tuple[Array, Array]:
        """The diagonal (B,) of the points' block, and its damped blocks (M, 3, 3); 1 for held coordinates."""
        rows, columns, there = point_slots(self.coordinates, points)
        shape = self.blocks.intrinsics[self.own :, self.own :]
        found: Array = np.where(there, shape[rows, columns], np.eye(3))
        axis = np.arange(3)
        found[:, axis, axis] *= np.where(there[:, axis, axis], 1.0 + self.damping, 1.0)
        return np.diag(shape), found

    def _mixed(self, points: int) -> Array:
        """W with d as its last column, (M, 3, F + 6 V + 1)."""
        b, own = self.blocks, self.own
        mixed = np.zeros((3 * points, own + 6 * len(b.poses) + 1))
        mixed[self.coordinates, :own] = b.intrinsics[own:, :own]
        mixed[self.coordinates, own:-1] = (
            b.coupling[:, own:].transpose(1, 0, 2).reshape(len(self.coordinates), -1)
        )
        mixed[self.coordinates, -1] = b.gradient[own:]
        return mixed.reshape(points, 3, -1)

    def _others(self) -> tuple[Array, Array]:
        """A without damping, (F + 6 V, F + 6 V), and c."""
        b, own, views = self.blocks, self.own, len(self.blocks.poses)
        a = np.zeros((own + 6 * views, own + 6 * views))
        a[:own, :own] = b.intrinsics[:own, :own]
        a[:own, own:] = b.coupling[:, :own].transpose(1, 0, 2).reshape(own, -1)
        a[own:, :own] = a[:own, own:].T
        at = own + 6 * np.arange(views)[:, None] + np.arange(6)
        a[at[:, :, None], at[:, None, :]] = b.poses
        return a, np.r_[b.gradient[:own], b.pose_gradients.ravel()]

    def step(self, more: Array | None = None) -> tuple[Step, float] | None:
        """The step of (1) and (2), and the decrease of the cost that the linear model predicts; None if unsolvable.

        `more`, the curvature used by `Reduced.step`, is not supported.
        """
        assert more is None
        if not self.solvable:
            return None
        a, c = self._others()
        lengths = np.diag(a).copy()
        product = self.half.T @ self.half
        s = a - product[:-1, :-1]
        s[np.diag_indices(len(s))] += self.damping * lengths
        solved = solve_scaled(s, product[:-1, -1] - c)
        if solved is None:
            return None
        others, pivots = solved
        right = (self.half[:, -1] + self.half[:, :-1] @ others).reshape(-1, 3, 1)
        moved = -(self.inverse.transpose(0, 2, 1) @ right).ravel()[self.coordinates]
        self._note_weakest(pivots, lengths)
        d = self.blocks.gradient[self.own :]
        slope = c @ others + d @ moved
        damp = (lengths * others**2).sum() + (self.lengths * moved**2).sum()
        step = Step(np.r_[others[: self.own], moved], others[self.own :].reshape(-1, 6))
        return step, float(0.5 * (self.damping * damp - slope))

    def _note_weakest(self, pivots: Array, lengths: Array) -> None:
        axis = np.arange(3)
        own = 1 / self.inverse[:, axis, axis].ravel()[self.coordinates] ** 2 / self.lengths
        others = pivots / np.where(lengths > 0, lengths, 1.0)
        self.weakest = float(min(own.min(initial=1.0), others.min(initial=1.0)) / (1.0 + self.damping))
