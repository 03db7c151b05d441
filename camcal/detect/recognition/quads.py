"""Quadrilaterals that look like markers, and the markers of a dictionary among them.

OpenCV finds the outlines. The cells are read here because calling OpenCV's detector for every dictionary would
search for the same outlines each time.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from camcal.detect.marked_grid import PER_CELL
from camcal.detect.targets.dictionaries import detector, dictionary
from camcal.geometry.homography import within_quads

Array = np.ndarray

RIM = 10  #: samples along each side of the rim; no marker has more cells
DARK_RIM = 0.15  #: share of the samples of the rim that may be bright
LEAST_INSIDE, MOST_INSIDE = 0.1, 0.9  #: share of the samples inside that are bright in a marker
LEAST_CONTRAST = 30.0  #: grey levels of 255 within a quadrilateral
BAD_BORDER = 0.2  #: share of the cells of the border that may be read as bright
CORRECTED = 0.6  #: of the bits that a dictionary can correct; OpenCV's default


def marker_like(gray: Array) -> Array:
    """Dark quadrilaterals (K, 4, 2), px, clockwise, with a dark rim and something bright inside."""
    found, _, others = detector("4X4_50", 1, max(gray.shape)).detectMarkers(gray)
    quads = np.asarray([*found, *others], np.float32).reshape(-1, 4, 2)
    cells = sampled(gray, quads, (np.arange(RIM) + 0.5) / RIM)
    low, high = cells.min((1, 2)), cells.max((1, 2))
    bright = cells > (0.5 * (low + high))[:, None, None]
    rim = np.concatenate([bright[:, 0], bright[:, -1], bright[:, :, 0], bright[:, :, -1]], 1).mean(1)
    inner = bright[:, 2:-2, 2:-2].mean((1, 2))
    good = (high - low > LEAST_CONTRAST) & (rim < DARK_RIM) & (inner > LEAST_INSIDE) & (inner < MOST_INSIDE)
    return quads[good].astype(float)


def sampled(gray: Array, quads: Array, at: Array) -> Array:
    """Grey values (K, n, n) in quadrilaterals, at fractions `at` (n,) of the sides of the square that maps to each."""
    if not len(quads):
        return np.zeros((0, len(at), len(at)))
    u, v = (a.reshape(len(quads), -1).astype(np.float32) for a in within_quads(quads.astype(float), at))
    value = cv2.remap(gray, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return value.reshape(len(quads), len(at), len(at)).astype(float)


def decode(gray: Array, quads: Array, name: str, border: int) -> tuple[Array, Array]:
    """The markers of a dictionary among quadrilaterals.

    Parameters
    ----------
    gray : (height, width) uint8 array
    quads : (K, 4, 2) array
        px, clockwise.
    name : str
        Of the dictionary.
    border : int
        Width of the black border in cells.

    Returns
    -------
    ids : (N,) int array
    corners : (N, 4, 2) array
        Clockwise from the marker's own upper left.
    """
    codes, side, correctable = _codes(name)
    n = side + 2 * border
    inner = 0.25 + 0.5 * (np.arange(PER_CELL) + 0.5) / PER_CELL
    at = ((np.arange(n)[:, None] + inner) / n).ravel()
    cells = sampled(gray, quads, at).reshape(-1, n, PER_CELL, n, PER_CELL).mean((2, 4))
    bright = cells > 0.5 * (cells.min((1, 2)) + cells.max((1, 2)))[:, None, None]
    bits = bright[:, border:-border, border:-border]
    rim = (bright.sum((1, 2)) - bits.sum((1, 2))) / (n * n - side * side)
    # (K, 4, M): bits that differ from each marker in each of its four orientations
    flat = np.stack([np.rot90(bits, quarter, (1, 2)).reshape(-1, side * side) for quarter in range(4)], 1)
    same = flat.astype(np.float32) @ codes.T + (1 - flat.astype(np.float32)) @ (1 - codes).T
    wrong = side * side - same
    best = wrong.reshape(len(quads), -1).argmin(1) if len(quads) else np.zeros(0, int)
    quarter, marker = np.divmod(best, len(codes))
    least = wrong.reshape(len(quads), -1).min(1) if len(quads) else np.zeros(0)
    rows = np.flatnonzero((rim < BAD_BORDER) & (least <= int(CORRECTED * correctable)))
    # a quarter turn counter-clockwise moves the upper right corner to the upper left
    order = (np.arange(4) + quarter[rows, None]) % 4
    corners = np.take_along_axis(quads[rows], order[..., None], 1)
    return marker[rows], corners


@cache
def _codes(name: str) -> tuple[Array, int, int]:
    """The markers' bits (M, n n) as float32, n, and the number of wrong bits that can be corrected."""
    made = dictionary(name)
    side = int(made.markerSize)
    rows = [cv2.aruco.Dictionary.getBitsFromByteList(row[None], side).ravel() for row in made.bytesList]
    return np.array(rows, np.float32), side, int(made.maxCorrectionBits)
