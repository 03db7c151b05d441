"""The board: residuals that repeat at the same points of it in all views.

One Gauss-Newton step of the problem with a free board (`camcal.solve.board`), from the solution as it is,
tells how far such a board would lower the cost; the offsets are so small that it hardly differs from the
minimum. That takes one pass over the data and one factorisation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from camcal.assess import figures
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning
from camcal.errors import UsageError
from camcal.least_squares.distributions import f_exceeded
from camcal.solve.board import LEAST_VIEWS, Board, BoardProblem, make_board, settle
from camcal.solve.schur import Reduced

#: A board of its own shape is reported where it lowers sigma_hat below this part, ...
GAIN = 0.85
#: ... and where a flat board would look like it with a probability below this.
SIGNIFICANT = 1e-4
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


def not_flat(facts: Facts) -> Iterator[CalibrationWarning]:
    """The board's shape clearly differs from the assumed one."""
    found = promise(facts)
    if found is None or found.p_value > SIGNIFICANT or found.after > GAIN * found.before:
        return
    target = facts.solution.observations.target or {}
    offset = found.rms_offset / float(target.get("square") or 1.0)
    unit = "squares" if target.get("square") else "(unit of the points)"
    yield CalibrationWarning(
        "board-not-flat",
        f"the residuals repeat at the same points of the board: with points {offset:.2g} {unit} off their "
        f"places sigma_hat would fall from {found.before:.3g} to {found.after:.3g} px.",
        "Let camcal estimate the board's shape: --board-shape auto.",
    )


def promise(facts: Facts) -> Promise | None:
    """The predicted gain of a free board; None if the data do not determine one, or are too large for this check."""
    solution = facts.solution
    if solution.board is not None or not LEAST_VIEWS < len(facts.views) <= MOST_VIEWS:
        return None
    problem = _problem(facts)
    freedom = figures.redundancy(solution)
    if problem is None or freedom <= problem.board.size:
        return None
    state = problem.state(facts.camera.params, solution.poses)
    blocks = problem.linearise(state)
    solved = None if blocks is None else Reduced(blocks).step()
    if blocks is None or solved is None:
        return None
    step, gain = solved
    size, rest = problem.board.size, max(blocks.cost - gain, 0.0)
    if not rest > 0:
        return None
    ratio = (gain / size) / (rest / (freedom - size))
    offsets = problem.board.expand(step.intrinsics[-size:])
    ideal = problem.board.points
    points, _, _ = settle(ideal + offsets, ideal, solution.poses)
    before, left = blocks.cost / freedom, rest / (freedom - size)
    sigma_hat = figures.sigma_hat(solution)
    return Promise(
        sigma_hat,
        sigma_hat * float(np.sqrt(left / before)),
        float(f_exceeded(max(ratio, 0.0), size, freedom - size)),
        float(np.sqrt(np.square(points - ideal).sum(1).mean())),
    )


def _problem(facts: Facts) -> BoardProblem | None:
    solution = facts.solution
    data = solution.observations.kept()
    kept = data.views
    try:
        board: Board = make_board(kept, "free")
    except UsageError:
        return None
    if len(board.points) > MOST_POINTS:
        return None
    weights = None if data.precision is None else data.split(data.precision)
    return BoardProblem(facts.camera.lens, kept, solution.free, board, weights)
