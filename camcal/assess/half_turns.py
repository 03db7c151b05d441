"""Which views show a board rotated by 180 degrees, for boards that look the same then: its own shape decides.

A board that is printed or glued unevenly has its point X displaced by d(X). Where a view counts the points from the
other end, X' = T X with the half turn T, displacements in the board's plane appear as -d(T X). Of

    even(X) = (d(X) - d(T X)) / 2,    odd(X) = (d(X) + d(T X)) / 2                                        (1)

the even part (a print that is longer in y, a shear) is the same either way and the odd one changes its sign. With A_vp
and b_vp the normal equations of the odd displacement of a pair of points p = {X, T X} in view v, all else held, signs
s_v = ±1 of the views lower the cost by

    ½ sᵀ G s,    G_vw = Σ_p b_vpᵀ (Σ_v A_vp)⁻¹ b_wp                                                       (2)

The signs of the leading eigenvector of G, and from there single views whose change raises (2), give the turns. They
are accepted where two things hold: a board of no odd displacement would let the best of all 2^(V-1) signs explain
as much with a probability below `board_shape.SIGNIFICANT` (sᵀ G s / σ² follows χ² of two degrees of freedom for each
pair, for any fixed signs), and a free board fits better with them than without by more than a choice for each view
explains.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import log

import numpy as np

from camcal.assess.board_shape import SIGNIFICANT
from camcal.assess.causes import LEAST_VIEWS
from camcal.assess.checks.facts import identified
from camcal.assess.figures import redundancy
from camcal.data.observations import Observations
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.numbers import TINY, distinct, distinct_rows
from camcal.least_squares.distributions import f_exceeded
from camcal.model.pose import Array, Pose, Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration, Estimate
from camcal.solve.poses import refine_poses
from camcal.solve.refine import How, as_designed, refit, residuals, subject_of
from camcal.solve.turns import Renaming, may_turn, turns_of

#: by how much n ln(cost) has to fall beyond 2 ln 2 for each view, whose turn is a choice between two: very strong
#: evidence in the table of Kass & Raftery (Bayes factors, 1995)
EVIDENCE = 10.0
#: step of the differences along the board, in parts of its extent
STEP = 1e-6
#: views that change sides in turn: one round settles them unless the camera was far off
ROUNDS = 4


@dataclass(frozen=True)
class Turned:
    """A fit whose views all count the points of the board from the same end.

    Attributes
    ----------
    fit : Estimate
        The given one with points of some views renamed: it projects to the same image points.
    views : tuple of str
        Those that were turned.
    turn : Pose
        The half turn, of the board in its own frame.
    """

    fit: Estimate
    views: tuple[str, ...]
    turn: Pose


def decided(flat: Estimate, how: How) -> Turned | None:
    """The fit with rotated views numbered from the other end; None if no view is rotated, or the data do not decide.

    Parameters
    ----------
    flat : Estimate
        With the board as designed.
    how : How
        How it was made.

    Raises
    ------
    CamcalError
        If a free board cannot be fitted.
    """
    turn = half_turn(flat.observations)
    if turn is None or len(flat.poses) < LEAST_VIEWS:
        return None
    gram, numbers = _gram(flat, turn)
    signs = _signs(gram)
    if signs is None or (signs > 0).all():
        return None
    views, plain = len(signs), np.ones(len(signs))
    least, explained = _least(views), float(signs @ gram @ signs)
    left = max(2 * flat.fit.cost - explained, 0.0)
    by_chance = _logarithm_of_chance(explained, numbers, left, redundancy(flat) - numbers)
    if (explained - plain @ gram @ plain) / _variance(flat) < least or by_chance > _allowed(views):
        return None  # (2) promises too little: not worth two fits
    data, free = flat.observations, replace(how, board="free")
    names = tuple(v for v, sign in zip(data.view_ids, signs, strict=True) if sign < 0)
    fit = replace(
        flat, poses=turned(flat.poses, data.view_ids, names, turn), observations=renamed(data, names, turn)
    )
    before, after = (refit(f, f.observations, free) for f in (flat, fit))
    freedom, costs = redundancy(after), (before.fit.cost, after.fit.cost)
    if freedom <= 0 or not 0 < costs[1] < costs[0]:
        return None
    evidence = redundancy(flat) * log(costs[0] / costs[1])
    by_chance = _logarithm_of_chance(explained, numbers, 2 * costs[1], freedom)
    if evidence < least or by_chance > _allowed(views):
        return None
    return Turned(fit, names, turn)


def decided_by_known(fit: Calibration, how: How) -> Turned | None:
    """The fit to a board of known shape with views counted from the end that fits their points better.

    Parameters
    ----------
    fit : Calibration
        Its target has the shape of an earlier report, and its points lie there.
    how : How
    """
    data, target = fit.observations, fit.observations.target or {}
    ideal = np.array(target["shape"]["ideal"], float) * float(target.get("square") or 1.0)
    turn = half_turn(data, ideal)
    if turn is None:
        return None
    names: set[str] = set()
    now = fit
    for _ in range(ROUNDS):
        other = renamed(now.observations, now.observations.view_ids, turn)
        there = turned(now.poses, other.view_ids, other.view_ids, turn)
        costs = [
            refine_poses(now.camera, rows.kept().views, poses)[1]
            for rows, poses in ((now.observations, now.poses), (other, there))
        ]
        better = {v for v, own, cost in zip(other.view_ids, *costs, strict=True) if cost < own}
        if not better:
            break
        names ^= better
        poses = turned(now.poses, other.view_ids, better, turn)
        now = refit(now, renamed(now.observations, better, turn), how, poses)
    evidence = redundancy(fit) * log(fit.fit.cost / now.fit.cost) if 0 < now.fit.cost < fit.fit.cost else 0.0
    if evidence < _least(len(fit.poses)):
        return None
    return Turned(now, tuple(v for v in data.view_ids if v in names), turn)


def half_turn(data: Observations, ideal: Array | None = None) -> Pose | None:
    """The half turn of a board in its plane after which it looks the same; None for boards whose orientation is known.

    `ideal` are its points (M, 3) as designed where the observations hold others.
    """
    target = data.target or {}
    if identified(data) or not may_turn(target):
        return None
    turns = turns_of(distinct(data.xyz, axis=0) if ideal is None else ideal)
    # cos(180 degrees) = -1 of half a turn in the plane; quarter turns have 0
    return next((t for t in turns[1:] if t.rotation[0, 0] < -0.5), None)


def renamed(data: Observations, names: Collection[str], turn: Pose) -> Observations:
    """The observations with the points of some views counted from the other end."""
    columns = data.xyz.copy(), None if data.point is None else data.point.copy()
    board = Renaming.of(data)
    for block in np.flatnonzero(_among(data.view_ids, names)[data.blocks.view]):
        board.rename(columns, data.slices[block], turn)
    return replace(data, xyz=columns[0], point=columns[1])


def turned(poses: Poses, view_ids: Sequence[str], names: Collection[str], turn: Pose) -> Poses:
    """The poses (V,) of views, adjusted for those in `renamed` so that points keep their positions."""
    some = _among(view_ids, names)
    return Poses.stack([p @ turn.inverse() if s else p for p, s in zip(poses, some, strict=True)])


def _among(view_ids: Sequence[str], names: Collection[str]) -> Array:
    return np.array([v in names for v in view_ids], bool)


def _logarithm_of_chance(explained: float, numbers: int, left: float, freedom: int) -> float:
    """ln of the probability that this number of parameters explains as much by chance, given the remaining squares."""
    if freedom <= 0 or left <= 0:
        return -np.inf if explained > 0 else 0.0
    return log(max(f_exceeded(explained / numbers / (left / freedom), numbers, freedom), TINY))


def _least(views: int) -> float:
    """The minimum evidence at which half turns of this number of views are accepted."""
    return 2 * log(2) * views + EVIDENCE


def _allowed(views: int) -> float:
    """The maximum of `_logarithm_of_chance` at which half turns are accepted: one choice in 2^(V-1) was made."""
    return log(SIGNIFICANT) - (views - 1) * log(2)


def _variance(fit: Estimate) -> float:
    """The variance of a coordinate, in the unit of the weights."""
    return max(2 * fit.fit.cost / redundancy(fit), np.finfo(float).tiny)


def _gram(fit: Estimate, turn: Pose) -> tuple[Array, int]:
    """G (V, V) of (2), and how many numbers the odd displacement has."""
    data = as_designed(fit)
    views, used = len(fit.poses), data.used & np.isfinite(fit.residuals).all(1)
    first, point = distinct_rows(data.xyz)
    points = data.xyz[first]
    other = Neighbours(points).query(turn.apply(points))[1]
    pair = np.minimum(np.arange(len(points)), other)[point]
    step = STEP * float(np.ptp(points, axis=0).max())
    subject = subject_of(fit)
    slopes = [
        (residuals(subject, fit.poses, replace(data, xyz=data.xyz + step * axis)) - fit.residuals) / step
        for axis in np.eye(3)[:2]
    ]
    jacobian = np.stack(slopes, -1)[used]  # (N, 2, 2)
    weight = np.ones(used.sum()) if data.precision is None else data.precision[used]
    a = np.zeros((len(points), 2, 2))
    b = np.zeros((views, len(points), 2))
    np.add.at(a, pair[used], np.einsum("n,nci,ncj->nij", weight, jacobian, jacobian))
    pull = np.einsum("n,nci,nc->ni", weight, jacobian, fit.residuals[used])
    np.add.at(b, (data.view[used], pair[used]), pull)
    solved = np.linalg.pinv(a, hermitian=True)
    shifts = (b[:, :, None] @ solved)[:, :, 0]
    return shifts.reshape(views, -1) @ b.reshape(views, -1).T, 2 * len(distinct(pair[used]))


def _signs(gram: Array) -> Array | None:
    """Signs (V,) that make (2) largest, most of them positive; None where it is not finite."""
    if not np.isfinite(gram).all():
        return None
    cross = gram - np.diag(np.diag(gram))  # squares do not depend on signs
    signs = np.where(np.linalg.eigh(cross)[1][:, -1] < 0, -1.0, 1.0)
    for _ in range(len(signs)):
        gains = -signs * (cross @ signs)  # of changing one
        best = int(np.argmax(gains))
        if not gains[best] > 0:
            break
        signs[best] = -signs[best]
    return signs if 2 * (signs > 0).sum() >= len(signs) else -signs
