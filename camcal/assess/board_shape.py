"""The shape of a board: its significance test, and its description in the report.

Compared with the flat board, with C the weighted sums of squares and B the number of shape parameters,

    F = ((C_flat - C_shape) / B) / (C_shape / (2N - p))                                               (1)

follows F(B, 2N - p) if the board is flat. The test alone would accept any systematic error that a shape happens to
absorb; `camcal.plan.better` tests whether the shape found from some views improves the others. A free board has so
many parameters that it can pass both tests and still make the camera worse; `shape_benefit.py` tests for that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.assess import figures
from camcal.assess.holdout import HoldOut
from camcal.assess.shape_benefit import Change
from camcal.data.boards import frames, names_of
from camcal.least_squares.distributions import f_exceeded
from camcal.records import dataclass
from camcal.solve.board import PLACED
from camcal.solve.calibration import Estimate, ShapedBoard
from camcal.solve.several_boards import kinds_of

#: a shape is accepted below this p-value: one in a thousand flat boards passes
SIGNIFICANT = 0.001
#: simple shapes first
CANDIDATES = ("bowl", "print", "free")


@dataclass(frozen=True)
class Trial:
    """One kind of board: its fit, the p-value of (1), its hold-out, and its effect on the camera.

    `change` is relative to the best simpler board so far; None if it is not computed.
    """

    kind: str
    calibration: Estimate
    p_value: float
    holdout: HoldOut | None
    change: Change | None = None

    @property
    def holdout_rms(self) -> float | None:
        """rms_point over the held-out views, px; None without hold-out."""
        return self.holdout.figures.rms_point if self.holdout else None


def p_value(flat: Estimate, shaped: Estimate) -> float:
    """The p-value of (1): the probability that a flat board's noise would lower the cost as much.

    `flat` may have a simpler shape; B is then the number of additional parameters.
    """
    assert shaped.board is not None
    freedom = figures.redundancy(shaped)
    if freedom <= 0 or shaped.fit.cost <= 0:
        return 1.0
    before = 0 if flat.board is None else flat.board.size - flat.board.placed
    size = shaped.board.size - shaped.board.placed - before
    ratio = (flat.fit.cost - shaped.fit.cost) / size / (shaped.fit.cost / freedom)
    return f_exceeded(max(ratio, 0.0), size, freedom)


def described(
    calibration: Estimate, p_value: float, trials: Sequence[Trial], square: float
) -> dict[str, Any]:
    """The entry `target.shape` of the report; lengths in units of the square (or of the data).

    Returns
    -------
    dict
        kind, points [[X, Y, Z], ...] in the order of the board's corners, the ideal ones likewise, rms_offset,
        max_offset, p_value, aspect and angle of the print, words, and the errors of each kind that was tried.
    """
    board, target = calibration.board, calibration.observations.target or {}
    if board is not None and board.kind == PLACED:
        board = None
    said: dict[str, Any] = {"kind": "flat" if board is None else board.kind, "p_value": p_value}
    if board is not None and board.label is None:
        said |= _of_board(board, square)
    elif board is not None:
        own = {n: _of_board(b, square) for n, b in separate(board, target).items()}
        size = np.linalg.norm(board.points - board.ideal, axis=1) / square
        said |= {
            "rms_offset": float(np.sqrt((size**2).mean())),
            "max_offset": float(size.max()),
            "words": "; ".join(f"board {n}: {o['words']}" for n, o in own.items()),
            "boards": own,
        }
    if trials:
        said["tried"] = [_of_trial(t, square) for t in trials]
    return said


def separate(board: ShapedBoard, target: Mapping[str, Any]) -> dict[str, ShapedBoard]:
    """Several boards one by one, each in its own frame; those that are as designed are omitted."""
    assert board.label is not None and board.numbers is not None
    found = {}
    for index, (name, pose) in enumerate(zip(names_of(target), frames(target), strict=True)):
        own, back = board.label == index, pose.inverse()
        if (board.points[own] != board.ideal[own]).any():
            ideal, points = back.apply(board.ideal[own]), back.apply(board.points[own])
            kind = kinds_of(board.kind, len(frames(target)))[index]
            found[name] = ShapedBoard(kind, ideal, points, board.size, numbers=board.numbers[own])
    return found


def _of_board(board: ShapedBoard, square: float) -> dict[str, Any]:
    """The entry of one board."""
    offset = (board.points - board.ideal) / square
    size = np.linalg.norm(offset, axis=1)
    aspect, angle = printed(board)
    said = {
        "aspect": aspect,
        "angle": angle,
        "rms_offset": float(np.sqrt((size**2).mean())),
        "max_offset": float(size.max()),
        "words": words(board, square),
        "points": (board.points / square).tolist(),
        "ideal": (board.ideal / square).tolist(),
    }
    return said if board.numbers is None else {"kind": board.kind, **said, "numbers": board.numbers.tolist()}


def _of_trial(trial: Trial, square: float) -> dict[str, Any]:
    """The errors of a kind of board; with a change, the expected errors of the camera and the assumed offsets."""
    said: dict[str, Any] = {
        "kind": trial.kind,
        "rms_point": trial.calibration.rms_point,
        "holdout_rms_point": trial.holdout_rms,
        "p_value": trial.p_value,
    }
    if trial.change is not None:
        said |= {
            "offset_sigma": trial.change.tau / square,
            "simpler_error_px": trial.change.simple_px,
            "error_px": trial.change.shaped_px,
        }
    return said


def printed(board: ShapedBoard) -> tuple[float, float]:
    """The stretch of the print in y relative to x compared with the design, and the angle of its sides in degrees."""
    ideal, points = (x[:, :2] - x[:, :2].mean(0) for x in (board.ideal, board.points))
    (xx, xy), (yx, yy) = np.linalg.lstsq(ideal, points, rcond=None)[0]
    lengths = np.hypot(xx, xy), np.hypot(yx, yy)
    cosine = (xx * yx + xy * yy) / (lengths[0] * lengths[1])
    return float(lengths[1] / lengths[0]), float(np.degrees(np.arccos(cosine)))


def words(board: ShapedBoard, square: float) -> str:
    """Describe the shape in a sentence: how far the board bends out of its plane and how uneven the print is."""
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
