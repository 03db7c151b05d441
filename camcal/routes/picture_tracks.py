"""Tracks of scene points over pictures: SIFT points matched between pairs of pictures and joined into tracks.

The pairs of pictures that are fully matched are neighbours in order, and those chosen by a vote of each picture's
largest points. Matches that do not agree with the fundamental matrix of their pair are removed; the others are joined
(union-find). A track with two points in one picture contains wrong matches and is removed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.matches import Points, matched, points_of
from camcal.errors import DataError
from camcal.model.pose import Array
from camcal.routes import epipolar
from camcal.routes.bundle import Tracks
from camcal.routes.read_lines import read_gray, same_size

#: largest number of pictures: matching the pairs of 100 takes some minutes
MOST_PICTURES = 100
#: pictures up to which all pairs are matched
ALL_PAIRS = 12
#: ... above it, for each picture: the next ones in order, and the most similar ones by the vote
NEIGHBOURS, ALIKE = 3, 5
#: points of strongest contrast used in each picture: of 1,000 to 5,000 in 30 rendered pictures, fewer give longer
#: tracks and a smaller sigma of f (.08 and .13 px), as weak points are seldom found again; twice 1,000 for pictures
#: that overlap less
MOST_POINTS = 2_000
#: least contrast of a point (cv2's default is .04): of 21 pictures of a chair, with few points, 43 of 69 pairs share
#: enough of them with .04 and the views fall apart; 67 of 67 do with .02, and no more with .013
CONTRAST = 0.02
#: px; longest side of a picture in which points are searched, larger ones are reduced: of rendered pictures of 12 MP,
#: whole and reduced, sigma of f is .15 and .19 px of 4375, and SIFT takes 4.5 and 1.7 s of each and 3 and 1.3 GB
LONGEST = 2_400
#: points that vote, the largest of a picture, which are visible from far and near
VOTERS = 300
#: least number of matches of a pair that agree: fewer may do so by chance
LEAST_MATCHES = 20
#: points of a picture that become tracks, those in most pictures: the time of the adjustment grows with their number,
#: and 300 points spread over a picture determine its pose to a fraction of a pixel
MOST_TRACKS = 300


def of_pictures(
    paths: Sequence[Path], seed: int = 0, said: Callable[[str], None] | None = None
) -> tuple[Tracks, list[str], int, tuple[int, int]]:
    """Tracks, names of the pictures, number of tracks, and the size of the pictures.

    Raises
    ------
    DataError
        If there are fewer than two or more than a hundred pictures, different sizes, or no two of the same scene.
    """
    files = list_pictures(paths)
    if not 2 <= len(files) <= MOST_PICTURES:
        raise DataError(
            f"pictures given: {len(files)}; 2 to {MOST_PICTURES} are needed.",
            "Give pictures of one scene from different positions.",
        )
    found, size = _points(files)
    tell = said or (lambda _: None)
    pairs = _pairs(found)
    tell(f"{len(files)} pictures, {len(pairs)} pairs to match.")
    joined = _Joined(len(p) for p in found)
    agreed = 0
    for first, second in pairs:
        own = matched(found[first], found[second])
        if len(own) < LEAST_MATCHES:
            continue
        uv = found[first].uv[own[:, 0]], found[second].uv[own[:, 1]]
        made = epipolar.fundamental(*uv, seed)
        if made is None or made[1].sum() < LEAST_MATCHES:
            continue
        agreed += 1
        joined.join(first, second, own[made[1]])
    if not agreed:
        raise DataError(
            f"no two of {len(files)} pictures share {LEAST_MATCHES} points.",
            "Give pictures of one textured scene, each overlapping others by half or more.",
        )
    tracks, count = _tracks(joined, found)
    tell(f"{agreed} pairs agree; {count} points in {len(tracks)} images.")
    return tracks, list(view_ids(files)), count, size


def _points(files: Sequence[Path]) -> tuple[list[Points], tuple[int, int]]:
    found, size = [], None
    for path in files:
        gray = read_gray(path, "view,point,u,v")
        size = same_size(path, gray, size)
        found.append(points_of(gray, MOST_POINTS, LONGEST, CONTRAST))
    assert size is not None
    return found, size


def _pairs(found: Sequence[Points]) -> list[tuple[int, int]]:
    """The pairs of pictures that are matched."""
    count = len(found)
    if count <= ALL_PAIRS:
        return list(combinations(range(count), 2))
    few = [p.largest(VOTERS) for p in found]
    votes = np.zeros((count, count))
    for a, b in combinations(range(count), 2):
        votes[a, b] = votes[b, a] = len(matched(few[a], few[b]))
    chosen = {(a, b) for a in range(count) for b in range(a + 1, min(a + 1 + NEIGHBOURS, count))}
    for a in range(count):
        alike = np.argsort(-votes[a], kind="stable")[:ALIKE].tolist()
        chosen |= {(min(a, b), max(a, b)) for b in alike if b != a and votes[a, b] > 0}
    return sorted(chosen)


class _Joined:
    """Disjoint sets of the points of all pictures (union-find with path halving)."""

    def __init__(self, counts: Iterable[int]):
        self.begins = np.cumsum([0, *counts])
        self.parent = np.arange(self.begins[-1])

    def root(self, i: int) -> int:
        while self.parent[i] != i:
            self.parent[i] = self.parent[self.parent[i]]
            i = int(self.parent[i])
        return i

    def join(self, first: int, second: int, pairs: Array) -> None:
        for a, b in pairs.tolist():
            i, j = self.root(int(self.begins[first]) + a), self.root(int(self.begins[second]) + b)
            self.parent[max(i, j)] = min(i, j)


def _tracks(joined: _Joined, found: Sequence[Points]) -> tuple[Tracks, int]:
    """The consistent tracks with at least two images, the longest of each picture."""
    root = np.array([joined.root(i) for i in range(len(joined.parent))])
    view = np.repeat(np.arange(len(found)), np.diff(joined.begins))
    uv = np.concatenate([p.uv for p in found])
    length = np.bincount(root, minlength=len(root))
    # a set that holds two points of a picture has fewer distinct (set, picture) than points
    distinct = np.bincount(np.unique(np.stack([root, view]), axis=1)[0], minlength=len(root))
    good = (length >= 2) & (distinct == length)
    chosen = np.zeros(len(root), bool)
    for v in range(len(found)):
        own = np.unique(root[(view == v) & good[root]])
        chosen[own[np.argsort(-length[own], kind="stable")[:MOST_TRACKS]]] = True
    rows = np.flatnonzero(chosen[root])
    _, point = np.unique(root[rows], return_inverse=True)
    return Tracks(view[rows], point, uv[rows]), int(point.max(initial=-1)) + 1
