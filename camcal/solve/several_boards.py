"""The poses and shapes of several boards in one calibration, as displacement directions of all their points.

Boards that are fixed to each other are placed together with the cameras: each is rotated about the mean of its points
and shifted. If shapes are estimated, each board has its own, with a common kind or a separate one: the directions of
the kind for a single board, in that board's frame, without those that move or scale the board as a whole. Its pose is
estimated separately, or is that of the views; its size is that of the design.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from camcal.data.boards import frames, labels, movable
from camcal.data.observations import Observations
from camcal.geometry import rotations
from camcal.model.pose import Array, Pose
from camcal.records import dataclass

#: a point seen in fewer views than this keeps its ideal place: its offset would only absorb noise
LEAST_VIEWS = 3
#: a board with fewer points that are seen often enough keeps its ideal shape: three points fit any triangle of a plane
LEAST_POINTS = 4
#: directions (3 m, B) of a single board, from its points (m, 3) and the number of views that see each (m,)
Directions = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Several:
    """The board of each row, and the poses of the boards.

    Attributes
    ----------
    label : (N,) int array
        The board of each row of the used points.
    place : (K,) int array
        The index of each board among those whose poses are estimated; -1 for the others.
    frames : tuple of K Pose
        group_from_board: the frame of the points from that of the board.
    """

    label: Array
    place: Array
    frames: tuple[Pose, ...]

    @classmethod
    def of(cls, data: Observations) -> Several | None:
        """Make it from observations; None for a single board."""
        which = labels(data)
        if which is None:
            return None
        target = data.target or {}
        found = frames(target)
        place, placed = np.full(len(found), -1), movable(target)
        place[placed] = np.arange(len(placed))
        return cls(which, place, found)


def places(points: Array, part: Array) -> Array:
    """Directions (3 M, 6 K): small rotations of K parts about the means of their points, and shifts; -1 is fixed."""
    count = int(part.max(initial=-1)) + 1
    basis = np.zeros((len(points), 3, 6 * count))
    for k in range(count):
        own = np.flatnonzero(part == k)
        if len(own):
            basis[own, :, 6 * k : 6 * k + 3] = -rotations.skew(points[own] - points[own].mean(0))
            basis[own, :, 6 * k + 3 : 6 * k + 6] = np.eye(3)
    return basis.reshape(3 * len(points), 6 * count)


def motions_of(shape: Array, points: Array, part: Array) -> list[Pose]:
    """The displacement of points (M, 3) in parts (M,) by the variables (6 K,) of `places`, exactly rigid."""
    found = []
    for k, (turn, shift) in enumerate(shape.reshape(-1, 2, 3)):
        own = points[part == k]
        centre = own.mean(0) if len(own) else np.zeros(3)
        rotation = rotations.exp(turn)
        found.append(Pose(rotation, centre + shift - rotation @ centre))
    return found


def kinds_of(kind: str, boards: int) -> tuple[str, ...]:
    """The kind of each board: one for all, or one each, joined by + in their order."""
    parts = tuple(kind.split("+"))
    return parts if len(parts) == boards else parts * boards


def determined(label: Array, counts: Array, boards: int) -> Array:
    """Mask (K,) of the boards of which enough points are seen in enough views for a shape."""
    often = counts >= LEAST_VIEWS
    return np.array([np.count_nonzero(often & (label == k)) >= LEAST_POINTS for k in range(boards)])


def enough(data: Observations, several: Several) -> Array:
    """Mask (K,) of the boards whose used rows determine a shape; see `determined`."""
    assert data.point is not None
    _, first, counts = np.unique(data.point, return_index=True, return_counts=True)
    return determined(several.label[first], counts, len(several.frames))


def shapes(
    points: Array,
    counts: Array,
    label: Array,
    frames: Sequence[Pose],
    kinds: Sequence[str],
    directions_of: Mapping[str, Directions],
) -> Array:
    """Directions (3 M, B) of the shapes of all boards whose views determine one.

    Parameters
    ----------
    points : (M, 3) array
        As designed, each in the frame of its group.
    counts : (M,) array
        How many views see each.
    label : (M,) int array
    frames : sequence of K Pose
    kinds : sequence of K str
        `flat`, `free` for every coordinate of every point, or of `directions_of`.
    directions_of : mapping of kind -> function
    """
    columns = [np.zeros((3 * len(points), 0))]
    for board in np.flatnonzero(determined(label, counts, len(frames))).tolist():
        kind, own = kinds[board], label == board
        if kind == "flat":
            continue
        own &= counts >= (LEAST_VIEWS if kind == "free" else 1)
        x = frames[board].inverse().apply(points[own])
        rigid = np.linalg.qr(similarities(x), mode="complete")[0]
        if kind == "free":
            directions = rigid[:, 7:]
        else:
            directions = directions_of[kind](x, counts[own])
            directions = directions - rigid[:, :7] @ (rigid[:, :7].T @ directions)
        full = np.zeros((len(points), 3, directions.shape[1]))
        full[own] = np.einsum("ij,mjb->mib", frames[board].rotation, directions.reshape(len(x), 3, -1))
        columns.append(full.reshape(3 * len(points), -1))
    return np.concatenate(columns, 1)


def similarities(points: Array) -> Array:
    """Directions (3 M, 7): shifts of points (M, 3), small rotations about their mean, and a change of scale."""
    x = points - points.mean(0)
    shifts = np.tile(np.eye(3), (len(x), 1, 1))
    return np.concatenate([shifts, rotations.skew(x), x[:, :, None]], 2).reshape(-1, 7)
