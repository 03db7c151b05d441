"""Dictionaries of square markers: their names, their bits as black rectangles, and a detector for each."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import cv2
import numpy as np

from camcal.errors import UsageError
from camcal.registry import suggestion

Array = np.ndarray

#: least perimeter of a marker, relative to the longer side of the picture (15 px per side in 4,000): half of cv2's
#: default; above 2,400 px it excludes more outlines than `LEAST_PERIMETER`
LEAST_RATE = 0.015
LEAST_PERIMETER = 36.0  #: px of a marker: six cells of 1.5 px on each side


@cache
def names() -> tuple[str, ...]:
    """The predefined dictionaries of cv2, such as `4X4_100` or `APRILTAG_36h11`, each family once."""
    found = {name[5:].lower(): name[5:] for name in sorted(dir(cv2.aruco)) if name.startswith("DICT_")}
    return tuple(sorted(found.values()))  # of 36H11 and 36h11, the latter sorts last and is kept


def find_name(text: str) -> str:
    """The name of a dictionary from its usual spellings: `DICT_4X4_100`, `4x4_100`, `t36h11`, `tag36h11`.

    Raises
    ------
    UsageError
        If there is no such dictionary.
    """
    plain = re.sub(r"^dict_", "", text.strip().lower())
    plain = re.sub(r"^(?:apriltag_?|tag_?|t)?(16h5|25h9|36h10|36h11)$", r"apriltag_\1", plain)
    known = {name.lower(): name for name in names()}
    if plain not in known:
        raise UsageError(
            f"unknown marker dictionary '{text}'.",
            suggestion(plain.upper(), names()) or "Known: " + ", ".join(names()) + ".",
        )
    return known[plain]


@cache
def dictionary(name: str) -> Any:
    """The cv2 dictionary for a name from `names()`."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def marker_count(name: str) -> int:
    """The number of markers in a dictionary."""
    return len(dictionary(name).bytesList)


def black_cells(name: str, marker: int, border: int = 1) -> Array:
    """The cells of a marker, True where black: (n, n) with n = bits + 2 border, rows from the top."""
    made = dictionary(name)
    side = made.markerSize + 2 * border
    return cv2.aruco.generateImageMarker(made, marker, side, borderBits=border) == 0


def rectangles(black: Array, corner: Array, size: float) -> list[Array]:
    """A small set of rectangles (4, 2) that cover the black cells of a square without overlap.

    Parameters
    ----------
    black : (n, n) bool array
    corner : (2,) array
        The upper left corner of the square.
    size : float
        Its side.
    """
    n = len(black)
    left, made = black.copy(), []
    for row, column in np.argwhere(black):
        if not left[row, column]:
            continue
        right = column + int(np.argmin(np.r_[left[row, column:], False]))
        below = row + int(np.argmin(np.r_[left[row:, column:right].all(1), False]))
        left[row:below, column:right] = False
        x, y = corner[0] + np.array([column, right]) * size / n, corner[1] + np.array([row, below]) * size / n
        made.append(rectangle(x[0], y[0], x[1], y[1]))
    return made


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Array:
    """The corners (4, 2) of a rectangle, clockwise from the upper left (y downward)."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


@cache
def detector(name: str, border: int, longest: int) -> Any:
    """A detector for the markers of a dictionary, for pictures of a given size (the longer side, px).

    The windows of the adaptive threshold are larger than cv2's default, so that large markers have closed outlines
    even under strong shading. Outlines too short to be read are ignored: a picture of noise has so many of them
    that cv2 takes minutes.
    """
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = border
    options.adaptiveThreshWinSizeMin, options.adaptiveThreshWinSizeMax = 5, 45
    options.adaptiveThreshWinSizeStep = 20
    options.minMarkerPerimeterRate = max(LEAST_RATE, LEAST_PERIMETER / longest)
    return cv2.aruco.ArucoDetector(dictionary(name), options)


def detect(gray: Array, name: str, border: int = 1) -> tuple[Array, Array]:
    """The markers in a picture: ids (K,) and corners (K, 4, 2), clockwise from the marker's upper left."""
    corners, ids, _ = detector(name, border, max(gray.shape)).detectMarkers(gray)
    if ids is None or not len(corners):
        return np.zeros(0, int), np.zeros((0, 4, 2))
    return np.asarray(ids, int).ravel(), np.asarray(corners, float).reshape(-1, 4, 2)
