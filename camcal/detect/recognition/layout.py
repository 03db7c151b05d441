"""The layout of a board of markers, from the positions and ids of its markers.

Each marker defines a local frame, in which its neighbours are at integer multiples of one step: along the
diagonals on a ChArUco board, along rows and columns in a grid of tags. This gives each marker a column and a row, and
the ids, which increase row by row, give the length of a row.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from heapq import heappop, heappush

import numpy as np

from camcal.detect.recognition.families import Family, Marker, smallest
from camcal.detect.targets.aprilgrid import LARGEST_GAP, AprilGrid
from camcal.detect.targets.base import GAPS, MOST_GAP
from camcal.detect.targets.charuco import Charuco
from camcal.detect.targets.dictionaries import marker_count
from camcal.detect.targets.tag_board import NEIGHBOURS, TagBoard, consistent
from camcal.detect.targets.tag_grid import TagGrid
from camcal.geometry import homography
from camcal.records import dataclass

Array = np.ndarray

UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5  #: a marker's corners in its own frame
LEAST_SQUARES = 3  #: columns and rows of a ChArUco board: with two, all corners are collinear
#: initial range of a marker's side in squares; values beyond it, and gaps beyond `GAPS`, come from
#: inaccurate outlines, and `measure` refines the value from there
MARKER = (0.1, 0.95)
#: ratio of the smaller to the larger component of the step to a neighbour in the marker's frame: 1 along a diagonal,
#: 0 along a row or column; .1 to .95 and .05 to .9 give the same boards in 19 sets of pictures
DIAGONAL, STRAIGHT = 0.7, 0.25
FARTHEST = 1 + MOST_GAP  #: largest permitted distance to the nearest neighbour, in sides of a marker
#: factor on the shortest distance between neighbours (taken at that percentile, as the very shortest may be misread)
#: below which a distance is a single step: the next is twice as long. Markers are lost with 1.2 and with 0 %, none with
#: 1.6 to 3 and with 2 to 50 %
SINGLE, SHORTEST = 1.4, 10
EVEN = 0.3  #: of a step; largest deviation of a neighbour from an integer multiple
FEWEST_STEPS = 3  #: least number of distances in all pictures; with fewer, a single one decides the median
LONGEST_ROW = 40  #: longest row of squares or tags that is tried; the largest dictionary holds 1000 markers
LEAST_AGREEING = 0.8  #: share of the markers that a layout must explain; the rest are misread
LEAST_PLACED = 3  #: linked markers; fewer do not determine a layout
LEAST_EXPLAINED = 6  #: markers that a layout must explain in all pictures together: four may be chance

Place = tuple[int, int]  #: column and row
Cell = Callable[[int], Place]  #: the place of a marker id in a layout


@dataclass(frozen=True)
class Patch:
    """A connected set of neighbouring markers in one picture: positions by id, relative to an arbitrary origin."""

    picture: int
    places: dict[int, Place]


@dataclass(frozen=True)
class Found:
    """A board of markers found in pictures.

    Attributes
    ----------
    board : TagBoard
        With lengths in squares, or in sides of a tag.
    pictures : tuple of int
        Indices of the pictures that show it.
    markers : int
        How many markers in them it explains.
    """

    board: TagBoard
    pictures: tuple[int, ...]
    markers: int


def find_boards(views: Sequence[Sequence[Marker]], family: Family) -> list[Found]:
    """The boards formed by the markers of some pictures, the one with most markers first.

    Markers that are linked in any picture belong to one board, so that several boards in one picture are
    distinguished by their ids.

    Parameters
    ----------
    views : sequences of markers
        Of each picture, all of one family.
    family : (dictionary, border)
    """
    for layout, diagonal in ((_charuco, True), (_tags_in_rows, False)):
        if layout is _charuco and family[1] != 1:
            continue
        patches, step = _patches(views, diagonal)
        groups = list(_boards_apart(patches))
        foreign = [set(_ids(patches)) - set(_ids(group)) for group in groups]
        found = [f for g, o in zip(groups, foreign, strict=True) if (f := layout(g, step, family, o))]
        if len(groups) > 1:
            whole = layout(patches, step, family, set())
            if whole is not None and (len(found) < 2 or _on_one_plane(whole.board, views)):
                found = [whole]
        if found:
            return sorted(found, key=lambda f: -f.markers)
    return []


def explains(board: TagBoard, views: Sequence[Sequence[Marker]]) -> float:
    """The share of the markers of some pictures that are at their places on a board.

    Markers with other ids count against the board only if their neighbours are on it.
    """
    places = _places(board)
    patches, _ = _patches(views, isinstance(board, Charuco))
    patches = [p for p in patches if places.keys() & p.places.keys()]
    known = [Patch(p.picture, {m: q for m, q in p.places.items() if m in places}) for p in patches]
    total = sum(len(p.places) for p in patches)
    return _agreeing(known, lambda marker: places[marker]) / total if total else 0.0


def _places(board: TagBoard) -> dict[int, Place]:
    """The column and row of each marker, by id, in the markers' own frame."""
    corners = board.tag_corners
    side = corners[0, [1, 3]] - corners[0, 0]
    along = (corners[:, 0] - corners[0, 0]) @ (side / np.linalg.norm(side, axis=1, keepdims=True)).T
    step = board.square if isinstance(board, Charuco) else board.pitch
    return {int(m): (int(x), int(y)) for m, (x, y) in zip(board.tag_ids, np.rint(along / step), strict=True)}


def _charuco(patches: Sequence[Patch], step: float, family: Family, foreign: set[int]) -> Found | None:
    """The ChArUco board, with squares of side 1, that explains the positions of markers."""
    ids = _ids(patches)
    if not ids:
        return None
    cells = [
        partial(_charuco_cell, columns=columns, start=start, first=origin)
        for columns in range(LEAST_SQUARES, LONGEST_ROW)
        for start in (1, 0)  # the first square is black, or holds a marker
        for origin in _origins(ids, foreign)
    ]
    cell = max(cells, key=lambda c: _agreeing(patches, c))  # the first of equals
    count, (columns, start, origin) = _agreeing(patches, cell), cell.keywords.values()
    rows = cell(_last(patches, cell))[1] + 1
    legacy = start == 0
    rows += (
        legacy and rows % 2
    )  # with an odd number of rows the first square is always black: a row is missing
    needed = origin + columns * rows // 2
    if not _enough(count, len(ids)) or rows < LEAST_SQUARES or needed > marker_count(family[0]):
        return None
    marker = float(np.clip(1 / step, *MARKER))
    name = smallest(family[0], needed)
    return Found(Charuco(columns, rows, 1.0, marker, name, "unit", legacy, origin), _pictures(patches), count)


def _tags_in_rows(patches: Sequence[Patch], step: float, family: Family, foreign: set[int]) -> Found | None:
    """The grid of separate markers, with sides of 1, that explains the positions of markers.

    Kalibr's ids start at the lower left and go up, cv2's start at the upper left and go down. The spacing is only
    approximate: small squares at the tags' corners make their outlines inaccurate.
    """
    name, border = family
    ids = _ids(patches)
    if not ids:
        return None
    cells = [
        partial(way, columns=columns, first=origin)
        for way in ((_kalibr_cell, _cv2_cell) if name.startswith("APRILTAG") else (_cv2_cell,))
        for columns in range(2, LONGEST_ROW)
        for origin in _origins(ids, foreign)
    ]
    cell = max(cells, key=lambda c: _agreeing(patches, c))
    count, (columns, origin) = _agreeing(patches, cell), cell.keywords.values()
    rows = cell(_last(patches, cell))[1] + 1
    if not _enough(count, len(ids)) or rows < 2 or origin + columns * rows > marker_count(name):
        return None
    spacing = float(np.clip(step - 1, *GAPS))
    board: TagBoard
    if cell.func is _kalibr_cell:
        board = AprilGrid(columns, rows, 1.0, min(spacing, LARGEST_GAP), "unit", name, border, origin)
    else:
        board = TagGrid(
            columns, rows, 1.0, spacing, smallest(name, origin + columns * rows), "unit", border, origin
        )
    return Found(board, _pictures(patches), count)


def _origins(ids: Sequence[int], foreign: set[int]) -> Sequence[int]:
    """The possible first ids: the smallest, and 0 unless another board has ids below the smallest."""
    first = min(ids)
    return list(dict.fromkeys((first,) if any(0 <= f < first for f in foreign) else (0, first)))


def _enough(count: int, total: int) -> bool:
    return count >= max(LEAST_EXPLAINED, LEAST_AGREEING * total)


def _ids(patches: Sequence[Patch]) -> list[int]:
    return [marker for patch in patches for marker in patch.places]


def _last(patches: Sequence[Patch], cell: Cell) -> int:
    """The largest id of the markers that a layout explains; a misread marker must not extend the board."""
    return max(m for patch in patches for m in _explained(patch, cell))


def _pictures(patches: Sequence[Patch]) -> tuple[int, ...]:
    return tuple(sorted({p.picture for p in patches}))


def _kalibr_cell(marker: int, columns: int, first: int = 0) -> Place:
    """The column and row of a tag in its cv2 frame, which is rotated by 180 degrees relative to Kalibr's.

    Kalibr's ids increase to the right and up, hence in that frame to the left and down.
    """
    marker -= first
    return -(marker % columns), marker // columns


def _cv2_cell(marker: int, columns: int, first: int = 0) -> Place:
    """The column and row of a marker of cv2's grids, whose ids increase to the right and down."""
    marker -= first
    return marker % columns, marker // columns


def _charuco_cell(marker: int, columns: int, start: int, first: int = 0) -> Place:
    """Column and row of the square that holds a marker; `start` is the column of marker 0."""
    here, other = len(range(start, columns, 2)), len(range(1 - start, columns, 2))
    pairs, rest = divmod(marker - first, here + other)
    if rest < here:
        return start + 2 * rest, 2 * pairs
    return 1 - start + 2 * (rest - here), 2 * pairs + 1


def _agreeing(patches: Sequence[Patch], cell: Cell) -> int:
    """The number of markers whose relative positions agree with the layout."""
    return sum(len(_explained(patch, cell)) for patch in patches)


def _explained(patch: Patch, cell: Cell) -> list[int]:
    """The ids of a patch whose positions agree with a layout, for the best choice of its origin."""
    offset = {m: (x - cell(m)[0], y - cell(m)[1]) for m, (x, y) in patch.places.items()}
    best = Counter(offset.values()).most_common(1)[0][0]
    return [m for m, o in offset.items() if o == best]


def _boards_apart(patches: Sequence[Patch]) -> Iterator[list[Patch]]:
    """Groups of patches that share ids, directly or through others."""
    left = list(patches)
    while left:
        group, ids = [left.pop()], set()
        ids |= set(group[0].places)
        while more := [p for p in left if ids & set(p.places)]:
            group += more
            left = [p for p in left if not any(p is q for q in more)]
            ids = ids.union(*(p.places for p in more))
        yield group


def _on_one_plane(board: TagBoard, views: Sequence[Sequence[Marker]]) -> bool:
    """Return whether markers without linked neighbours are consistent with one board."""
    own = {int(tag): k for k, tag in enumerate(board.tag_ids)}
    right = total = 0
    for view in views:
        seen = [m for m in view if m.id in own]
        tags = np.array([own[m.id] for m in seen], int)
        corners = np.array([m.corners for m in seen]).reshape(-1, 4, 2)
        right += len(consistent(board.tag_corners[tags], corners))
        total += len(seen)
    return right >= LEAST_AGREEING * total


def _patches(views: Sequence[Sequence[Marker]], diagonal: bool) -> tuple[list[Patch], float]:
    """The linked markers of each picture, and the step in marker sides."""
    frames = [_frames(view) for view in views]
    steps = np.concatenate([_steps(offset, diagonal) for _, offset in frames] or [np.zeros(0)])
    if len(steps) < FEWEST_STEPS:
        return [], 0.0
    step = float(np.median(steps))
    patches = [
        Patch(number, {view[k].id: place for k, place in places.items()})
        for number, (view, (near, offset)) in enumerate(zip(views, frames, strict=True))
        for places in _walk(near, offset / step, diagonal)
    ]
    return [p for p in patches if len(p.places) >= LEAST_PLACED], step


def _frames(view: Sequence[Marker]) -> tuple[Array, Array]:
    """The nearest markers (K, n) of each marker, and their centres (K, n, 2) in its frame."""
    corners = np.array([m.corners for m in view]).reshape(-1, 4, 2)
    h = homography.homographies(corners, np.broadcast_to(UNIT, corners.shape), steps=0)
    centre = corners.mean(1)
    distance = np.linalg.norm(centre[:, None] - centre, axis=-1)
    near = np.argsort(distance, axis=1)[:, 1 : NEIGHBOURS + 1]
    return near, homography.transfer(h, centre[near])


def _steps(offset: Array, diagonal: bool) -> Array:
    """The distances to the nearest neighbours, along both axes or along one, in marker sides."""
    a = np.abs(offset).reshape(-1, 2)
    large, small = a.max(1), a.min(1)
    if diagonal:
        good = (small > DIAGONAL * large) & (large < FARTHEST)
        return _nearest(a[good].mean(1))
    return _nearest(large[(small < STRAIGHT * large) & (large < FARTHEST)])


def _nearest(lengths: Array) -> Array:
    """The lengths of single steps: those close to the shortest."""
    return lengths[lengths < SINGLE * np.percentile(lengths, SHORTEST)] if len(lengths) else lengths


def _walk(near: Array, offset: Array, diagonal: bool) -> Iterator[dict[int, Place]]:
    """The positions of each set of markers linked by integer steps, following the most reliable links first.

    A short step is more reliable than a long one, because errors of a marker's frame grow with distance.
    """
    whole = np.rint(offset).astype(int)
    miss, length = np.abs(offset - whole).max(-1), np.abs(whole).max(-1)
    fits = (miss < EVEN) & (length > 0) & (length <= 2)
    if diagonal:  # the squares of neighbouring markers have the same colour
        fits &= whole.sum(-1) % 2 == 0
    left = set(range(len(near)))
    while left:
        places: dict[int, Place] = {}
        queue = [(0.0, min(left), (0, 0))]
        while queue:
            _, here, place = heappop(queue)
            if here in places:
                continue
            places[here] = place
            for k in np.flatnonzero(fits[here]):
                there = int(near[here, k])
                if there in left and there not in places:
                    step = int(whole[here, k, 0]), int(whole[here, k, 1])
                    sure = float(length[here, k] + miss[here, k])
                    heappush(queue, (sure, there, (place[0] + step[0], place[1] + step[1])))
        left -= set(places)
        yield places
