"""Which target pictures show, when nothing is said of it: its kind, its size and its proportions.

A few of the pictures are looked at. Markers vote for a dictionary, and their places and ids tell the layout;
discs form a lattice; squares a checkerboard. No picture tells a length: a square, a tag or a distance is 1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from camcal.detect.marker_layout import (
    Marker,
    aprilgrid_board,
    aprilgrid_spec,
    charuco_board,
    charuco_spec,
    measured_spacing,
)
from camcal.detect.pyramid import reduced, reductions, to_8_bits
from camcal.detect.search import search
from camcal.detect.targets import circles
from camcal.detect.targets.base import Miss
from camcal.detect.targets.dictionaries import detect, like_markers

Array = np.ndarray

MOST_PICTURES = 12  #: that are looked at
ENOUGH_VOTES = 3  #: pictures that say the same
LEAST_MARKERS = 4
READ = 0.5  #: share of what looks like markers that a family must read for no other to be tried
CLEARLY_ROUND = 5.0  #: px; radius from which on a square is not taken for a disc
SECONDS = 1.0  #: that a search in one picture may take
#: the largest dictionary of each family holds the smaller ones; tags come with a border of one cell or, as
#: Kalibr prints them, two
FAMILIES = (
    ("4X4_1000", 1),
    ("5X5_1000", 1),
    ("6X6_1000", 1),
    ("7X7_1000", 1),
    ("APRILTAG_36h11", 2),
    ("APRILTAG_36h11", 1),
    ("APRILTAG_25h9", 2),
    ("APRILTAG_25h9", 1),
    ("APRILTAG_16h5", 2),
    ("APRILTAG_16h5", 1),
    ("APRILTAG_36h10", 1),
    ("ARUCO_MIP_36h12", 1),
    ("ARUCO_ORIGINAL", 1),
)


def recognise(pictures: Iterable[Array]) -> str | None:
    """The spec of the target that most pictures show, or None.

    Parameters
    ----------
    pictures : iterable of (height, width) uint8 or uint16 arrays
        Read one by one, and no more than are needed.

    Returns
    -------
    str or None
        For `camcal.detect.targets.make`. Lengths are those of a square (or tag, or distance) of 1.
    """
    votes: Counter[str] = Counter()
    markers = _MarkerVotes()
    for index, gray in enumerate(pictures):
        if index >= MOST_PICTURES:
            break
        found = markers.add(gray)
        if not found:
            spec = _plain_spec(gray)
            votes.update([spec] if spec else [])
        if votes and votes.most_common(1)[0][1] >= ENOUGH_VOTES:
            break
        if markers.count() >= ENOUGH_VOTES and markers.count() > sum(votes.values()):
            break
    spec = markers.spec()
    if spec is not None and markers.count() >= sum(votes.values()):
        return spec
    return votes.most_common(1)[0][0] if votes else spec


@dataclass
class _MarkerVotes:
    """Markers of each family seen in the pictures so far, a list for each picture."""

    seen: dict[tuple[str, int], list[list[Marker]]] = field(default_factory=dict)
    pictures: dict[tuple[str, int], list[Array]] = field(default_factory=dict)

    def add(self, gray: Array) -> bool:
        """Look for markers of every family in a picture; of the family that is already known, first."""
        picture = to_8_bits(gray)
        small = reduced(picture, reductions(picture.shape)[0])
        expected = like_markers(small)
        if expected < LEAST_MARKERS:
            return False
        best: tuple[int, tuple[str, int], list[Marker]] = (0, FAMILIES[0], [])
        for family in sorted(FAMILIES, key=lambda f: -len(self.seen.get(f, ()))):
            ids, corners = detect(small, *family)
            if len(ids) > best[0]:
                best = len(ids), family, [Marker(int(i), c) for i, c in zip(ids, corners, strict=True)]
            if best[0] >= LEAST_MARKERS and (family in self.seen or best[0] > READ * expected):
                break
        if best[0] < LEAST_MARKERS:
            return False
        self.seen.setdefault(best[1], []).append(best[2])
        self.pictures.setdefault(best[1], []).append(gray)
        return True

    def count(self) -> int:
        """Pictures that show markers of the commonest family."""
        return max((len(views) for views in self.seen.values()), default=0)

    def spec(self) -> str | None:
        """The board that explains the places of the markers."""
        for family in sorted(self.seen, key=lambda f: -len(self.seen[f])):
            name, border = family
            views = self.seen[family]
            board = charuco_board(views, name) if border == 1 else None
            if board is not None:
                return charuco_spec(board)
            grid = aprilgrid_board(views, name, border) if name.startswith("APRILTAG") else None
            if grid is not None:
                return aprilgrid_spec(measured_spacing(grid, self.pictures[family]))
        return None


def _plain_spec(gray: Array) -> str | None:
    """A grid of discs or of squares.

    Small squares look round, and the gaps between discs look like corners: discs large enough to tell decide.
    """
    found, _ = circles.search(gray, SECONDS, None, None)
    size = (
        np.sqrt(np.abs(np.linalg.det(found.discs.shape))) / found.factor if found is not None else np.zeros(1)
    )
    if found is None or np.median(size) < CLEARLY_ROUND:
        board = search(gray, SECONDS)
        if not isinstance(board, Miss) and board.whole:
            columns, rows = sorted(board.lattice.size, reverse=True)
            return f"checkerboard:{columns}x{rows}"
    if found is None:
        return None
    kind = "asymmetric-circles" if found.staggered else "circles"
    return f"{kind}:{found.columns}x{found.rows}"
