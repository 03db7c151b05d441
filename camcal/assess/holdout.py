"""Hold-out: cameras estimated from some of the views, judged on the others with only their poses refitted.

The residuals of views that took no part show what those of the fit hide: parameters that follow the noise, a
model that does not hold (Arlot & Celisse, A survey of cross-validation procedures, 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camcal.assess import figures
from camcal.data.observations import Correspondences
from camcal.errors import CamcalError
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.solve.poses import refine_poses
from camcal.solve.solution import Solution
from camcal.solve.solve import BoardResult, on_board, residuals

#: estimates a camera from the views given, their poses to start from and the points to use
Refit = Callable[[Correspondences, Poses, Sequence[Array]], Solution]


@dataclass(frozen=True)
class HoldOut:
    """What the folds gave.

    Attributes
    ----------
    views : int
        How many views were held out in turn.
    folds : int
    residuals : tuple of (N, 2) arrays
        Of the used points of each view, px, by the camera that did not see it.
    fits : tuple of Solution
        One a fold, of the views that were not held out.
    trained : tuple of (T,) int arrays
        Which views those were.
    """

    views: int
    folds: int
    residuals: tuple[Array, ...]
    fits: tuple[Solution, ...] = ()
    trained: tuple[Array, ...] = ()

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """One a fold."""
        return tuple(fit.camera for fit in self.fits)

    @property
    def figures(self) -> figures.Figures:
        """The error figures of all held-out residuals."""
        return figures.of(np.concatenate(self.residuals))


def k_fold(
    correspondences: Correspondences,
    poses: Poses,
    inliers: Sequence[Array],
    refit: Refit,
    folds: int = 4,
) -> HoldOut | None:
    """Hold out every view once, in `folds` rounds of every so-many-th view.

    Parameters
    ----------
    correspondences : Correspondences
    poses : Poses
        Of all views: where poses start from, in the training and in the test.
    inliers : sequence of (N,) bool arrays
        Points to use, the same for every estimator that is to be compared.
    refit : callable

    Returns
    -------
    HoldOut, or None where there are fewer than 4 views, or a fold cannot be estimated from the rest.
    """
    count = len(correspondences.views)
    if count < 4:
        return None
    folds = min(folds, count)
    found: list[Array] = [np.zeros((0, 2))] * count
    fits, trained = [], []
    for fold in range(folds):
        test = np.arange(fold, count, folds)
        train = np.setdiff1d(np.arange(count), test)
        try:
            solution = refit(_take(correspondences, train), poses[train], [inliers[int(i)] for i in train])
        except CamcalError:
            return None  # too few views are left to say anything
        kept = [correspondences.views[i].take(inliers[int(i)]) for i in test]
        held = replace(correspondences, views=tuple(kept))
        for i, r in zip(test, judge(solution, held, poses[test]), strict=True):
            found[int(i)] = r
        fits.append(solution)
        trained.append(train)
    return HoldOut(count, folds, tuple(found), tuple(fits), tuple(trained))


def judge(solution: Solution, held: Correspondences, poses: Poses) -> tuple[Array, ...]:
    """Residuals (N, 2) of views that a solution has not seen, their poses refitted, px."""
    board = solution.extras.get("board")
    if isinstance(board, BoardResult):
        held = on_board(held, board.ideal, board.points)
    found, _, _ = refine_poses(solution.camera, held.views, poses)
    return residuals(solution.camera, found, held)


def _take(correspondences: Correspondences, index: Array) -> Correspondences:
    return replace(correspondences, views=tuple(correspondences.views[i] for i in index))
