"""Several boards with rotational symmetries: from which end each view counted the points of its board.

A view of such a board has several poses, P s with the symmetries s of the board, one of which is that of the board as
the other views count it. Two lists of poses at the same instants are joined by the relative pose with which most
instants agree in one of their poses; once all groups are put together, the boards' places at each instant decide which
pose a view has, and its points are renamed.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations, product
from math import comb

import numpy as np

from camcal.data.boards import labels, names_of
from camcal.data.observations import Observations
from camcal.geometry import rotations
from camcal.geometry.numbers import distinct
from camcal.model.pose import Pose, Poses
from camcal.routes.hand_eye.equation import robot_pose
from camcal.solve.calibration import Calibration
from camcal.solve.rig_start import NEARER, TRIED
from camcal.solve.turns import Renaming, may_turn, turns_of

Array = np.ndarray

#: samples of three instants from which the equation of two pairs is solved: half of the instants may be outliers, and
#: a sample is then good with a probability of 1/8; of 40 one is, but for one time in 200
SAMPLES = 40
#: rad; motions of both sides have the same angle but for noise, of two poses on each: a few tenths of a degree where
#: boards are seen well. Wrong turns miss by tens of degrees, but for chance
SAME_ANGLE = np.radians(3.0)

#: the symmetries of each board, the identity first
Turns = tuple[tuple[Pose, ...], ...]


def board_turns(fits: Mapping[str, Calibration]) -> Turns:
    """The rotations after which each of several boards looks the same, from all its points that any camera saw."""
    data = [fit.observations for fit in fits.values()]
    count = len(names_of(data[0].target))
    found = []
    for board in range(count):
        own = [d.xyz[_of_board(d, board)] for d in data]
        points = distinct(np.concatenate(own), axis=0)
        turns = turns_of(points) if len(points) and may_turn(data[0].target or {}) else (Pose.identity(),)
        found.append(turns)
    return tuple(found)


def _of_board(data: Observations, board: int) -> Array:
    which = labels(data)
    assert which is not None
    return np.asarray(which == board)


def agreed(a: Poses, b: Poses, corners: Array) -> tuple[Poses, Poses]:
    """Of lists of poses at the same instants, those with which most instants have one relative pose.

    Parameters
    ----------
    a, b : Poses
        a_from_x (T, A) and b_from_x (T, B), the poses of the views as they are first.
    corners : (C, 3) array
        Points by whose distances poses are compared.

    Returns
    -------
    a, b : Poses (T,)
    """
    if a.shape[1] == b.shape[1] == 1:
        return Poses.of(a[:, 0]), Poses.of(b[:, 0])
    tried = np.unique(np.linspace(0, len(a) - 1, min(len(a), TRIED)).round().astype(int))
    ways = list(product(range(a.shape[1]), range(b.shape[1])))
    scores = []
    for i, j in ways:
        relative = Poses.of(a[tried, i] @ b[tried, j].inverse())
        each = [float(np.median(_apart(a, b, r, corners).reshape(len(a), -1).min(1))) for r in relative]
        scores.append((min(each), relative[int(np.argmin(each))]))
    plain, best = scores[0], min(scores, key=lambda s: s[0])
    relative = best[1] if best[0] < NEARER * plain[0] else plain[1]
    apart = _apart(a, b, relative, corners).reshape(len(a), -1)
    return _taken(a, b, apart, ways)


def _apart(a: Poses, b: Poses, relative: Pose, corners: Array) -> Array:
    """The distance (T, A, B) of boards as a has them from where b has them, as a part of their distance from a."""
    one, other = a[:, :, None].apply(corners), Poses.of(relative @ b)[:, :, None].apply(corners)
    far = np.maximum(np.linalg.norm(other.mean(2), axis=-1), np.finfo(float).tiny)
    off = one[:, :, None] - other[:, None]
    return np.asarray(np.sqrt(np.square(off).sum(-1).mean(-1)) / far[:, None])


def _taken(a: Poses, b: Poses, apart: Array, ways: list[tuple[int, int]]) -> tuple[Poses, Poses]:
    """The pair of poses of each instant that is nearest, (T, ways): the first unless another is much nearer."""
    best = np.where(apart.min(1) < NEARER * apart[:, 0], apart.argmin(1), 0)
    first, second = np.array(ways)[best].T
    rows = np.arange(len(a))
    return Poses.of(a[rows, first]), Poses.of(b[rows, second])


def agreed_both(
    robot: Poses, camera: Poses, solved: Callable[[Poses, Poses], tuple[Pose, Pose] | None]
) -> tuple[Poses, Poses] | None:
    """Of lists of poses of both sides of G Z = X C, those for which most instants have one X and one Z.

    Parameters
    ----------
    robot, camera : Poses
        G (T, A) and C (T, B).
    solved : function of G (S,) and C (S,)
        X and Z, None where they are not determined.

    Returns
    -------
    robot, camera : Poses (T,), or None
        None where no sample determines X and Z.
    """
    if robot.shape[1] == camera.shape[1] == 1:
        return Poses.of(robot[:, 0]), Poses.of(camera[:, 0])
    best: tuple[float, Poses, Poses] | None = None
    for sample in _samples(len(robot)):
        for ways in _ways(robot[sample], camera[sample]):
            one, other = (
                Poses.stack([poses[t, way[k]] for t, way in zip(sample, ways, strict=True)])
                for k, poses in enumerate((robot, camera))
            )
            found = _nearest(robot, camera, solved(one, other))
            if found is not None and (best is None or found[0] < best[0]):
                best = found
    while best is not None:  # from all instants, while they agree better
        again = _nearest(robot, camera, solved(*best[1:]))
        if again is None or not again[0] < best[0]:
            break
        best = again
    return None if best is None else best[1:]


def _nearest(
    robot: Poses, camera: Poses, found: tuple[Pose, Pose] | None
) -> tuple[float, Poses, Poses] | None:
    """The poses (T,) of both sides that are nearest to a solution, and their median misfit."""
    if found is None:
        return None
    ways = list(product(range(robot.shape[1]), range(camera.shape[1])))
    off = np.stack([_misfit(*found, Poses.of(robot[:, i]), Poses.of(camera[:, j])) for i, j in ways], 1)
    rows, (first, second) = np.arange(len(robot)), np.array(ways)[off.argmin(1)].T
    return float(np.median(off.min(1))), Poses.of(robot[rows, first]), Poses.of(camera[rows, second])


def _misfit(x: Pose, z: Pose, robot: Poses, camera: Poses) -> Array:
    """How far (T,) the poses of X C Z⁻¹ are from G: the rotation, rad, and the shift as a part of the distance."""
    implied = robot_pose("to-hand", x, z, camera)
    turn = rotations.log(implied.rotation @ np.swapaxes(robot.rotation, 1, 2))
    far = np.linalg.norm(robot.translation, axis=1)
    shift = np.linalg.norm(implied.translation - robot.translation, axis=1) / far
    return np.asarray(np.linalg.norm(turn, axis=1) + shift)


def _samples(count: int) -> Iterator[Array]:
    """Three different instants each, none twice; all that there are of few.

    They are drawn by their rank in the combinatorial number system: i < j < k have C(i, 1) + C(j, 2) + C(k, 3). A list
    of all would have 166 million entries for 1,000 instants.
    """
    total = comb(count, 3)
    for rank in np.random.default_rng(0).choice(total, min(SAMPLES, total), replace=False).tolist():
        chosen: list[int] = []
        for size in (3, 2, 1):
            last = bisect_right(range(count), rank, key=partial(_combinations, size)) - 1
            chosen.insert(0, last)
            rank -= comb(last, size)
        yield np.array(chosen)


def _combinations(size: int, count: int) -> int:
    return comb(count, size)


def _ways(robot: Poses, camera: Poses) -> Iterator[tuple[tuple[int, int], ...]]:
    """The choices of a pose on both sides at each instant of a sample whose motions have the same angles."""
    each = list(product(range(robot.shape[1]), range(camera.shape[1])))
    for ways in product(each, repeat=len(robot)):
        if all(
            abs(_angle(robot, i, ways[i][0], j, ways[j][0]) - _angle(camera, i, ways[i][1], j, ways[j][1]))
            < SAME_ANGLE
            for i, j in combinations(range(len(robot)), 2)
        ):
            yield ways


def _angle(poses: Poses, i: int, one: int, j: int, other: int) -> float:
    turn = poses.rotation[i, one] @ poses.rotation[j, other].T
    return float(np.linalg.norm(rotations.log(turn)))


def chosen_turns(poses: Poses, variance: Array, corners: Array) -> Array:
    """Which of the poses (R, K) of the views of one instant agree, (R,).

    Each pose of each view is tried for the place of the boards; that which the others' nearest poses are nearest to is
    taken. Where several are as near, as of a single board, most views keep their first pose.
    """
    places = poses[:, :, None].apply(corners)
    off = places[:, :, None, None] - places[None, None]  # (R, K, R, K, C, 3)
    apart = np.sqrt(np.square(off).sum(-1).mean(-1))
    cost = apart.min(-1).sum(-1) + np.sqrt(variance)[:, None]
    row = int(cost.min(1).argmin())
    own = apart[row]
    turns = np.where(own.min(2) < NEARER * own[:, :, 0], own.argmin(2), 0)  # (K, R)
    as_near = cost[row] * NEARER <= cost[row].min()
    kept = np.where(as_near, (turns == 0).sum(1), -1)
    return np.asarray(turns[int(kept.argmax())])


def renamed(fit: Calibration, board: Mapping[str, int], turn: Mapping[str, int], turns: Turns) -> Calibration:
    """A camera's fit with the points of some views renumbered by a symmetry of their board, and the poses accordingly.

    Parameters
    ----------
    fit : Calibration
    board, turn : mappings of view -> index
        Which board a view shows, and which of its turns is to be applied.
    turns : Turns
    """
    data = fit.observations
    columns = data.xyz.copy(), None if data.point is None else data.point.copy()
    poses, made = list(fit.poses), {}
    for index, view in enumerate(data.view_ids):
        if not turn.get(view):
            continue
        own = board[view]
        if own not in made:
            made[own] = Renaming.of(data.where(_of_board(data, own)))
        pose = turns[own][turn[view]]
        made[own].rename(columns, data.slices[index], pose.inverse())
        poses[index] = fit.poses[index] @ pose
    data = replace(data, xyz=columns[0], point=columns[1])
    return replace(fit, observations=data, poses=Poses.stack(poses))
