"""Whether a board's shape is to be believed: a significance test and the error on views held out.

Against the flat board, with C the weighted sums of squares and B the parameters of the shape,

    F = ((C_flat - C_shape) / B) / (C_shape / (2N - p))                                               (1)

follows F(B, 2N - p) where the board is flat. The test alone would believe any systematic error that a shape
happens to absorb; the hold-out asks whether the shape found from some views improves the others. A free board has
so many parameters that it can do both and leave the camera worse than it was; `truer_camera.py` asks for that.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import f as f_distribution

from camcal.assess import figures
from camcal.assess.holdout import HoldOut, k_fold
from camcal.assess.shape_benefit import Change, change
from camcal.data.observations import Correspondences
from camcal.errors import CamcalError
from camcal.model.pose import Array, Poses
from camcal.solve.solution import Solution
from camcal.solve.solve import BoardResult

#: a shape is believed below this p-value ...
SIGNIFICANT = 0.001
#: ... if the hold-out error is below this part of that of any simpler board: on a dozen views, the choice of
#: the folds alone moves it by 2 %
BETTER = 0.98
#: simple shapes first
CANDIDATES = ("bowl", "print", "free")

#: estimates with a kind of shape from these views, poses to start from and points to use
Fit = Callable[[str, Correspondences, Poses, Sequence[Array]], Solution]


@dataclass(frozen=True)
class Trial:
    """One kind of board: its solution, the p-value of (1), its hold-out, and what it does to the camera.

    `change` is against the simpler board that was best till then; None where that is not asked.
    """

    kind: str
    solution: Solution
    p_value: float
    holdout: HoldOut | None
    change: Change | None = None

    @property
    def holdout_rms(self) -> float:
        """rms_point over the held-out views, px; inf without a hold-out."""
        return self.holdout.figures.rms_point if self.holdout else float("inf")


def p_value(flat: Solution, shaped: Solution) -> float:
    """The p-value of (1): how likely a flat board would lower the cost as much."""
    board = shaped.extras["board"]
    freedom = figures.redundancy(shaped)
    if freedom <= 0 or shaped.fit.cost <= 0:
        return 1.0
    ratio = (flat.fit.cost - shaped.fit.cost) / board.size / (shaped.fit.cost / freedom)
    return float(f_distribution.sf(max(ratio, 0.0), board.size, freedom))


def attempt(kind: str, flat: Solution, ideal: Correspondences, fit: Fit) -> Trial | None:
    """A kind of shape on the data of a flat solution; None where they do not allow it.

    Parameters
    ----------
    kind : str
        `flat` or a key of `camcal.solve.board.KINDS`.
    flat : Solution
    ideal : Correspondences
        With the ideal board.
    fit : callable
    """
    try:
        solution = flat if kind == "flat" else fit(kind, ideal, flat.poses, flat.inliers)
    except CamcalError:
        return None
    held = k_fold(ideal, flat.poses, flat.inliers, lambda c, p, m: fit(kind, c, p, m))
    return Trial(kind, solution, 1.0 if kind == "flat" else p_value(flat, solution), held)


def choose(flat: Solution, ideal: Correspondences, fit: Fit) -> tuple[Trial, tuple[Trial, ...]]:
    """The simplest board that no other beats, and all that were tried.

    A shape must be significant, lower the hold-out error by more than the choice of folds does, and, if it is
    the free one, leave a camera that is expected to be truer.
    """
    trials = [t for k in ("flat", *CANDIDATES) if (t := attempt(k, flat, ideal, fit)) is not None]
    best, tried = trials[0], trials[:1]
    for trial in trials[1:]:
        if trial.kind == "free":
            with contextlib.suppress(np.linalg.LinAlgError):  # a camera that the data leave open is not truer
                trial = replace(trial, change=change(best.solution, trial.solution))
        tried.append(trial)
        real = trial.p_value < SIGNIFICANT and trial.holdout_rms < BETTER * best.holdout_rms
        if real and (trial.kind != "free" or (trial.change is not None and trial.change.truer)):
            best = trial
    return best, tuple(tried)


def described(trial: Trial, trials: Sequence[Trial], square: float) -> dict[str, Any]:
    """What the report says under `target.shape`; lengths in units of the square (or of the data).

    Returns
    -------
    dict
        kind, points [[X, Y, Z], ...] in the order of the board's corners, the ideal ones alike, rms_offset,
        max_offset, p_value, aspect and angle of the print, words, and the errors of each kind that was tried.
    """
    board = trial.solution.extras.get("board")
    said: dict[str, Any] = {"kind": trial.kind, "p_value": trial.p_value}
    if isinstance(board, BoardResult):
        offset = (board.points - board.ideal) / square
        size = np.linalg.norm(offset, axis=1)
        aspect, angle = printed(board)
        said |= {
            "aspect": aspect,
            "angle": angle,
            "rms_offset": float(np.sqrt((size**2).mean())),
            "max_offset": float(size.max()),
            "words": words(board, square),
            "points": (board.points / square).tolist(),
            "ideal": (board.ideal / square).tolist(),
        }
    if trials:
        said["tried"] = [
            {"kind": t.kind, "rms_point": t.solution.rms_point, "holdout_rms_point": t.holdout_rms,
             "p_value": t.p_value} | _of_change(t.change, square)
            for t in trials
        ]  # fmt: skip
    return said


def _of_change(change: Change | None, square: float) -> dict[str, float]:
    """Expected errors of the camera with the simpler board and with the shape, and the offsets assumed."""
    if change is None:
        return {}
    return {
        "offset_sigma": change.tau / square,
        "simpler_error_px": change.simple_px,
        "error_px": change.shaped_px,
    }


def printed(board: BoardResult) -> tuple[float, float]:
    """How much longer the print is in y against x than designed, and the angle of its sides in degrees."""
    ideal, points = (x[:, :2] - x[:, :2].mean(0) for x in (board.ideal, board.points))
    (xx, xy), (yx, yy) = np.linalg.lstsq(ideal, points, rcond=None)[0]
    lengths = np.hypot(xx, xy), np.hypot(yx, yy)
    cosine = (xx * yx + xy * yy) / (lengths[0] * lengths[1])
    return float(lengths[1] / lengths[0]), float(np.degrees(np.arccos(cosine)))


def words(board: BoardResult, square: float) -> str:
    """The shape in a sentence: how far it bends out of its plane and how uneven the print is."""
    offset = (board.points - board.ideal) / square
    plane = np.c_[board.ideal[:, :2], np.ones(len(offset))]
    out = offset[:, 2] - plane @ np.linalg.lstsq(plane, offset[:, 2], rcond=None)[0]
    depth, place = np.ptp(out), np.sqrt((offset[:, :2] ** 2).sum(1).mean())
    aspect, angle = printed(board)
    longer = "longer" if aspect > 1 else "shorter"
    return (
        f"the board bends by {depth:.2g} squares out of its plane and its corners lie "
        f"{place:.2g} squares (rms) off the ideal grid; the print is {100 * abs(aspect - 1):.2g} % {longer} in y "
        f"than in x, its sides at {angle:.2f} degrees"
    )


def with_shape(trial: Trial, trials: Sequence[Trial]) -> Solution:
    """The trial's solution with the shape in its target, and the hold-out in its place."""
    solution = trial.solution
    target = dict(solution.correspondences.target or {})
    target["shape"] = described(trial, trials, float(target.get("square") or 1.0))
    data = replace(solution.correspondences, target=target)
    return replace(solution, correspondences=data)
