"""From single corners to a grid: each corner's neighbours along its edges, then whole numbers as coordinates.

No lens and no plane is assumed: two corners are neighbours when an edge of one leads to the other, bright
and dark lie on the same sides at both ends, and the picture shows that edge between them. So a grid is
found as well through a fisheye as on a bent sheet.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from scipy.spatial import cKDTree

from camcal.detect.candidates import Candidates

Array = np.ndarray

NEAREST = 20  #: candidates among which the neighbour on an edge is looked for
ANGLE = 0.40  #: rad; how far an edge may point past the neighbour it leads to
LIKE = np.log(4)  #: by what factor the contrast of neighbours may differ
LEAST_NODES = 6


def neighbours(gray: Array, found: Candidates) -> tuple[Array, Array]:
    """The neighbour on each of the four rays.

    Returns
    -------
    other, back : (N, 4) int arrays
        Index of the neighbour on each ray, or -1, and which of its rays leads back.
    """
    count = len(found)
    other, back = np.full((count, 4), -1), np.zeros((count, 4), int)
    if count < LEAST_NODES:
        return other, back
    near = np.asarray(cKDTree(found.xy).query(found.xy, k=min(NEAREST + 1, count))[1])[:, 1:]
    step = found.xy[near] - found.xy[:, None]
    direction = np.arctan2(step[..., 1], step[..., 0])
    own, own_miss = _closest_ray(found.rays[:, None], direction)
    its, its_miss = _closest_ray(found.rays[near], direction + np.pi)
    fits = (own_miss < ANGLE) & (its_miss < ANGLE) & ((own + its) % 2 == 1)
    fits &= np.abs(np.log(found.contrast[near] / found.contrast[:, None])) < LIKE
    rows = np.arange(count)
    for ray in range(4):  # candidates are in order of distance: the first that fits is the nearest
        here = fits & (own == ray)
        first = here.argmax(1)
        some = here[rows, first]
        other[some, ray] = near[rows, first][some]
        back[some, ray] = its[rows, first][some]
    mutual = other[other, back] == rows[:, None]  # -1 looks up the last row; masked by the next condition
    seen = np.where((other >= 0) & mutual, other, -1)
    start, along = np.nonzero(seen >= 0)
    real = _edge_between(gray, found, start, seen[start, along], along % 2 == 0)
    seen[start[~real], along[~real]] = -1
    return _in_squares(seen, back), back


def _in_squares(other: Array, back: Array) -> Array:
    """Keep only the links that are a side of a closed square of four corners: chance does not make those."""
    kept = np.full_like(other, -1)
    rows = np.arange(len(other))
    for ray in range(4):
        turn = (ray + 1) % 4
        j, k = other[:, ray], other[:, turn]
        m, n = (back[:, ray] - 1) % 4, (back[:, turn] + 1) % 4
        corner = other[j, m]
        closed = (j >= 0) & (k >= 0) & (corner >= 0) & (corner == other[k, n])
        i, j, k, m, n, corner = (a[closed] for a in (rows, j, k, m, n, corner))
        for a, q in ((i, np.full_like(i, ray)), (i, np.full_like(i, turn)), (j, m), (k, n)):
            kept[a, q] = other[a, q]
            kept[other[a, q], back[a, q]] = a
    return kept


def _closest_ray(rays: Array, direction: Array) -> tuple[Array, Array]:
    """Index of the ray closest to a direction, and the angle between them."""
    miss = np.abs((rays - direction[..., None] + np.pi) % (2 * np.pi) - np.pi)
    best = miss.argmin(-1)
    return best, np.take_along_axis(miss, best[..., None], -1)[..., 0]


def _edge_between(gray: Array, found: Candidates, i: Array, j: Array, bright_clockwise: Array) -> Array:
    """Whether the picture is brighter on the right side all along the way from corner i to corner j."""
    if not len(i):
        return np.zeros(0, bool)
    start, step = found.xy[i], found.xy[j] - found.xy[i]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    normal = np.c_[-step[:, 1], step[:, 0]] / length  # clockwise of the step, y points down
    side = np.maximum(1.5, 0.17 * length) * normal
    along = start[:, None] + np.linspace(0.2, 0.8, 5)[None, :, None] * step[:, None]
    at = np.stack([along + side[:, None], along - side[:, None]]).astype(np.float32)
    flat = at.reshape(-1, 5, 2)
    value = cv2.remap(gray, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = (value[: len(i)] - value[len(i) :]) * np.where(bright_clockwise, 1, -1)[:, None]
    contrast = np.minimum(found.contrast[i], found.contrast[j])
    return (difference > 0.4 * contrast[:, None]).all(1)


def grow(other: Array, back: Array) -> list[dict[tuple[int, int], int]]:
    """Number the corners of each connected piece of the graph: {(column, row): candidate}, the largest first.

    A link that contradicts what is numbered already is passed over.
    """
    done = np.zeros(len(other), bool)
    links = (other >= 0).sum(1)
    pieces = []
    steps = ((1, 0), (0, 1), (-1, 0), (0, -1))
    for seed in np.argsort(-links, kind="stable"):
        if done[seed] or links[seed] < 2:
            continue
        turn = {int(seed): 0}  # which direction of the grid a corner's ray 0 points to
        place = {int(seed): (0, 0)}
        taken = {(0, 0): int(seed)}
        queue = deque([int(seed)])
        while queue:
            here = queue.popleft()
            for ray in range(4):
                there = int(other[here, ray])
                if there < 0 or there in place or done[there]:
                    continue
                heading = (turn[here] + ray) % 4
                target = (place[here][0] + steps[heading][0], place[here][1] + steps[heading][1])
                if target in taken:
                    continue
                taken[target], place[there] = there, target
                turn[there] = (heading + 2 - int(back[here, ray])) % 4
                queue.append(there)
        done[list(place)] = True
        if len(taken) >= LEAST_NODES:
            pieces.append(taken)
    return sorted(pieces, key=len, reverse=True)
