"""The layout of a board of markers from where its markers are seen and what their ids are.

Each marker spans a little frame of its own, in which its neighbours stand at whole multiples of one step:
along the diagonals on a ChArUco board, along the rows in a grid of tags. So every marker gets a column and
a row, and the ids, which count up row by row, tell how long a row is.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from camcal.detect.targets.aprilgrid import AprilGrid
from camcal.detect.targets.base import Detection
from camcal.detect.targets.charuco import Charuco
from camcal.detect.targets.dictionaries import marker_count, names
from camcal.geometry import homography

Array = np.ndarray

UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5  #: a marker's corners in its own frame
NEAREST = 8
EVEN = 0.3  #: of a step; how far a neighbour may be from a whole multiple
LONGEST_ROW = 40
MEASURED = 3  #: pictures from which the spacing of tags is measured
LEAST_AGREEING = 0.8  #: share of the markers that a layout must explain


@dataclass(frozen=True)
class Marker:
    """A marker in a picture: its id and its corners (4, 2), clockwise from its own upper left."""

    id: int
    corners: Array


def charuco_board(views: Sequence[Sequence[Marker]], family: str) -> Charuco | None:
    """The ChArUco board, its square 1, on which the markers of some pictures stand, or None."""
    placed, ratio = _placed(views, diagonal=True)
    if not placed:
        return None
    options = [
        (_agreement(placed, partial(_charuco_cell, columns=columns, start=start)), columns, start)
        for columns in range(3, LONGEST_ROW)
        for start in (1, 0)  # the first square is black, or holds a marker
    ]
    share, columns, start = max(options, key=lambda o: o[0])
    last = max(marker for view in placed for marker in view)
    rows, legacy = _charuco_cell(last, columns, start)[1] + 1, start == 0
    if share < LEAST_AGREEING or rows < 3 or (legacy and rows % 2):
        return None
    marker = _rounded(1 / ratio, 0.05, 0.015)
    return Charuco(columns, rows, 1.0, marker, smallest(family, columns * rows // 2), "unit", legacy)


def charuco_spec(board: Charuco) -> str:
    """The spec of a board."""
    spec = f"charuco:{board.columns}x{board.rows}:{board.square:g}:{board.marker:g}:{board.dictionary}"
    return spec + (":legacy" if board.legacy else "")


def aprilgrid_board(views: Sequence[Sequence[Marker]], family: str, border: int) -> AprilGrid | None:
    """The grid of tags, their side 1, on which the markers of some pictures stand, or None.

    The spacing is only rough: small squares at the tags' corners spoil the outlines of these.
    """
    placed, ratio = _placed(views, diagonal=False)
    if not placed:
        return None
    first = min(marker for view in placed for marker in view)
    last = max(marker for view in placed for marker in view)
    options = [
        (_agreement(placed, partial(_grid_cell, columns=columns, start=start)), columns, start)
        for columns in range(2, LONGEST_ROW)
        for start in dict.fromkeys((0, first))
    ]
    share, columns, start = max(options, key=lambda o: o[0])
    rows = (last - start) // columns + 1
    if share < LEAST_AGREEING or rows < 2:
        return None
    return AprilGrid(columns, rows, 1.0, float(np.clip(ratio - 1, 0.05, 0.9)), "unit", family, border, start)


def measured_spacing(grid: AprilGrid, pictures: Sequence[Array]) -> AprilGrid:
    """The same grid with the spacing for which four tags at a time are most nearly a plane's picture."""
    for _ in range(2):  # the second time with corners that the first guess did not lead to
        found = [d for d in (grid.find(gray) for gray in pictures[:MEASURED]) if isinstance(d, Detection)]
        blocks = [_blocks(grid, d) for d in found]
        ids = np.concatenate([b for b, _ in blocks] or [np.zeros((0, 16), int)])
        if not len(ids):
            break
        uv = np.concatenate([u for _, u in blocks])
        misfit = partial(_misfit, grid=grid, ids=ids, uv=uv)
        best = minimize_scalar(misfit, bounds=(0.05, 0.95), method="bounded", options={"xatol": 1e-4})
        grid = replaced(grid, float(best.x))
    return replaced(grid, _rounded(grid.spacing, 0.01, 0.004))


def _misfit(spacing: float, grid: AprilGrid, ids: Array, uv: Array) -> float:
    """Sum of the misfits of a homography to each block of points (B, 16), each block alike, px²."""
    cost = homography.solve(replaced(grid, spacing).points[ids, :2], uv)[2]
    return float(np.minimum(cost, 10 * np.median(cost)).sum())  # a block with a wrong corner must not decide


def _blocks(grid: AprilGrid, found: Detection) -> tuple[Array, Array]:
    """Points (B, 16) of two by two tags of which every corner was found, and their images (B, 16, 2)."""
    tag = np.arange(grid.columns * grid.rows).reshape(grid.rows, grid.columns)
    four = np.stack([tag[:-1, :-1], tag[:-1, 1:], tag[1:, :-1], tag[1:, 1:]], -1).reshape(-1, 4)
    ids = (4 * four[:, :, None] + np.arange(4)).reshape(-1, 16)
    where = np.full(4 * tag.size, -1)
    where[found.point_ids] = np.arange(len(found))
    rows = where[ids]
    whole = (rows >= 0).all(1)
    return ids[whole], found.uv[rows[whole]]


def replaced(grid: AprilGrid, spacing: float) -> AprilGrid:
    """The grid with another spacing."""
    return AprilGrid(
        grid.columns, grid.rows, grid.square, spacing, grid.unit, grid.dictionary, grid.border, grid.start
    )


def aprilgrid_spec(grid: AprilGrid) -> str:
    """The spec of a grid."""
    named = {
        "family": (grid.dictionary, "APRILTAG_36h11"),
        "border": (grid.border, 2),
        "start": (grid.start, 0),
    }
    more = "".join(f":{name}={value}" for name, (value, usual) in named.items() if value != usual)
    return f"aprilgrid:{grid.columns}x{grid.rows}:{grid.square:g}:{grid.spacing:.4g}{more}"


def _rounded(value: float, step: float, near: float) -> float:
    """The nearest multiple of a step, as people choose such figures, where it is near; else three digits."""
    whole = round(round(value / step) * step, 6)
    return whole if abs(whole - value) < near else round(value, 3)


def smallest(family: str, needed: int) -> str:
    """The smallest dictionary of a family that holds so many markers; its first ones are the same."""
    kin = [n for n in names() if n.rpartition("_")[0] == family.rpartition("_")[0] and n.endswith("0")]
    fitting = [n for n in kin if marker_count(n) >= needed] if family[0].isdigit() else []
    return min(fitting, key=marker_count) if fitting else family


def _grid_cell(marker: int, columns: int, start: int) -> tuple[int, int]:
    """Column and row of a tag in cv2's frame of it, which is turned by half a turn against Kalibr's.

    Kalibr's ids go to the right and up, so in that frame to the left and down.
    """
    return -((marker - start) % columns), (marker - start) // columns


def _charuco_cell(marker: int, columns: int, start: int) -> tuple[int, int]:
    """Column and row of the square that holds a marker; `start` is the column of marker 0."""
    here, other = len(range(start, columns, 2)), len(range(1 - start, columns, 2))
    pairs, rest = divmod(marker, here + other)
    if rest < here:
        return start + 2 * rest, 2 * pairs
    return 1 - start + 2 * (rest - here), 2 * pairs + 1


def _agreement(placed: list[dict[int, tuple[int, int]]], cell: Callable[[int], tuple[int, int]]) -> float:
    """Share of the markers whose places differ by what the layout says they should."""
    right = total = 0
    for view in placed:
        offsets: Counter[tuple[int, int]] = Counter()
        for marker, (x, y) in view.items():
            column, row = cell(marker)
            offsets[x - column, y - row] += 1
        right += offsets.most_common(1)[0][1]
        total += len(view)
    return right / total


def _placed(
    views: Sequence[Sequence[Marker]], diagonal: bool
) -> tuple[list[dict[int, tuple[int, int]]], float]:
    """Column and row of each marker, from any origin, in each picture; and the step in sides of a marker."""
    frames = [_frames(view) for view in views]
    steps = np.concatenate([_steps(offset, diagonal) for _, offset in frames] or [np.zeros(0)])
    if len(steps) < 3:
        return [], 0.0
    step = float(np.median(steps))
    placed = []
    for view, (near, offset) in zip(views, frames, strict=True):
        places = _walk(near, offset / step)
        if len(places) >= 3:
            placed.append({view[k].id: place for k, place in places.items()})
    return placed, step


def _frames(view: Sequence[Marker]) -> tuple[Array, Array]:
    """The nearest markers (K, n) of each, and their centres (K, n, 2) in its own frame."""
    corners = np.array([m.corners for m in view])
    h = homography.homographies(corners, np.broadcast_to(UNIT, corners.shape), steps=0)
    centre = corners.mean(1)
    distance = np.linalg.norm(centre[:, None] - centre, axis=-1)
    near = np.argsort(distance, axis=1)[:, 1 : NEAREST + 1]
    return near, homography.transfer(h, centre[near])


def _steps(offset: Array, diagonal: bool) -> Array:
    """How far the nearest neighbours stand, along both axes or along one, in sides of a marker."""
    a = np.abs(offset).reshape(-1, 2)
    large, small = a.max(1), a.min(1)
    if diagonal:
        good = (small > 0.7 * large) & (large < 3.5)
        return _nearest(a[good].mean(1))
    return _nearest(large[(small < 0.25 * large) & (large < 3.0)])


def _nearest(lengths: Array) -> Array:
    """The lengths of single steps: those that are not far from the shortest."""
    return lengths[lengths < 1.4 * np.percentile(lengths, 10)] if len(lengths) else lengths


def _walk(near: Array, offset: Array) -> dict[int, tuple[int, int]]:
    """Places of the largest set of markers that neighbours link by whole steps without contradiction."""
    best: dict[int, tuple[int, int]] = {}
    whole = np.rint(offset).astype(int)
    fits = (np.abs(offset - whole).max(-1) < EVEN) & (np.abs(whole).max(-1) <= 2)
    left = set(range(len(near)))
    while left:
        seed = min(left)
        places, queue = {seed: (0, 0)}, deque([seed])
        while queue:
            here = queue.popleft()
            for k in np.flatnonzero(fits[here]):
                there = int(near[here, k])
                if there not in places:
                    places[there] = (
                        places[here][0] + int(whole[here, k, 0]),
                        places[here][1] + int(whole[here, k, 1]),
                    )
                    queue.append(there)
        left -= set(places)
        if len(places) > len(best):
            best = places
    return best
