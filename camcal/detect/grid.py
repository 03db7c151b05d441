"""Grids of single marks (corners of squares, discs).

Each mark has four rays, the directions in which its neighbours may lie. Two marks are neighbours if a ray of
each leads to the other. The marks of each connected component are then numbered by columns and rows. Neither a lens
model nor a plane is assumed, so that grids are also found through fisheye lenses and on bent sheets.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from camcal.geometry.neighbours import Neighbours
from camcal.records import dataclass

Array = np.ndarray

NEAREST = (
    16  #: nearest marks searched for the neighbour on a ray: at a tilt of 70 degrees six others are nearer
)
#: rad (23 degrees), half of what separates a ray from the diagonal; how far a ray may point past the neighbour
ANGLE = 0.40
LEAST_NODES = 6  #: marks of a component: two rows of three, two squares side by side; fewer may be chance
LEAST_SIDE = 3  #: marks along each side of a board of unknown size; smaller grids also arise by chance
MOST_PIECES = 4  #: grids of a picture that are examined, the largest first; a limit of work
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))  #: of (column, row) along the rays, clockwise in the picture


@dataclass(frozen=True)
class Marks:
    """The marks of a picture that may belong to a grid.

    Attributes
    ----------
    xy : (N, 2) array
        px.
    rays : (N, 4, 2) array
        Unit vectors, clockwise in the picture.
    size : (N,) array
        A positive quantity that changes little from neighbour to neighbour: contrast, radius.
    spread : float
        The factor by which it may change.
    alternating : bool
        Whether even rays lead to odd rays only, because bright and dark alternate from corner to corner.
    closed : bool
        Whether only links that are sides of a closed square of four marks count; such squares do not arise by chance.
    """

    xy: Array
    rays: Array
    size: Array
    spread: float
    alternating: bool
    closed: bool


def neighbours(
    marks: Marks, shown: Callable[[Array, Array, Array], Array] | None = None
) -> tuple[Array, Array]:
    """The neighbour on each of the four rays.

    Parameters
    ----------
    marks : Marks
    shown : callable, optional
        `shown(i, ray, j)` returns for links (L,) from marks i along their rays to marks j whether the picture
        shows them.

    Returns
    -------
    other, back : (N, 4) int arrays
        Index of the neighbour on each ray, or -1, and which of its rays leads back.
    """
    count = len(marks.xy)
    if count < LEAST_NODES:
        return np.full((count, 4), -1), np.zeros((count, 4), int)
    near = Neighbours(marks.xy).query(marks.xy, k=min(NEAREST + 1, count))[1][:, 1:]
    x, y = (marks.xy[:, i][near] - marks.xy[:, i, None] for i in (0, 1))
    distance = np.hypot(x, y)
    x, y, rays = x / distance, y / distance, marks.rays.transpose(1, 2, 0)
    ray, own = _closest(x * cos[:, None] + y * sin[:, None] for cos, sin in rays)
    its_ray, its = _closest(-x * cos[near] - y * sin[near] for cos, sin in rays)
    size = np.log(marks.size)
    fits = (np.minimum(own, its) > np.cos(ANGLE)) & (
        np.abs(size[near] - size[:, None]) < np.log(marks.spread)
    )
    if marks.alternating:
        fits &= (ray + its_ray) % 2 == 1
    rows = np.arange(count)
    other, back = np.full((count, 4), -1), np.zeros((count, 4), int)
    for r in range(4):  # the marks are in order of distance: the first that fits on a ray is the nearest
        here = fits & (ray == r)
        first = here.argmax(1)
        other[:, r] = np.where(here[rows, first], near[rows, first], -1)
        back[:, r] = its_ray[rows, first]
    other[other[other, back] != rows[:, None]] = -1  # links are mutual; -1 looks up the last row and stays -1
    if shown is not None:
        i, along = np.nonzero(other > rows[:, None])
        false = ~shown(i, along, other[i, along])
        i, along = i[false], along[false]
        other[other[i, along], back[i, along]] = -1
        other[i, along] = -1
    return _in_squares(other, back) if marks.closed else other, back


def _closest(cosines: Iterable[Array]) -> tuple[Array, Array]:
    """The index of the largest of several arrays at each position, and its value there."""
    every = iter(cosines)
    largest = next(every)
    which = np.zeros(largest.shape, int)
    for i, cosine in enumerate(every, 1):
        which[cosine > largest] = i
        largest = np.maximum(largest, cosine)
    return which, largest


def _in_squares(other: Array, back: Array) -> Array:
    """The links that are sides of closed squares; -1 for the others."""
    kept = np.full_like(other, -1)
    ray = np.arange(4)
    turn = (ray + 1) % 4
    j, k = other, other[:, turn]
    m, n = (back - 1) % 4, (back[:, turn] + 1) % 4
    corner = other[j, m]
    closed = (j >= 0) & (k >= 0) & (corner >= 0) & (corner == other[k, n])
    i, q = np.nonzero(closed)
    j, k, m, n = (a[closed] for a in (j, k, m, n))
    for a, b in ((i, q), (i, turn[q]), (j, m), (k, n)):
        kept[a, b] = other[a, b]
        kept[other[a, b], back[a, b]] = a
    return kept


def grow(other: Array, back: Array) -> list[Array]:
    """Number the marks of each connected component of the graph; the largest component first.

    A link that contradicts the numbering so far is ignored.

    Returns
    -------
    list of (rows, columns) int arrays
        Index of the mark at each position, -1 if there is none; the turn from columns to rows is clockwise.
    """
    degree = (other >= 0).sum(1)
    seeds = np.argsort(-degree, kind="stable")
    seeds = seeds[degree[seeds] >= 2].tolist()
    others, backs = other.tolist(), back.tolist()
    done: set[int] = set()
    pieces = []
    for seed in seeds:
        if seed in done:
            continue
        turn = {seed: 0}  # the direction of the grid to which a mark's ray 0 points
        place = {seed: (0, 0)}
        taken = {(0, 0)}
        queue = deque([seed])
        while queue:
            here = queue.popleft()
            column, row = place[here]
            for ray, there in enumerate(others[here]):
                if there < 0 or there in place or there in done:
                    continue
                heading = (turn[here] + ray) % 4
                target = (column + STEPS[heading][0], row + STEPS[heading][1])
                if target in taken:
                    continue
                taken.add(target)
                place[there] = target
                turn[there] = (heading + 2 - backs[here][ray]) % 4
                queue.append(there)
        done.update(place)
        if len(place) >= LEAST_NODES:
            pieces.append(place)
    return [_as_array(p) for p in sorted(pieces, key=len, reverse=True)]


def _as_array(place: dict[int, tuple[int, int]]) -> Array:
    at = np.array(list(place.values()))
    at -= at.min(0)
    index = np.full((at[:, 1].max() + 1, at[:, 0].max() + 1), -1)
    index[at[:, 1], at[:, 0]] = list(place)
    return index
