"""A board's shape, estimated together with the camera and the poses.

Print and paper are never perfect: the board's points X = X₀ + B θ, linear in a few or in all coordinates,
replace the ideal grid X₀ (Strobl & Hirzinger, More Accurate Pinhole Camera Calibration with Imperfect Planar
Target, ICCVW 2011; cv2.calibrateCameraRO does the `free` kind). A residual depends on one point only, so the
points' blocks of JᵀJ have three columns per view; the poses are eliminated first, as without a shape (Schur
complement), which leaves the camera and θ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.errors import UsageError
from camcal.geometry import rotations
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.cameras import Assembly
from camcal.solve.common_points import common_points
from camcal.solve.groups import Group
from camcal.solve.problem import Problem, Seen
from camcal.solve.several_boards import LEAST_POINTS, LEAST_VIEWS, Several, kinds_of, places, shapes
from camcal.solve.state import Blocks, State


@dataclass(frozen=True)
class Board:
    """The points of a target, common to all views, and the deformations of their shape.

    Attributes
    ----------
    points : (M, 3) array
        The ideal points X₀.
    ids : V arrays (N,)
        Index of the point of each row of each view.
    kind : str
        A key of `KINDS`.
    basis : (3 M, B) array, or (B,) int array
        d X / d θ in the order x, y, z of the first point, of the second, ...; integers select coordinates.
    part : (M,) int array or None
        For several boards: index, among the placed boards, of the board of each point; -1 for other boards.
    label, numbers : (M,) int arrays or None
        For several boards: the board of each point, and the point's number.
    """

    points: Array
    ids: tuple[Array, ...]
    kind: str
    basis: Array
    part: Array | None = None
    label: Array | None = None
    numbers: Array | None = None

    @property
    def placed(self) -> int:
        """Number of the parameters that place boards; they are the first."""
        return 0 if self.part is None else 6 * (int(self.part.max(initial=-1)) + 1)

    @property
    def size(self) -> int:
        """Number of shape parameters B."""
        return len(self.basis) if self.basis.ndim == 1 else self.basis.shape[1]

    def expand(self, shape: Array) -> Array:
        """Offsets (M, 3) of θ."""
        if self.basis.ndim == 2:
            return (self.basis @ shape).reshape(-1, 3)
        flat = np.zeros(3 * len(self.points))
        flat[self.basis] = shape
        return flat.reshape(-1, 3)

    def fold(self, columns: Array) -> Array:
        """Convert derivatives with respect to all coordinates (..., 3 M) into those with respect to θ (..., B)."""
        return columns[..., self.basis] if self.basis.ndim == 1 else columns @ self.basis

    def fold_blocks(self, blocks: Array) -> Array:
        """Convert second moments of each point's coordinates (M, 3, 3) into those of θ (B, B)."""
        if self.basis.ndim == 2:
            basis = self.basis.reshape(-1, 3, self.size)
            return np.tensordot(basis, blocks @ basis, ([0, 1], [0, 1]))
        found = np.zeros((self.size, self.size))
        rows, columns, there = point_slots(self.basis, len(self.points))
        found[rows[there], columns[there]] = blocks[there]
        return found


def point_slots(coordinates: Array, points: int) -> tuple[Array, Array, Array]:
    """The positions of the blocks of points among the free coordinates (B,): rows, columns and which exist, (M, 3,
    3).
    """
    slots = np.full(3 * points, -1)
    slots[coordinates] = np.arange(len(coordinates))
    of_point: Array = slots.reshape(points, 3)
    rows, columns = np.broadcast_arrays(of_point[:, :, None], of_point[:, None, :])
    return rows, columns, (rows >= 0) & (columns >= 0)


def _unit(points: Array) -> Array:
    """x and y scaled to [-1, 1] over the board, (M, 2)."""
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    return (2 * points[:, :2] - low - high) / np.where(high > low, high - low, 1.0)


def _bowl(points: Array, counts: Array) -> Array:
    """z += θ₁ (1 - x²) + θ₂ (1 - y²): mrcal's calobject_warp."""
    basis = np.zeros((len(points), 3, 2))
    basis[:, 2] = 1 - _unit(points) ** 2
    return basis.reshape(-1, 2)


def _print(points: Array, counts: Array) -> Array:
    """The bowl, a stretch of y against x, and a shear between the two sides."""
    basis = np.zeros((len(points), 3, 2))
    centred = points[:, :2] - points[:, :2].mean(0)
    basis[:, 1, 0] = centred[:, 1]
    basis[:, 0, 1] = centred[:, 1]
    return np.c_[_bowl(points, counts), basis.reshape(-1, 2)]


def gauge_points(points: Array) -> tuple[int, int, int]:
    """Two points (M, 3) far apart, and one far from their line."""
    a = int(np.linalg.norm(points - points.mean(0), axis=1).argmax())
    from_a = points - points[a]
    b = int(np.linalg.norm(from_a, axis=1).argmax())
    along = from_a[b] / np.linalg.norm(from_a[b])
    return a, b, int(np.linalg.norm(from_a - np.outer(from_a @ along, along), axis=1).argmax())


def _free(points: Array, counts: Array) -> Array:
    """Every coordinate of every point except the seven of the gauge: a and b are fixed and c keeps its height.

    a and b are far apart and c is far from their line, so that none of them amplifies the others' noise.
    """
    seen = np.flatnonzero(counts >= LEAST_VIEWS)
    if len(seen) < LEAST_POINTS:
        raise UsageError(
            f"{len(seen)} points of the board are seen in {LEAST_VIEWS} views or more; a free shape needs "
            f"{LEAST_POINTS}.",
            "Try: --board-shape bowl",
        )
    p = points[seen]
    a, b, c = gauge_points(p)
    held = np.zeros((len(points), 3), bool)
    held[counts < LEAST_VIEWS] = True
    held[[seen[a], seen[b]]] = True
    held[seen[c], 2] = True
    return np.flatnonzero(~held.reshape(-1))


#: the kind of several boards as designed, some of which are fixed to each other: each of these has a pose of its own
PLACED = "placed"

#: kind -> function (points (M, 3), views that see each (M,)) -> basis of `Board`
KINDS: dict[str, Callable[[Array, Array], Array]] = {"bowl": _bowl, "print": _print, "free": _free}


def check_kind(kind: str) -> None:
    """Raise a UsageError for a kind of shape other than `flat`, those of `KINDS`, and `auto`."""
    if kind not in ("flat", *KINDS, "auto"):
        raise UsageError(f"unknown board shape '{kind}'.", "Known: flat, " + ", ".join(KINDS) + ", auto.")


def make_board(views: Sequence[View], kind: str, several: Several | None = None) -> Board:
    """The board of the views with a shape of the given kind, or several boards.

    Parameters
    ----------
    views : sequence of View
    kind : str
        For several boards also one kind for each (`kinds_of`).
    several : Several, optional
        The board of each row of all views.

    Raises
    ------
    UsageError
        If the views do not share a target, the kind is unknown, or no board has points in enough views.
    """
    kinds = kinds_of(kind, 1 if several is None else len(several.frames))
    if kind != PLACED:
        for own_kind in kinds:
            check_kind(own_kind)
    common = common_points(views)
    if common is None:
        raise UsageError(
            "the views disagree about the coordinates of a board point; a shape needs a single board.",
            "Try: --board-shape flat",
        )
    points, ids = common
    index = np.concatenate(ids)
    counts = np.bincount(index, minlength=len(points))
    if several is None:
        return Board(points, ids, kind, KINDS[kind](points, counts))
    label, numbers = np.empty(len(points), int), np.empty(len(points), int)
    label[index] = several.label
    numbers[index] = np.concatenate([v.point_ids for v in views if v.point_ids is not None])
    part = several.place[label]
    basis = places(points, part)
    if kind != PLACED:
        own = shapes(points, counts, label, several.frames, kinds, KINDS)
        if not own.shape[1]:
            raise UsageError(
                f"no board has {LEAST_POINTS} points that are seen in {LEAST_VIEWS} views or more.",
                "Try: --board-shape flat",
            )
        basis = np.c_[basis, own]
    return Board(points, ids, kind, basis, part, label, numbers)


class BoardProblem(Problem):
    """A calibration whose board's shape is estimated; see `Problem`."""

    def __init__(
        self,
        lens: Lens | Sequence[Lens],
        views: Sequence[View],
        free: Array | Sequence[Array],
        board: Board,
        weights: Sequence[Array] | None = None,
        normalise: bool = True,
        seen: Seen | None = None,
        hold_rig: bool = False,
    ):
        super().__init__(lens, views, free, weights, normalise, seen, hold_rig)
        self.board = board
        self.groups = [replace(g, ids=self._padded_ids(g)) for g in self.groups]

    def normalised(self) -> BoardProblem:
        """Return the same problem with `normalise`."""
        lenses, frees = [c.lens for c in self.cameras], [c.free for c in self.cameras]
        return BoardProblem(
            lenses, self.views, frees, self.board, self.weights, True, self.seen, self.hold_rig
        )

    @property
    def point_coordinates(self) -> Array | None:
        """The free coordinates of a free shape; see `Problem.point_coordinates`."""
        return self.board.basis if self.board.basis.ndim == 1 else None

    @property
    def variables(self) -> int:
        """Number of the variables of cameras, rig and shape."""
        return self.rigid + self.board.size

    def _padded_ids(self, group: Group) -> Array:
        """(G, N) ids; padding points get an extra id, M."""
        ids = np.full((len(group.members), group.xyz.shape[2]), len(self.board.points))
        for row, member in zip(ids, group.members, strict=True):
            row[: len(self.board.ids[member])] = self.board.ids[member]
        return ids

    def state(self, params: Array, poses: Poses, rig: Poses | None = None) -> State:
        """Start with the ideal board."""
        return replace(super().state(params, poses, rig), shape=np.zeros(self.board.size))

    def points(self, group: Group, state: State) -> Array:
        """Ideal points plus their offsets."""
        offsets = np.r_[self.board.expand(state.shape), np.zeros((1, 3))]
        return group.xyz + offsets[group.ids].transpose(0, 2, 1)

    def linearise(self, state: State) -> Blocks | None:
        """The normal equations of cameras, rig, shape and poses; None where a point leaves a lens's domain."""
        sums = _PointSums(self, state)
        found = self.assembled(state, sums.add)
        if found is None:
            return None
        sums.extend(found)
        return found.blocks()

    def free_rows(self, group: Group, state: State) -> Array | None:
        """Rows of all variables, those of the shape before the pose; see `Problem.free_rows`."""
        block = self.fill(group, state)
        rows = super().free_rows(group, state)
        if rows is None or block is None:
            return None
        assert group.ids is not None
        p, m, f = self.cameras[group.camera].lens.size, len(self.board.points), self.rigid
        turned, _ = self.cameras[group.camera].placed(state, self.seen.instant[group.members])
        d_cam = block[:, p + 3 : p + 6].reshape(len(block), 3, -1)
        shape = np.empty((len(rows), self.board.size, rows.shape[2]))
        for g, at in enumerate(group.ids):
            columns = np.zeros((rows.shape[2], m + 1, 3))
            columns[np.arange(rows.shape[2]), np.tile(at, 2)] = (turned[g].T @ d_cam[g]).T
            shape[g] = self.board.fold(columns[:, :m].reshape(-1, 3 * m)).T
        return np.concatenate([rows[:, :f], shape, rows[:, f:]], 1)


def _alike(ids: Array) -> list[Array]:
    """Group equal rows of ids (G, N); return the groups of row indices."""
    groups: dict[bytes, list[int]] = {}
    for row, at in enumerate(ids):
        groups.setdefault(at.tobytes(), []).append(row)
    return [np.array(rows) for rows in groups.values()]


def _as_slice(at: Array) -> Array | slice:
    """Consecutive ascending numbers as a slice, with which arrays are indexed without copies; others as they are."""
    first, last = int(at[0]), int(at[-1])
    return slice(first, last + 1) if (np.diff(at) == 1).all() else at


class _PointSums:
    """The blocks of JᵀJ that involve the board's points, summed over the views."""

    def __init__(self, problem: BoardProblem, state: State):
        self.problem, self.state = problem, state
        slots = len(problem.board.points) + 1
        self.params = np.zeros((len(problem.free), 3, slots))
        self.rig = np.zeros((len(problem.cameras), 0 if problem.hold_rig else 6, 3, slots))
        self.poses = np.zeros((problem.instants, 6, 3, slots))
        self.gradient = np.zeros((3, slots))
        self.own = np.zeros((3, 3, slots))

    def add(self, group: Group, block: Array) -> None:
        """Add a group's rows (G, P + 6 + 1, 2, N) by d X = Rᵀ d x_cam."""
        assert group.ids is not None
        camera, instants = self.problem.cameras[group.camera], self.problem.seen.instant[group.members]
        p, params, rig = camera.lens.size, self.params[camera.params], self.rig[camera.index]
        rotation, _ = camera.placed(self.state, instants)
        d_cam = block[:, p + 3 : p + 6]
        d = (rotation.transpose(0, 2, 1) @ d_cam.reshape(len(d_cam), 3, -1)).reshape(d_cam.shape)
        cross = block[:, :, 0, None] * d[:, None, :, 0] + block[:, :, 1, None] * d[:, None, :, 1]
        own = d[:, :, 0, None] * d[:, None, :, 0] + d[:, :, 1, None] * d[:, None, :, 1]
        by_instant, maps = cross[:, p : p + 6], camera.maps(self.state, instants)
        by_rig = np.zeros((len(block), 0))
        if maps is not None:
            by_rig = np.einsum("gij,gikn->gjkn", maps.by_rig, by_instant)
            by_instant = np.einsum("ij,gikn->gjkn", maps.by_instant, by_instant)
        for members in _alike(group.ids):  # views that show the same points, all at once
            at, some = _as_slice(group.ids[members[0]]), instants[members]
            rows = slice(None) if len(members) == len(block) else members  # without a copy
            params[..., at] += cross[rows, :p].sum(0)
            if isinstance(at, slice):
                self.poses[some, ..., at] += by_instant[rows]
            else:
                self.poses[some[:, None], ..., at] += np.moveaxis(by_instant[rows], -1, 1)
            if maps is not None:
                rig[..., at] += by_rig[rows].sum(0)
            self.gradient[..., at] += cross[rows, -1].sum(0)
            self.own[..., at] += own[rows].sum(0)

    def _flat(self, a: Array) -> Array:
        """(..., 3, M + 1) -> (..., B)"""
        m = len(self.problem.board.points)
        return self.problem.board.fold(np.swapaxes(a[..., :m], -1, -2).reshape(*a.shape[:-2], 3 * m))

    def extend(self, found: Assembly) -> None:
        """Write the blocks of the shape's parameters, which come last."""
        problem, rigid = self.problem, self.problem.rigid
        shape, m = slice(rigid, None), len(problem.board.points)
        rig = self._flat(self.rig[1:]).reshape(-1, problem.board.size)
        mixed = np.concatenate([problem.free.T @ self._flat(self.params), rig])
        found.intrinsics[:rigid, shape], found.intrinsics[shape, :rigid] = mixed, mixed.T
        found.intrinsics[shape, shape] = problem.board.fold_blocks(np.moveaxis(self.own[..., :m], -1, 0))
        found.coupling[:, shape] = self._flat(self.poses).transpose(0, 2, 1)
        found.gradient[shape] = self._flat(self.gradient)


def settle(points: Array, ideal: Array, poses: Poses) -> tuple[Array, Poses, float]:
    """Move a board to its best fit with the ideal one, and the poses with it; no projection changes.

    The similarity s Q X + c closest to the ideal points in least squares (Umeyama 1991): neither the position of
    the board's frame nor the size of the board is observable.

    Parameters
    ----------
    points, ideal : (M, 3) arrays
    poses : Poses
        cam_from_board with `points`.

    Returns
    -------
    points : (M, 3) array
    poses : Poses
    scale : float
        s, the factor of all translations.
    """
    mean, target = points.mean(0), ideal.mean(0)
    a, b = ideal - target, points - mean
    turn = rotations.fit_rotation(a, b)
    scale = float(np.einsum("ij,ij->", a, b @ turn.T) / np.einsum("ij,ij->", b, b))
    shift = target - scale * turn @ mean
    rotation = poses.rotations @ turn.T
    moved = Poses(rotation, scale * poses.translations - rotation @ shift)
    return scale * points @ turn.T + shift, moved, scale
