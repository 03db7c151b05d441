"""Points of edges or thin lines joined into chains, and chains joined into lines across gaps."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from camcal.detect.line_points import LinePoints

Array = np.ndarray

#: px; distance ahead at which the next point of a chain is searched, and radius of that search
STEP, REACH = 1.2, 1.0
#: the next point's direction is within 25 degrees: the noise of a direction at the threshold is about 10
NEXT = np.cos(np.radians(25))
#: px; shorter chains have no reliable direction
SHORTEST = 12
#: px at a chain's end that give its direction, and the longest gap to its continuation, px; for all chains ...
SHORT = (24.0, 24.0)
#: ... and then for those that are long enough
LONG = (80.0, 80.0)
#: how far from the extrapolated end its continuation may begin: px, plus a part of the distance
BESIDE, ASIDE = 1.0, 0.05
#: px; ends overlap by less: two points of a chain
OVERLAP = 2.0
#: px of a gap that count as much as 1 px of lateral offset: of two continuations the straighter one is taken
STRAIGHTER = 10.0
#: least number of points that give the direction of an end: that of two points of a curved or noisy line is arbitrary
LEAST_POINTS = 3
#: ... and how much it may turn
STRAIGHT_ON = np.cos(np.radians(6))


def chains(points: LinePoints) -> list[Array]:
    """Indices of the points of each chain, in order along it; chains shorter than `SHORTEST` are omitted."""
    if len(points) < SHORTEST:
        return []
    tree = cKDTree(points.uv)
    ahead = _neighbour(points, tree, points.along)
    behind = _neighbour(points, tree, -points.along)
    index = np.arange(len(points))
    # directions have no sign: a link counts if each point is a neighbour of the other, in either direction
    links = [(i, j) for i, j in ((index, ahead), (index, behind))]
    start, end = (np.concatenate(part) for part in zip(*links, strict=True))
    known = end >= 0
    start, end = start[known], end[known]
    back = (ahead[end] == start) | (behind[end] == start)
    groups = _components(start[back], end[back], len(points))
    return [g for g in (_ordered(points.uv, g) for g in groups) if len(g) >= SHORTEST]


def joined(points: LinePoints, parts: list[Array]) -> list[Array]:
    """Join chains that continue each other: across intersections, corners of a board, and small gaps."""
    for reach, gap in (SHORT, LONG):
        parts = [p for p in parts if reach == SHORT[0] or np.ptp(points.uv[p], 0).max() >= reach]
        while True:
            pairs = _continuations(points, parts, reach, gap)
            if not len(pairs):
                break
            groups = _components(pairs[:, 0], pairs[:, 1], len(parts))
            parts = [_ordered(points.uv, np.concatenate([parts[i] for i in g])) for g in groups]
    return parts


def _neighbour(points: LinePoints, tree: cKDTree, along: Array) -> Array:
    """The point (N,) nearest to a step along the direction; -1 if there is none."""
    distance, found = tree.query(points.uv + STEP * along, distance_upper_bound=REACH)
    known = np.isfinite(distance)
    out = np.where(known, found, 0)
    same = np.abs((along * points.along[out]).sum(1)) >= NEXT
    forward = ((points.uv[out] - points.uv) * along).sum(1) > 0
    return np.where(known & same & forward, out, -1)


def _components(start: Array, end: Array, count: int) -> list[Array]:
    """Members of each connected component."""
    graph = coo_matrix((np.ones(len(start), bool), (start, end)), (count, count))
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _ordered(uv: Array, members: Array) -> Array:
    """Members sorted along their direction of largest extent."""
    if len(members) < LEAST_POINTS:
        return members
    centred = uv[members] - uv[members].mean(0)
    main = np.linalg.eigh(centred.T @ centred)[1][:, 1]
    return members[np.argsort(centred @ main, kind="stable")]


def _continuations(points: LinePoints, parts: list[Array], reach: float, gap: float) -> Array:
    """Pairs (M, 2) of chains of which each is the best continuation of the other."""
    if len(parts) < 2:
        return np.zeros((0, 2), int)
    ends = [_end(points.uv[p[:: 1 if head else -1]], reach) for p in parts for head in (True, False)]
    place, out = np.stack([e[0] for e in ends]), np.stack([e[1] for e in ends])
    best = np.full(len(ends), -1)
    cost = np.full(len(ends), np.inf)
    near = cKDTree(place).query_pairs(gap, output_type="ndarray")
    near = near[near[:, 0] // 2 != near[:, 1] // 2]
    if not len(near):
        return np.zeros((0, 2), int)
    i, j = near.T
    apart = place[j] - place[i]
    distance = np.linalg.norm(apart, axis=1)
    aside = np.maximum(np.abs(_cross(out[i], apart)), np.abs(_cross(out[j], apart)))
    on = (out[i] * apart).sum(1) > -OVERLAP
    facing = (out[i] * out[j]).sum(1) <= -STRAIGHT_ON
    good = on & facing & (aside <= BESIDE + ASIDE * distance)
    for a, b, value in zip(i[good], j[good], (distance + STRAIGHTER * aside)[good], strict=True):
        for one, other in ((a, b), (b, a)):
            if value < cost[one]:
                cost[one], best[one] = value, other
    mutual = np.flatnonzero((best >= 0) & (best[best] == np.arange(len(best))))
    pairs = np.stack([mutual, best[mutual]], 1) // 2
    return pairs[pairs[:, 0] < pairs[:, 1]]


def _end(uv: Array, reach: float) -> tuple[Array, Array]:
    """The end of a chain and the outward unit vector, for points ordered from that end inwards."""
    part = uv[np.linalg.norm(uv - uv[0], axis=1) <= reach]
    if len(part) < LEAST_POINTS:
        part = uv[:LEAST_POINTS]
    centre = part.mean(0)
    main = np.linalg.eigh((part - centre).T @ (part - centre))[1][:, 1]
    if main @ (part[0] - centre) < 0:
        main = -main
    return centre + main * (main @ (part[0] - centre)), main


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
