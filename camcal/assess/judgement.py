"""What is judged by calibrating again: the hold-out of a solution, with all the options it was made with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from camcal.assess.fold_difference import difference_of_folds
from camcal.assess.holdout import HoldOut, Refit, k_fold
from camcal.data.observations import Correspondences
from camcal.errors import UsageError
from camcal.model.pose import Array, Poses
from camcal.solve.solution import Solution
from camcal.solve.solve import BoardResult, on_board, refine

#: problems up to this size are held out unasked: a fraction of a second
CHEAP_POINTS, CHEAP_PARAMETERS = 10_000, 40
FOLDS = 4
#: views that a hold-out needs at least
LEAST_VIEWS = 4


def hold_out(
    solution: Solution, fix: Mapping[str, float | None], folds: int | None = None, **options: Any
) -> dict[str, Any] | None:
    """The report's `holdout` of a solution.

    Parameters
    ----------
    solution : Solution
    fix : mapping
        As it was calibrated.
    folds : int, optional
        0 = none; by default 4 where the problem is cheap.
    **options
        Of `refine`: optimizer, normalise, ...

    Returns
    -------
    dict, or None where it was not asked for or a fold cannot be estimated.

    Raises
    ------
    UsageError
        Where more folds are asked for than there are views.
    """
    views = len(solution.poses)
    if folds is not None and folds > 0 and (views < LEAST_VIEWS or folds > views or folds < 2):
        raise UsageError(
            f"{folds} folds of {views} views cannot be held out.",
            f"Hold-out needs {LEAST_VIEWS} views or more, and 2 folds up to the number of views.",
        )
    if folds is None:
        cheap = solution.correspondences.point_count <= CHEAP_POINTS
        folds = FOLDS if cheap and solution.camera.lens.size <= CHEAP_PARAMETERS else 0
    if folds == 0 or views < LEAST_VIEWS or not solution.free.any():
        return None
    data, refit = refitter(solution, fix, **options)
    held = k_fold(data, solution.poses, solution.inliers, refit, folds)
    return None if held is None else described(solution, held)


def refitter(
    solution: Solution, fix: Mapping[str, float | None], **options: Any
) -> tuple[Correspondences, Refit]:
    """The data to hold views out of, and how the rest is estimated: as the solution was, beginning there."""
    data, board = solution.correspondences, solution.extras.get("board")
    kind = "flat"
    if isinstance(board, BoardResult):
        data, kind = on_board(data, board.points, board.ideal), board.kind
    weights = _weights(solution)

    def refit(chosen: Correspondences, poses: Poses, inliers: Sequence[Array]) -> Solution:
        own = None if weights is None else [weights[v.id] for v in chosen.views]
        return refine(
            solution.camera, poses, chosen, fix, inliers=inliers, weights=own, board_shape=kind, **options
        )

    return data, refit


def _weights(solution: Solution) -> dict[str, Array] | None:
    if solution.weights is None:
        return None
    pairs = zip(solution.correspondences.views, solution.weights, strict=True)
    return {v.id: w if v.sigma is None else w / v.sigma**2 for v, w in pairs}


def described(solution: Solution, held: HoldOut) -> dict[str, Any]:
    """What the report says of a hold-out."""
    figures = held.figures
    return {
        "views": held.views,
        "folds": held.folds,
        "points": figures.points,
        "rms_point": figures.rms_point,
        "p95": figures.p95,
        "difference": difference_of_folds(solution, held),
    }
