"""Dark discs in a picture, and the square lattice that some of them form.

A disc seen from the side is an ellipse, which states how the plane is foreshortened there: measured with
the ellipse as its unit circle, the four neighbours of a disc are equally far and at right angles however
the board is tilted. The lattice then grows from disc to disc, each step predicted from the one before.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

Array = np.ndarray

LEAST_AREA = 20.0  #: px of the reduced picture
MOST_SLENDER = 6.0  #: ratio of the axes: a tilt of 80 degrees
AREA_TOLERANCE = 0.13  #: how far the area of an outline may be from that of its ellipse
ROUND = 0.045  #: how far an outline may swing around its ellipse, of the radius
MOST_DISCS = 3000
EVEN = 0.25  #: how far the four neighbours of a seed may be from equal distances and right angles
CONCENTRIC = 0.3  #: of the smaller radius; two outlines with centres as close as that are one disc
STRAY = 0.4  #: how far a disc may be from where its neighbour expects it, of a step
LIKE = 0.6  #: logarithm of the ratio of sizes of neighbours
UNEVEN = 0.2  #: how far a step may be from the usual length, in the measure of the discs at its ends
SEEDS = 12


@dataclass(frozen=True)
class Discs:
    """Ellipses in a picture.

    Attributes
    ----------
    centre : (N, 2) array
        px.
    shape : (N, 2, 2) array
        Symmetric matrices S; the outline is centre + S (cos, sin).
    """

    centre: Array
    shape: Array

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, rows: Array) -> Discs:
        """Only some of them."""
        return Discs(self.centre[rows], self.shape[rows])


def find_discs(gray: Array) -> Discs:
    """Dark ellipses of a grey uint8 picture, by outlines under adaptive thresholds of three sizes."""
    side = max(gray.shape)
    smooth = cv2.GaussianBlur(gray, (0, 0), 0.8)
    found: list[tuple[Array, Array]] = []
    for window in (side // 24, side // 8, side // 3):
        size = 2 * (max(window, 10) // 2) + 1
        dark = cv2.adaptiveThreshold(smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, size, 8)
        outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        found += [e for e in map(ellipse_of, outlines) if e is not None]
    if not found:
        return Discs(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    discs = Discs(np.array([c for c, _ in found]), np.array([s for _, s in found]))
    return _distinct(discs.take(_dark_inside(smooth, discs)))


def ellipse_of(outline: Array) -> tuple[Array, Array] | None:
    """Centre and shape of a closed outline if it is an ellipse, by its moments."""
    if len(outline) < 12:
        return None
    m = cv2.moments(outline)
    area = m["m00"]
    if area < LEAST_AREA:
        return None
    # the outline runs through pixel centres; the disc reaches half a pixel farther
    second = np.array([[m["mu20"], m["mu11"]], [m["mu11"], m["mu02"]]]) / area
    values, vectors = np.linalg.eigh(second)
    if values[0] <= 0 or values[1] > MOST_SLENDER**2 * values[0]:
        return None
    axes = 2 * np.sqrt(values)
    if abs(np.pi * axes[0] * axes[1] / area - 1) > AREA_TOLERANCE:
        return None
    centre = np.array([m["m10"], m["m01"]]) / area
    offset = outline[:, 0] - centre
    radius = np.linalg.norm(offset @ vectors / axes, axis=1)
    # the outline of a square swings by 0.1 of its mean radius; that of a disc by the steps of the pixels only
    if np.sqrt(np.mean((radius - 1) ** 2)) > ROUND + 0.3 / axes[0]:
        return None
    return centre, (vectors * (axes + 0.5)) @ vectors.T


def _dark_inside(gray: Array, discs: Discs) -> Array:
    """Mask of those that are darker in the middle than all around."""
    if not len(discs):
        return np.zeros(0, bool)
    angle = np.arange(8) * np.pi / 4
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    around = discs.centre[:, None] + np.einsum("nij,kj->nki", discs.shape, 1.35 * ring)
    at = np.concatenate([discs.centre[:, None], around], 1).astype(np.float32)
    value = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(
        float
    )
    return np.sort(value[:, 1:], 1)[:, 1] > value[:, 0] + 8  # one of the eight may fall on something else


def _distinct(discs: Discs) -> Discs:
    """Each disc once: of several outlines around one centre the largest, which is that of the disc."""
    size = np.sqrt(np.abs(np.linalg.det(discs.shape)))
    order = np.argsort(-size)[:MOST_DISCS]
    discs, size = discs.take(order), size[order]
    if not len(discs):
        return discs
    gone = np.zeros(len(discs), bool)
    tree = cKDTree(discs.centre)
    for i, close in enumerate(tree.query_ball_point(discs.centre, CONCENTRIC * size)):
        if not gone[i]:
            inner = np.array([j for j in close if j > i], int)
            apart = np.linalg.norm(discs.centre[inner] - discs.centre[i], axis=1)
            gone[inner[apart < CONCENTRIC * size[inner]]] = True
    return discs.take(~gone)


def lattices(discs: Discs) -> list[dict[tuple[int, int], int]]:
    """Square lattices among the discs, {(i, j): disc}, the largest first; i to j turns clockwise."""
    if len(discs) < 6:
        return []
    tree, used, made = cKDTree(discs.centre), np.zeros(len(discs), bool), []
    seeds = _seeds(discs, tree)
    for seed, first, second in seeds:
        if used[seed]:
            continue
        piece = _grow(discs, tree, seed, first, second)
        if len(piece) >= 6:
            used[list(piece.values())] = True
            made.append(piece)
        if len(made) >= SEEDS:
            break
    return sorted(made, key=len, reverse=True)


def _seeds(discs: Discs, tree: cKDTree) -> list[tuple[int, Array, Array]]:
    """Discs with four neighbours in a cross, the most regular first, with the two steps of the cross."""
    count = min(13, len(discs))
    near = np.asarray(tree.query(discs.centre, k=count)[1])[:, 1:]
    step = discs.centre[near] - discs.centre[:, None]
    flat = np.einsum("nij,nkj->nki", np.linalg.inv(discs.shape), step)  # foreshortening undone
    length = np.linalg.norm(flat, axis=2)
    like = np.abs(np.log(_sizes(discs)[near] / _sizes(discs)[:, None])) < LIKE
    length = np.where(like, length, np.inf)
    four = np.argsort(length, axis=1)[:, :4]
    rows = np.arange(len(discs))[:, None]
    length, flat, step = length[rows, four], flat[rows, four], step[rows, four]
    made = []
    for i in np.flatnonzero(np.isfinite(length).all(1)):
        turn = np.argsort(np.arctan2(flat[i, :, 1], flat[i, :, 0]))
        v = flat[i, turn] / length[i].mean()
        # a cross: opposite steps cancel, and each is the one before turned by a right angle
        error = max(np.abs(v[:2] + v[2:]).max(), np.abs(np.stack([-v[0, 1], v[0, 0]]) - v[1]).max())
        if error < EVEN * 2:
            made.append((error, int(i), *((step[i, turn[:2]] - step[i, turn[2:]]) / 2)))
    return [(i, a, b) for _, i, a, b in sorted(made, key=lambda m: m[0])]


def _sizes(discs: Discs) -> Array:
    return np.sqrt(np.abs(np.linalg.det(discs.shape)))


def _grow(discs: Discs, tree: cKDTree, seed: int, first: Array, second: Array) -> dict[tuple[int, int], int]:
    """Number the discs that can be reached from a seed by predicted steps.

    In the measure of the discs at its two ends a step is as long everywhere on the board.
    """
    inverse, sizes = np.linalg.inv(discs.shape), _sizes(discs)
    length = 0.5 * sum(float(np.linalg.norm(inverse[seed] @ step)) for step in (first, second))
    place = {(0, 0): seed}
    steps = {(0, 0): (first, second)}
    taken, queue = {seed}, deque([(0, 0)])
    while queue:
        here = queue.popleft()
        disc, (a, b) = place[here], steps[here]
        a, b = (v * (length / np.linalg.norm(inverse[disc] @ v)) for v in (a, b))
        for di, dj, step in ((1, 0, a), (-1, 0, -a), (0, 1, b), (0, -1, -b)):
            there = (here[0] + di, here[1] + dj)
            if there in place:
                continue
            miss, found = tree.query(discs.centre[disc] + step)
            moved = discs.centre[found] - discs.centre[disc]
            if (
                found in taken
                or miss > STRAY * np.linalg.norm(step)
                or abs(np.log(sizes[found] / sizes[disc])) > LIKE
            ):
                continue
            both = np.sqrt(np.linalg.norm(inverse[disc] @ moved) * np.linalg.norm(inverse[found] @ moved))
            if abs(both / length - 1) > UNEVEN:
                continue
            steps[there] = (moved * di, b) if di else (a, moved * dj)
            place[there] = int(found)
            taken.add(int(found))
            queue.append(there)
    return place
