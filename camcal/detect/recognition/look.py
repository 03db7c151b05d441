"""The contents of one picture if no target is given: markers, a checkerboard, discs, or nothing."""

from __future__ import annotations

import numpy as np

from camcal.detect.recognition.families import Family, Marker, read_markers, read_others
from camcal.detect.recognition.layout import find_boards
from camcal.detect.recognition.marks import squares_hold_marks
from camcal.detect.targets import circles, squares
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.checkerboard import find_any
from camcal.records import dataclass

Array = np.ndarray

MIRRORED = "the markers in the picture are mirror images"


@dataclass(frozen=True)
class Sight:
    """The contents of a picture.

    Attributes
    ----------
    family : (dictionary, border) or None
        Of the markers that could be read.
    markers : tuple of Marker
    board : (columns, rows) or None
        Inner corners of a checkerboard.
    whole : bool
        Whether the picture shows all four borders of that board (of the discs, of the squares), so that its size is
        certain.
    marked : bool
        Whether the board's squares hold markers (read or not), so that it is not a plain checkerboard.
    discs : (columns, rows, staggered) or None
        A grid of discs.
    squares : (columns, rows, spacing) or None
        A grid of separate squares.
    more : tuple of (family, markers)
        Of further families, if boards of several families are visible.
    mirrored : bool
        Whether the markers are mirror images.
    """

    family: Family | None = None
    markers: tuple[Marker, ...] = ()
    board: tuple[int, int] | None = None
    whole: bool = False
    marked: bool = False
    discs: tuple[int, int, bool] | None = None
    squares: tuple[int, int, float] | None = None
    more: tuple[tuple[Family, tuple[Marker, ...]], ...] = ()
    mirrored: bool = False

    @property
    def undecided(self) -> bool:
        """Whether there is nothing like a target, or a board whose markers cannot be read."""
        return self == Sight() or (self.marked and self.family is None and not self.mirrored)

    @property
    def plain(self) -> bool:
        """Whether there is a whole checkerboard and no marker."""
        return self.board is not None and self.whole and not self.marked and self.family is None

    def of_family(self, family: Family) -> tuple[Marker, ...]:
        """The markers of one family."""
        return next((m for f, m in ((self.family, self.markers), *self.more) if f == family), ())


def look(
    gray: Array, seconds: float, expected: tuple[int, int] | None = None
) -> tuple[Sight, Detection | Miss]:
    """Search for every kind of target in a picture.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    seconds : float
        Processor time that each search may take.
    expected : (columns, rows), optional
        Inner corners of a plain board. If the picture shows all of it, no markers are searched for.

    Returns
    -------
    sight : Sight
    found : Detection or Miss
        The corners of a plain checkerboard, or the reason why there are none.
    """
    free = find_any(gray, seconds) if expected else None
    if (
        isinstance(free, tuple)
        and free[:2] == (expected, True)
        and not squares_hold_marks(gray, free[2], free[0])
    ):
        return Sight(board=expected, whole=True), free[2]
    family, markers = read_markers(gray)
    if family is not None and find_boards([markers], family):
        sight = Sight(family, tuple(markers), more=read_others(gray, family, markers))
        return sight, Miss("other-target", "the picture shows markers")
    free = free or find_any(gray, seconds)
    if isinstance(free, Miss):
        return _other_kinds(gray, seconds, free)
    size, whole, found = free
    if not squares_hold_marks(gray, found, size):
        return Sight(family, tuple(markers), size, whole), found
    family, markers = read_markers(gray, family, closely=True)
    if family is None and _mirrored(gray):
        return Sight(board=size, whole=whole, marked=True, mirrored=True), Miss("mirrored", MIRRORED)
    sight = Sight(family, tuple(markers), size, whole, marked=True)
    return sight, Miss("other-target", "the squares of the board contain markers")


def _other_kinds(gray: Array, seconds: float, miss: Miss) -> tuple[Sight, Miss]:
    grid = circles.find_any(gray, seconds)
    if grid is not None:
        sight = Sight(discs=(grid.columns, grid.rows, grid.staggered), whole=not grid.leaves(gray.shape))
        return sight, Miss("other-target", "the picture shows discs")
    separate = squares.find_any(gray, seconds)
    if separate is not None:
        grid, spacing = separate
        sight = Sight(squares=(grid.columns, grid.rows, spacing), whole=not grid.leaves(gray.shape))
        return sight, Miss("other-target", "the picture shows separate squares")
    family, markers = read_markers(gray, closely=True)
    if family is None and _mirrored(gray):
        return Sight(mirrored=True), Miss("mirrored", MIRRORED)
    return Sight(family, tuple(markers)), miss


def _mirrored(gray: Array) -> bool:
    """Return whether a board of markers is found in the mirrored picture."""
    family, markers = read_markers(np.ascontiguousarray(gray[:, ::-1]))
    return family is not None and bool(find_boards([markers], family))
