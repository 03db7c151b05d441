"""The predicted decrease of the cost with a board of free shape, by one step from the solution.

One Gauss-Newton step of the problem with such a board (`camcal.solve.board`) suffices, as the offsets are so small
that it hardly differs from the minimum. It takes one pass over the data and one factorisation.
"""

from __future__ import annotations

import numpy as np

from camcal.assess import figures
from camcal.errors import UsageError
from camcal.least_squares.distributions import f_exceeded
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.board import Board, BoardProblem, make_board, settle
from camcal.solve.calibration import Calibration
from camcal.solve.schur import Reduced
from camcal.solve.several_boards import LEAST_VIEWS, Several

#: Larger problems are left to `--board-shape auto`: there the step would cost more than the calibration.
MOST_VIEWS, MOST_POINTS = 100, 200


@dataclass(frozen=True)
class Promise:
    """The predicted gain of a free board.

    Attributes
    ----------
    before, after : float
        sigma_hat with the board as it is and, predicted, with a free one, px.
    p_value : float
        Of the F test, see `camcal.assess.board_shape`.
    rms_offset : float
        Of the board's points, in the unit of the data.
    """

    before: float
    after: float
    p_value: float
    rms_offset: float


def promise(solution: Calibration) -> Promise | None:
    """The predicted gain of a free board; None if the data do not determine one, or are too large for this check."""
    if solution.board is not None or not LEAST_VIEWS < len(solution.poses) <= MOST_VIEWS:
        return None
    try:
        kept = solution.observations.kept()
        board = make_board(kept.views, "free", Several.of(kept))
    except UsageError:
        return None
    freedom, size = figures.redundancy(solution), board.size
    found = step(solution, board) if len(board.points) <= MOST_POINTS and freedom > size else None
    if found is None:
        return None
    cost, gain, shape = found
    rest = max(cost - gain, 0.0)
    if not rest > 0:
        return None
    ratio = (gain / size) / (rest / (freedom - size))
    ideal = board.points
    points = ideal + board.expand(shape)
    if board.label is None:
        points, _, _ = settle(points, ideal, solution.poses)
    before, left = cost / freedom, rest / (freedom - size)
    sigma_hat = figures.sigma_hat(solution)
    return Promise(
        sigma_hat,
        sigma_hat * float(np.sqrt(left / before)),
        float(f_exceeded(max(ratio, 0.0), size, freedom - size)),
        float(np.sqrt(np.square(points - ideal).sum(1).mean())),
    )


def step(solution: Calibration, board: Board) -> tuple[float, float, Array] | None:
    """The cost, its decrease by the step, and the shape's parameters (B,); None where it cannot be made."""
    data, free = solution.observations.kept(), solution.free[:, solution.free.any(0)]
    weights = data.precision_by_view
    problem = BoardProblem(solution.camera.lens, data.views, free, board, weights)
    blocks = problem.linearise(problem.state(solution.camera.params, solution.poses))
    solved = None if blocks is None else Reduced(blocks).step()
    if blocks is None or solved is None:
        return None
    return float(blocks.cost), float(solved[1]), np.asarray(solved[0].intrinsics[-board.size :])
