"""The damped linear least-squares problem of an iteration, by normal equations or by orthogonal factors.

Normal equations square the condition number. This is harmless as long as a step has digits to spare, because the
gradient, which determines where the iteration ends, is not affected. If the pivots of the Cholesky factors indicate
that fewer than about two digits of the step would be accurate, orthogonal factors are used instead.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camcal.solve.points_first import PointsFirst
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.schur import Reduced
from camcal.solve.square_root import SquareRoot

Array = np.ndarray

#: how a step is found: as needed, by normal equations (Schur complement), by orthogonal factors
FORMS = ("auto", "schur", "qr")
#: a squared pivot below this fraction of its column's squared length leaves a step uncertain by rounding / WEAK = 1e-2
WEAK = 2e-14


class Linear:
    """Computes steps of one problem; counts the passes over the data for orthogonal factors."""

    def __init__(self, problem: Problem, form: str = ""):
        self.problem, self.form = problem, form or FORMS[0]
        self.passes = self.solved = 0
        self._root: tuple[State, SquareRoot] | None = None

    def step(
        self, state: State, blocks: Blocks, damping: float, more: Array | None = None
    ) -> tuple[Step, float] | None:
        """The step at a state, and the decrease of the cost predicted by the linear model.

        None if the equations cannot be solved at this damping (Marquardt's, see `Reduced`). `more` (F, F)
        is curvature that JᵀJ does not contain; orthogonal factors ignore it.
        """
        if self.form != "qr":
            reduced = self._reduced(blocks, damping, more)
            solved = reduced.step(more)
            if self.form == "schur" or more is not None or (solved is not None and reduced.weakest > WEAK):
                return solved
        self.solved += 1
        return self._factors(state).step(blocks, damping, self.problem.normalise)

    def _reduced(self, blocks: Blocks, damping: float, more: Array | None) -> Reduced | PointsFirst:
        """Eliminate either the poses or the points of a free board, whichever leaves fewer unknowns."""
        points = self.problem.point_coordinates
        if (
            points is not None
            and more is None
            and self.problem.normalise
            and len(points) > 6 * len(blocks.poses)  # 3 unknowns per point of a free board, 6 per pose
        ):
            return PointsFirst(blocks, damping, points)
        return Reduced(blocks, damping, self.problem.normalise)

    def _factors(self, state: State) -> SquareRoot:
        if self._root is None or self._root[0] is not state:
            self.passes += 1
            self._root = state, SquareRoot.of(self.problem, state)
        return self._root[1]

    def info(self) -> dict[str, Any]:
        """The entries for `Result.info`."""
        said = {"variables": "camera and poses"}
        return said if not self.solved else {**said, "solved_by_qr": self.solved}
