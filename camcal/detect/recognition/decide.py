"""The joint decision over all pictures: the target, how many show it, and what else was found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from camcal.detect.disc_grid import part_of
from camcal.detect.recognition.families import LEAST_MARKERS, family_of
from camcal.detect.recognition.layout import LEAST_AGREEING, Found, explains, find_boards
from camcal.detect.recognition.look import Sight
from camcal.detect.recognition.measure import measured
from camcal.detect.targets.aprilgrid import AprilGrid
from camcal.detect.targets.base import Target
from camcal.detect.targets.charuco import Charuco
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.targets.circles import AsymmetricCircles, Circles
from camcal.detect.targets.squares import SquareGrid
from camcal.detect.targets.tag_board import TagBoard
from camcal.detect.targets.tag_grid import TagGrid
from camcal.records import dataclass

Array = np.ndarray

ROUGHLY = 0.04  #: relative difference of a proportion, from marker outlines, below which it is not measured
CLOSELY = 0.1  #: the same for a measured proportion: calipers on a print are more accurate
#: least share of the pictures with a checkerboard that must show all of it for the votes to count
LEAST_VOTES = 0.35
AGREEING = 0.6  #: share that must show a part of the same size if none shows the whole board


@dataclass(frozen=True)
class Answer:
    """A target found in pictures.

    Attributes
    ----------
    target : Target
        With lengths in squares, tags or disc spacings. The size of a checkerboard is provisional; see `board_size`.
    pictures : tuple of int
        Indices of the pictures that show it.
    whole : bool
        Whether a picture shows all four borders of a grid of discs or squares.
    """

    target: Target
    pictures: tuple[int, ...]
    whole: bool = True


def answers(sights: Sequence[Sight]) -> list[Answer]:
    """The targets found in pictures, the most frequent first.

    A picture whose squares hold markers, or in which a board of markers was found, does not count as one of a
    checkerboard.
    """
    found = [Answer(f.board, f.pictures) for f in _boards(sights)]
    with_markers = {i for a in found for i in a.pictures}
    for kind in (Circles, AsymmetricCircles):
        sizes = [s.discs[:2] if s.discs and s.discs[2] == kind.staggered else None for s in sights]
        found += [Answer(kind(*size), shown, whole) for size, shown, whole in _whole_grids(sights, sizes)]
    sizes = [s.squares[:2] if s.squares else None for s in sights]
    for (columns, rows), shown, whole in _whole_grids(sights, sizes):
        spacing = float(np.median([s.squares[2] for i in shown if (s := sights[i]).squares]))
        found.append(Answer(SquareGrid(columns, rows, 1.0, spacing, "unit"), shown, whole))
    plain = tuple(i for i, s in enumerate(sights) if s.board and not s.marked and i not in with_markers)
    if plain:
        columns, rows = Counter(sights[i].board for i in plain).most_common(1)[0][0] or (0, 0)
        found.append(Answer(Checkerboard(columns, rows), plain))
    return sorted(found, key=lambda a: (-len(a.pictures), -len(a.target.points)))


def _whole_grids(
    sights: Sequence[Sight], sizes: Sequence[tuple[int, int] | None]
) -> list[tuple[tuple[int, int], tuple[int, ...], bool]]:
    """The sizes of grids, the pictures that show them, and whether one of these shows all four borders.

    A grid that is cut off in every picture, and fits into another that is seen whole, is not a separate board.
    """
    ends = {size for s, size in zip(sights, sizes, strict=True) if size and s.whole}
    shown = {size: tuple(i for i, other in enumerate(sizes) if other == size) for size in sizes if size}
    return [
        (size, pictures, size in ends)
        for size, pictures in shown.items()
        if size in ends or not any(part_of(size, whole) for whole in ends)
    ]


def _boards(sights: Sequence[Sight]) -> list[Found]:
    """The boards of markers of every family that was read."""
    found = []
    families = [f for s in sights for f in (s.family, *(f for f, _ in s.more)) if f]
    for family in dict.fromkeys(families):
        numbers = [i for i, s in enumerate(sights) if s.of_family(family)]
        for board in find_boards([sights[i].of_family(family) for i in numbers], family):
            found.append(Found(board.board, tuple(numbers[i] for i in board.pictures), board.markers))
    return found


def unread(sights: Sequence[Sight], best: Answer | None) -> int:
    """The number of pictures with squares whose markers cannot be read, if these are the majority; otherwise 0."""
    marked = sum(s.marked and len(s.markers) < LEAST_MARKERS for s in sights)
    return marked if best is None or marked > len(best.pictures) else 0


def board_size(sights: Sequence[Sight]) -> tuple[tuple[int, int], bool, int] | None:
    """The size of a plain checkerboard from all pictures.

    Returns
    -------
    size : (columns, rows), the longer side first
    whole : bool
        Whether pictures show the borders of the board; otherwise the size is that of the part that most of them show.
    votes : int
        How many pictures show that size.

    None is returned instead if the pictures do not agree.
    """
    seen = [s for s in sights if s.board and not s.marked]
    ends = Counter(s.board for s in seen if s.whole)
    if ends and ends.most_common(1)[0][1] >= LEAST_VOTES * len(seen):
        size, votes = ends.most_common(1)[0]
        return (size, True, votes) if size else None
    parts = Counter(s.board for s in seen)
    size, votes = parts.most_common(1)[0] if parts else (None, 0)
    if size is None or votes < max(2, AGREEING * len(seen)):
        return None
    return size, False, votes


def contradiction(target: Target, sights: Sequence[Sight], pictures: Sequence[Array]) -> Target | None:
    """The board that the markers show, if it differs from the requested one.

    Only boards of markers are compared; a partly visible board does not count as different. The lengths of the
    result are in the unit of `target`.

    Parameters
    ----------
    target : Target
    sights : sequence of Sight
    pictures : sequence of (height, width) arrays
        Picture of each sight.
    """
    if not isinstance(target, TagBoard):
        return None
    found = _boards(sights)
    if not found:
        return None
    own = family_of(target.dictionary, target.border)
    # if boards of several dictionaries are visible, the requested one is compared
    own_first = sorted(
        found, key=lambda f: (family_of(f.board.dictionary, f.board.border) != own, -len(f.pictures))
    )
    board: TagBoard = own_first[0].board
    numbers = own_first[0].pictures
    views = [sights[i].of_family(own) for i in numbers]
    same = type(board) is type(target) and family_of(board.dictionary, board.border) == own
    if not (same and explains(target, views) >= LEAST_AGREEING and _alike(target, board, ROUGHLY)):
        closer = measured(board, [pictures[i] for i in numbers])
        if not (same and explains(target, views) >= LEAST_AGREEING and _alike(target, closer, CLOSELY)):
            return closer.scaled(target.square, target.unit)
    return None


def _alike(target: Target, other: Target, within: float) -> bool:
    """Return whether markers have the requested size, and tags the requested gap."""
    if isinstance(target, Charuco) and isinstance(other, Charuco):
        said, seen = target.marker / target.square, other.marker / other.square
    elif isinstance(target, (AprilGrid, TagGrid)) and isinstance(other, (AprilGrid, TagGrid)):
        said, seen = 1 + target.spacing, 1 + other.spacing
    else:
        return False
    return abs(seen / said - 1) < within


def words(target: Target) -> str:
    """Describe a target: `a ChArUco board of 9x7 squares, markers 0.5 of a square, dictionary 4X4_50`."""
    return _words(target) + ", black and white exchanged" * target.negative


def _words(target: Target) -> str:
    size = f"{target.columns}x{target.rows}"
    if isinstance(target, Charuco):
        legacy = ", OpenCV's layout before 4.6" * target.legacy
        ratio = f"markers {target.marker / target.square:.3g} of a square"
        return f"a ChArUco board of {size} squares, {ratio}, dictionary {target.dictionary}{legacy}"
    if isinstance(target, AprilGrid):
        return f"an AprilTag grid of {size} tags, {target.dictionary}, gaps {target.spacing:.3g} of a tag"
    if isinstance(target, TagGrid):
        return f"a grid of {size} markers, {target.dictionary}, gaps {target.spacing:.3g} of a marker"
    if isinstance(target, SquareGrid):
        return f"a grid of {size} separate squares, gaps {target.spacing:.3g} of a side"
    if isinstance(target, Circles):
        return f"a grid of {size} discs" + " in staggered rows" * target.staggered
    return f"a checkerboard of {size} inner corners"
