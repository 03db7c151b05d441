"""The relative poses of several boards that are fixed to each other while the rig, or they together, move.

Every picture is P = (camera in its group) · R_t · (board in its group), with R_t the pose of the rig at its instant.
Cameras whose relative poses are known are a group, boards likewise; at first each is one by itself. Until nothing
changes,

1. two groups of cameras that see one group of boards at the same instants are put together,
2. two groups of boards that one group of cameras sees at the same instants are put together,
3. where two groups of cameras see two groups of boards each, at the same instants but never the same ones, both
   relative poses together follow from G Z = X C, the equation of robot-world and hand-eye calibration, whose closed
   form (Shah 2013) takes one pair of groups for the robot and the other for its camera.

The boards of a group have one frame from then on, so that the rest of the calibration sees one target of several parts.
Which instants agree is decided as for cameras (`camcal.solve.rig_start.link`). Boards that look the same after a turn
have several poses in each view until all groups are put together (`camcal.plan.rig_turns`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from itertools import combinations
from typing import Any

import numpy as np

from camcal.data.boards import labels, names_of
from camcal.data.rig_table import RigViews
from camcal.errors import CamcalError
from camcal.model.pose import Pose, Poses
from camcal.plan.rig_cameras import board_variance
from camcal.plan.rig_turns import Turns, agreed, agreed_both, board_turns, chosen_turns, renamed
from camcal.records import dataclass
from camcal.routes.hand_eye import motions, shah
from camcal.routes.hand_eye.closed_forms import length_unit, scaled
from camcal.routes.hand_eye.equation import residuals
from camcal.routes.hand_eye.views import Views
from camcal.solve.calibration import Calibration
from camcal.solve.rig_start import Link, corners_of, link

Array = np.ndarray

#: boards count as fixed where the instants agree on the place of one before the other to this part of their distance: a
#: board in a hand moves by more from picture to picture, cameras calibrated alone leave less
FAST = 0.05
#: two groups that were put together, and the number of instants they share
_Pair = tuple[int, int, int] | None


@dataclass(frozen=True)
class Layout:
    """Which boards are fixed to each other, and their poses.

    Attributes
    ----------
    groups : tuple of int
        The group of each board.
    poses : tuple of Pose
        group_from_board; the identity of the first board of a group.
    found : tuple of str
        How groups were put together, for the report.
    turned : mapping of camera -> mapping of view -> int
        Which of the turns of its board (`board_turns`) is to be applied to a view.
    """

    groups: tuple[int, ...]
    poses: tuple[Pose, ...]
    found: tuple[str, ...] = ()
    turned: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def turned_pictures(self) -> int:
        """The number of views that counted a board from another end."""
        return sum(len(own) for own in self.turned.values())


@dataclass(frozen=True)
class _Sights:
    """Every view of a board: which camera and board, when, cam_from_board, and the variance of the board's place.

    `turned` (S, K) are the poses of each view with its board turned by each of its symmetries, the first those of
    `poses`; boards with fewer symmetries repeat their first pose.
    """

    camera: Array
    board: Array
    instant: Array
    view: tuple[str, ...]
    variance: Array
    turned: Poses


class _Groups:
    """Cameras, or boards, with known relative poses: the group and the pose group_from_member of each."""

    def __init__(self, count: int):
        self.of = np.arange(count)
        self.poses = [Pose.identity() for _ in range(count)]

    def join(self, one: int, other: int, one_from_other: Pose) -> None:
        """Merge the members of another group into one."""
        for member in np.flatnonzero(self.of == other):
            self.poses[member] = one_from_other @ self.poses[member]
        self.of[self.of == other] = one


def layout(
    fits: Mapping[str, Calibration], views: RigViews, asked: str, rig: Mapping[str, Pose] | None = None
) -> Layout:
    """Which boards are fixed, and their poses, from each camera alone.

    Parameters
    ----------
    fits : mapping of camera -> Calibration
    views : RigViews
        With boards.
    asked : str
        As for `--boards`. With `fixed` every pair of boards is taken as fixed, with `moving` none; with `auto` those
        whose relative pose is the same at all instants, and those without which cameras are not connected.
    rig : mapping of camera -> Pose, optional
        cam_from_rig of cameras that are known.
    """
    names = names_of(next(iter(views.parts.values())).target)
    boards, turns = _Groups(len(names)), board_turns(fits)
    if asked == "moving" and max(map(len, turns)) == 1:
        return Layout(tuple(range(len(names))), tuple(boards.poses))
    sights = _sights(fits, views, turns)
    corners = corners_of(np.concatenate([f.observations.xyz for f in fits.values()]))
    cameras = _Groups(len(fits))
    if rig is not None:
        cameras.of[:] = 0
        cameras.poses = [rig[name].inverse() for name in fits]
    believed = np.inf if asked == "fixed" else FAST
    found: list[str] = []
    rounds: tuple[Callable[[], str], ...] = (
        lambda: _by_cameras(sights, cameras, boards, corners, list(fits)),
        lambda: _by_boards(sights, cameras, boards, corners, names, believed),
        lambda: _by_both(sights, cameras, boards, list(fits), names, corners),
    )
    if asked == "moving":
        rounds = rounds[:1]
    while said := next((s for step in rounds if (s := step())), ""):
        found.append(said)
    turned = _turned(sights, cameras, boards, corners)
    for board, own in enumerate(turns):  # its frame is that of most views
        usual = int(np.bincount(turned[sights.board == board], minlength=1).argmax())
        boards.poses[board] = boards.poses[board] @ own[usual].inverse()
    by_camera = _by_camera(sights, _turned(sights, cameras, boards, corners), list(fits))
    return Layout(*_from_first(boards), tuple(found), by_camera)


def _turned(sights: _Sights, cameras: _Groups, boards: _Groups, corners: Array) -> Array:
    """The symmetry (S,) by which the board of each view is to be rotated, if cameras and boards have poses."""
    found = np.zeros(len(sights.camera), int)
    if sights.turned.shape[1] > 1:
        keys = np.stack([cameras.of[sights.camera], boards.of[sights.board], sights.instant], 1)
        _, of_row = np.unique(keys, axis=0, return_inverse=True)
        for index in range(int(of_row.max()) + 1):
            rows = np.flatnonzero(of_row.reshape(-1) == index)
            placed = _placed_poses(sights, cameras, boards, rows)
            found[rows] = chosen_turns(placed, sights.variance[rows], corners)
    return found


def _by_camera(sights: _Sights, turned: Array, names: Sequence[str]) -> dict[str, dict[str, int]]:
    found: dict[str, dict[str, int]] = {name: {} for name in names}
    for row in np.flatnonzero(turned):
        found[names[sights.camera[row]]][sights.view[row]] = int(turned[row])
    return found


def _placed_poses(sights: _Sights, cameras: _Groups, boards: _Groups, rows: Array) -> Poses:
    """group of cameras from group of boards of some views, with each symmetry of the board, (R, K)."""
    first = Poses.stack([cameras.poses[c] for c in sights.camera[rows]])
    last = Poses.stack([boards.poses[b].inverse() for b in sights.board[rows]])
    return Poses.of(first[:, None] @ sights.turned[rows] @ last[:, None])


def _from_first(boards: _Groups) -> tuple[tuple[int, ...], tuple[Pose, ...]]:
    """The groups numbered from 0, each in the frame of its first board."""
    order = list(dict.fromkeys(boards.of.tolist()))
    first = {g: boards.poses[int(np.flatnonzero(boards.of == g)[0])].inverse() for g in order}
    poses = tuple(first[g] @ p for g, p in zip(boards.of.tolist(), boards.poses, strict=True))
    return tuple(order.index(g) for g in boards.of.tolist()), poses


def _sights(fits: Mapping[str, Calibration], views: RigViews, turns: Turns) -> _Sights:
    place = {instant: i for i, instant in enumerate(views.order)}
    rows, named, poses, variance = [], [], [], []
    most = max(map(len, turns))
    for index, (name, fit) in enumerate(fits.items()):
        own = board_variance(fit)
        for i, view in enumerate(fit.observations.view_ids):
            board = views.boards[name][view]
            rows.append((index, board, place[views.instants[name][view]]))
            named.append(view)
            each = [fit.poses[i] @ turn for turn in turns[board]]
            poses.append(Poses.stack(each + each[:1] * (most - len(each))))
            variance.append(float(own[i]))
    camera, board, instant = np.array(rows).T
    return _Sights(camera, board, instant, tuple(named), np.array(variance), Poses.stack(poses))


def _seen(
    sights: _Sights, cameras: _Groups, boards: _Groups, group: int, board: int
) -> tuple[Array, Poses, Array]:
    """Common instants (T,) of cameras and boards, poses (T, K), and the variance: of the best picture each."""
    rows = np.flatnonzero((cameras.of[sights.camera] == group) & (boards.of[sights.board] == board))
    rows = rows[np.lexsort((sights.variance[rows], sights.instant[rows]))]
    instants, first = np.unique(sights.instant[rows], return_index=True)
    rows = rows[first]
    return instants, _placed_poses(sights, cameras, boards, rows), sights.variance[rows]


def _link(a: tuple[Array, Poses, Array], b: tuple[Array, Poses, Array], corners: Array) -> Link | None:
    """The estimate of a_from_b from shared instants, for poses a_from_x and b_from_x (T, K); None without any."""
    _, i, j = np.intersect1d(a[0], b[0], return_indices=True)
    if not len(i):
        return None
    one, other = agreed(a[1][i], b[1][j], corners)
    return link(one, other, a[2][i] + b[2][j], [Pose.identity()], corners)


def _join_best(groups: _Groups, others: _Groups, linked: Callable[[int, int, int], Link | None]) -> _Pair:
    """Join the two groups whose relative pose is best determined through one group of the other kind.

    `linked` estimates first_from_second of two groups by way of a third. None where it does for no two.
    """
    pairs, between = combinations(np.unique(groups.of).tolist(), 2), np.unique(others.of).tolist()
    tried = [(k, a, b) for a, b in pairs for c in between if (k := linked(a, b, c)) is not None]
    if not tried:
        return None
    best, a, b = max(tried, key=lambda t: t[0].information)
    groups.join(a, b, best.pose)
    return a, b, best.shared


def _by_cameras(
    sights: _Sights, cameras: _Groups, boards: _Groups, corners: Array, names: Sequence[str]
) -> str:
    """Join the two groups of cameras with the best-determined relative pose; return a description, or ""."""

    def linked(a: int, b: int, board: int) -> Link | None:
        one, other = (_seen(sights, cameras, boards, c, board) for c in (a, b))
        return _link(one, other, corners)

    made = _join_best(cameras, boards, linked)
    return f"{names[made[0]]} and {names[made[1]]} see one board at {made[2]} instants" if made else ""


def _by_boards(
    sights: _Sights, cameras: _Groups, boards: _Groups, corners: Array, names: Sequence[str], believed: float
) -> str:
    """Join the two groups of boards, fixed to each other, that one group of cameras determines best."""

    def linked(a: int, b: int, camera: int) -> Link | None:
        one, other = (_seen(sights, cameras, boards, camera, k) for k in (a, b))
        if not len(one[0]) or not len(other[0]):
            return None
        middle = (
            Poses.of(other[1][:, 0]).apply(corners.mean(0)).mean(0)
        )  # where the other board's corners are
        back = [(t, Poses.of(p.inverse()), v) for t, p, v in (one, other)]
        found = _link(back[0], back[1], corners - corners.mean(0) + middle)
        return found if found is not None and found.scatter <= believed else None

    made = _join_best(boards, cameras, linked)
    return (
        f"boards {names[made[0]]} and {names[made[1]]} are seen together at {made[2]} instants"
        if made
        else ""
    )


def _by_both(
    sights: _Sights,
    cameras: _Groups,
    boards: _Groups,
    names: Sequence[str],
    boards_called: Sequence[str],
    corners: Array,
) -> str:
    """Join two groups of cameras and two of boards that are seen pair by pair at the same instants."""
    size = float(np.linalg.norm(corners - corners.mean(0), axis=1).max())
    groups, plates = np.unique(cameras.of).tolist(), np.unique(boards.of).tolist()
    tried = []
    for g, h in combinations(groups, 2):
        for k, m in ((k, m) for k in plates for m in plates if k != m):
            one, other = _seen(sights, cameras, boards, g, k), _seen(sights, cameras, boards, h, m)
            shared, i, j = np.intersect1d(one[0], other[0], return_indices=True)
            if len(shared) >= motions.LEAST_VIEWS:
                tried.append((len(shared), g, h, k, m, one[1][i], other[1][j], other[2][j]))
    for count, g, h, k, m, first, second, variance in sorted(tried, key=lambda t: -t[0]):
        found = _both(first, second, variance / size**2)
        if found is not None:
            cameras.join(g, h, found[0])
            boards.join(k, m, found[1])
            return (
                f"{names[g]} sees board {boards_called[k]} while {names[h]} sees board {boards_called[m]} "
                f"at {count} instants"
            )
    return ""


def _both(robot: Poses, camera: Poses, turn_variance: Array) -> tuple[Pose, Pose] | None:
    """X = g_from_h and Z = k_from_m of G Z = X C; None where the motions do not determine them, or do not agree.

    Of poses (T, K), those that agree.
    """
    typical = np.full(motions.LEAST_VIEWS, np.median(turn_variance))
    chosen = agreed_both(
        robot, camera, lambda g, c: _solved(g, c, typical if len(g) < len(robot) else turn_variance)
    )
    if chosen is None:
        return None
    robot, camera = chosen
    found = _solved(robot, camera, turn_variance)
    if found is None:
        return None
    off = residuals("to-hand", *found, camera, robot)
    far = np.linalg.norm(robot.translation, axis=1)
    return found if np.median(np.linalg.norm(off[:, 3:], axis=1) / far) <= FAST else None


def _solved(robot: Poses, camera: Poses, turn_variance: Array) -> tuple[Pose, Pose] | None:
    """X and Z by the closed form; None where the motions do not determine them."""
    covariance = turn_variance[:, None, None] * np.eye(3)
    try:
        motions.require_two_axes(motions.measure(camera, covariance))
        views = Views(robot, camera)
        unit = length_unit(views)
        x, z = (Pose(p.rotation, unit * p.translation) for p in shah.solve(scaled(views, 1 / unit)))
    except (CamcalError, np.linalg.LinAlgError):
        return None
    return x, z


# ---------------------------------------------------------------------------------------------- boards as one target
def arranged(
    fits: Mapping[str, Calibration], views: RigViews, asked: str, rig: Mapping[str, Pose] | None = None
) -> tuple[Mapping[str, Calibration], RigViews, Layout | None]:
    """The cameras' fits and views with the boards of a group as one target; unchanged if there is one board.

    The arguments are those of `layout`.
    """
    if not views.boards:
        return fits, views, None
    found = layout(fits, views, asked, rig)
    if found.turned_pictures:
        turns = board_turns(fits)
        fits = {n: renamed(f, views.boards[n], found.turned[n], turns) for n, f in fits.items()}
    return {n: _placed(f, views.boards[n], found) for n, f in fits.items()}, views.apart(found.groups), found


def _placed(fit: Calibration, boards: Mapping[str, int], found: Layout) -> Calibration:
    """A camera's fit in the frames of the groups."""
    data = fit.observations
    target: dict[str, Any] = {**(data.target or {}), "board_groups": list(found.groups)}
    target["board_poses"] = [p.entry() for p in found.poses]
    xyz, which = data.xyz.copy(), labels(data)
    assert which is not None
    for board, pose in enumerate(found.poses):
        xyz[which == board] = pose.apply(xyz[which == board])
    back = Poses.stack([found.poses[boards[v]].inverse() for v in data.view_ids])
    return replace(fit, observations=replace(data, xyz=xyz, target=target), poses=Poses.of(fit.poses @ back))
