"""Candidates for images of straight lines in a picture: strings, grid lines, edges of buildings and boards."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from camcal.detect.line_chains import chains, joined
from camcal.detect.line_points import RIDGE_SIGMA, LinePoints, edges, ridges
from camcal.least_squares.scales import MAD

Array = np.ndarray

#: least length of a candidate, as a fraction of the picture's diagonal: shorter ones bend too little to be measured
LEAST_LENGTH = 0.1
#: Two candidates are one line if one smooth curve fits both about as well as their own curves do (within this factor,
#: and px), and the gap between them is at most this fraction of the shorter one.
AS_CLOSE, CLOSE, LARGEST_GAP = 1.3, 0.02, 0.6
#: cosine of the largest angle between two parts of a line bent by distortion: 30 degrees
BENT = 0.86
#: px; an edge beside a thin line is that line's own border: four widths of the ridge filter
BORDER = 4 * RIDGE_SIGMA
#: order of the polynomial that fits the points along a line with any lens
SMOOTH = 5
#: px; largest scatter of a line's points about that polynomial: with more it is not a single edge
ROUGHEST = 1.0
#: px; points of a line are averaged over runs of this length, which removes most of their noise and moves them by
#: 0.003 px where a line is bent to a radius of 1000 px (Tang et al., High-precision camera distortion measurements
#: with a calibration harp, 2012, smooth and thin their edge points likewise)
RUN = 8.0
#: least number of points of a run: half of those that an edge has there
LEAST_IN_RUN = 4
#: robust standard deviations beyond which a point is not on the line
FAR = 4.0
ROUNDS = 3  #: of fitting a line and removing points far from it; 1 to 3 find the same lines of a building
ROUNDING = 1e-6  #: px; rounding error of exact points, 1e-12 of 1e4 px and of a polynomial's powers
#: share of both lines' lengths, and of their points, that a joint line keeps: two lines side by side are
#: together no longer than the longer one. At .95 one more pair of a building's ten lines is joined, at .8 four
WHOLE = 0.98


def find_lines(gray: Array) -> list[Array]:
    """Points (N, 2) of each candidate, px, in order along it; the longest first.

    The candidates are thin lines, either dark or bright (whichever are more numerous), and edges that are not the
    border of one. Each is weighted by its strength: in pictures without noise a dark line has bright side lobes of a
    thousandth of its strength.
    """
    least = LEAST_LENGTH * float(np.hypot(*gray.shape[:2]))
    either = [(_lines(points, least), points.strength) for points in (ridges(gray, d) for d in (True, False))]
    thin = max(either, key=lambda found: _length(found[0]) * found[1])[0]
    other = _lines(edges(gray), least)
    if thin:
        tree = cKDTree(np.concatenate(thin))
        other = [uv for uv in other if np.median(tree.query(uv)[0]) > BORDER]
    return sorted(map(_averaged, thin + other), key=_extent, reverse=True)


def _lines(points: LinePoints, least: float) -> list[Array]:
    parts = joined(points, chains(points))
    smooth = (_smooth(points.uv[p]) for p in parts if _extent(points.uv[p]) >= least)
    return _merged([found for found in smooth if found is not None and _extent(found[0]) >= least])


def _smooth(uv: Array) -> tuple[Array, float] | None:
    """The points that follow one smooth curve, in order, and their robust deviation, px; None without such a curve."""
    centred = uv - uv.mean(0)
    main = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    along, across = (centred @ main).T
    order = np.argsort(along, kind="stable")
    uv, along, across = uv[order], along[order], across[order]
    scaled = along / np.abs(along).max()
    good, sigma = np.ones(len(uv), bool), np.inf
    for _ in range(ROUNDS):
        if good.sum() < 2 * SMOOTH:
            return None
        curve = np.polynomial.chebyshev.chebfit(scaled[good], across[good], SMOOTH)
        off = np.abs(across - np.polynomial.chebyshev.chebval(scaled, curve))
        sigma = MAD * float(np.median(off[good]))
        good = off <= max(FAR * sigma, ROUNDING)
    return (uv[good], sigma) if sigma <= ROUGHEST else None


def _merged(lines: list[tuple[Array, float]]) -> list[Array]:
    """Merge lines of which several parts were found."""
    lines = sorted(lines, key=lambda item: -_extent(item[0]))
    at = 0
    while at < len(lines):
        found = next((m for other in lines[at + 1 :] if (m := _joint(lines[at], other)) is not None), None)
        if found is None:
            at += 1
            continue
        whole, part = found
        lines[at] = whole
        lines = [item for item in lines if item is not part]
    return [uv for uv, _ in lines]


def _joint(
    first: tuple[Array, float], second: tuple[Array, float]
) -> tuple[tuple[Array, float], tuple[Array, float]] | None:
    """Join one candidate with a second; None if they are two separate lines."""
    (a, sigma_a), (b, sigma_b) = first, second
    apart = np.linalg.norm(a[[0, 0, -1, -1]] - b[[0, -1, 0, -1]], axis=1)
    if apart.min() > LARGEST_GAP * _extent(b):
        return None
    both = _smooth(np.concatenate([a, b])) if _lead_on(a, b) else None
    close = AS_CLOSE * max(sigma_a, sigma_b) + CLOSE
    # end to end: two lines side by side would be longer separately than together
    longer = both is not None and _extent(both[0]) >= WHOLE * (_extent(a) + _extent(b))
    if both is None or not longer or both[1] > close or len(both[0]) < WHOLE * (len(a) + len(b)):
        return None
    return both, second


def _lead_on(a: Array, b: Array) -> bool:
    """Return whether two chords and the line between their midpoints have roughly the same direction."""
    chords = [uv[-1] - uv[0] for uv in (a, b)] + [b.mean(0) - a.mean(0)]
    first, second, between = (c / max(np.linalg.norm(c), 1e-9) for c in chords)
    return bool(abs(first @ second) > BENT and abs(first @ between) > BENT)


def _averaged(uv: Array) -> Array:
    """The mean points of runs along a line, whose points are in order."""
    run = np.floor(np.linalg.norm(uv - uv[0], axis=1) / RUN).astype(int)
    counts = np.bincount(run)
    sums = np.stack([np.bincount(run, uv[:, k]) for k in (0, 1)], 1)
    full = counts >= LEAST_IN_RUN
    return sums[full] / counts[full, None]


def _extent(uv: Array) -> float:
    return float(np.linalg.norm(uv[-1] - uv[0]))


def _length(lines: list[Array]) -> float:
    return sum(map(_extent, lines))
