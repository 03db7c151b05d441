"""Markers of an unknown dictionary: their family, ids and corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.detect.pyramid import reduced, reductions, to_8_bits
from camcal.detect.recognition.quads import decode, marker_like
from camcal.detect.targets.dictionaries import marker_count, names
from camcal.records import dataclass

Array = np.ndarray

#: name of a dictionary and width of the black border in cells
Family = tuple[str, int]

#: The largest dictionary of each family begins with the smaller ones. Tags have a border of one cell or, as
#: Kalibr prints them, of two. The most common first.
FAMILIES: tuple[Family, ...] = (
    ("4X4_1000", 1),
    ("5X5_1000", 1),
    ("6X6_1000", 1),
    ("APRILTAG_36h11", 2),
    ("APRILTAG_36h11", 1),
    ("7X7_1000", 1),
    ("APRILTAG_25h9", 2),
    ("APRILTAG_25h9", 1),
    ("APRILTAG_16h5", 2),
    ("APRILTAG_16h5", 1),
    ("APRILTAG_36h10", 1),
    ("ARUCO_MIP_36h12", 1),
    ("ARUCO_ORIGINAL", 1),
)
LEAST_MARKERS = 4  #: fewer are occasionally read in clutter, and do not determine a layout


@dataclass(frozen=True)
class Marker:
    """A marker in a picture: its id and its corners (4, 2), px, clockwise from its own upper left."""

    id: int
    corners: Array


def read_markers(
    gray: Array, first: Family | None = None, closely: bool = False
) -> tuple[Family | None, list[Marker]]:
    """Read the markers of a picture, of the family with most readable markers.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    first : (dictionary, border), optional
        The family that is tried before the others.
    closely : bool
        Search at full size, and enlarge a small picture, even if the reduced picture shows nothing like
        a marker.

    Returns
    -------
    family : (dictionary, border) or None
        None if fewer than `LEAST_MARKERS` were read of every family.
    markers : list of Marker
        In px of the picture.
    """
    picture = to_8_bits(gray)
    factors = reductions(picture.shape, enlarge=True)
    best: tuple[Family | None, list[Marker]] = (None, [])
    for factor in factors if closely else factors[:1]:
        small = reduced(picture, factor)
        quads = marker_like(small)
        if len(quads) < LEAST_MARKERS:
            continue
        for family in sorted(FAMILIES, key=lambda f: f != first):
            ids, corners = decode(small, quads, *family)
            if len(ids) > len(best[1]):
                corners = (corners + 0.5) * factor - 0.5
                best = family, [Marker(int(i), c) for i, c in zip(ids, corners, strict=True)]
    return best if len(best[1]) >= LEAST_MARKERS else (None, [])


def read_others(
    gray: Array, family: Family | None, markers: Sequence[Marker]
) -> tuple[tuple[Family, tuple[Marker, ...]], ...]:
    """Markers of further families, if a picture shows boards of several.

    Parameters
    ----------
    gray : (height, width) uint8 or uint16 array
    family, markers
        Result of `read_markers`: what these markers cover is not read again.

    Returns
    -------
    tuple of (family, markers)
        Each of at least `LEAST_MARKERS`, in px of the picture, the family with most markers first.
    """
    picture = to_8_bits(gray)
    factor = reductions(picture.shape, enlarge=True)[0]
    small = reduced(picture, factor)
    quads = marker_like(small)
    found = []
    taken = np.array([m.corners for m in markers]).reshape(-1, 4, 2)
    for _ in FAMILIES:
        quads = quads[~_covered((quads + 0.5) * factor - 0.5, taken)]
        if len(quads) < LEAST_MARKERS:
            break
        best: tuple[Family, list[Marker]] = (FAMILIES[0], [])
        for other in FAMILIES:
            ids, corners = decode(small, quads, *other)
            if other != family and len(ids) > len(best[1]):
                corners = (corners + 0.5) * factor - 0.5
                best = other, [Marker(int(i), c) for i, c in zip(ids, corners, strict=True)]
        if len(best[1]) < LEAST_MARKERS:
            break
        found.append((best[0], tuple(best[1])))
        taken = np.array([m.corners for m in best[1]])
    return tuple(found)


def _covered(quads: Array, markers: Array) -> Array:
    """The quadrilaterals (K, 4, 2) whose centres lie within half the width of a marker (M, 4, 2) from its centre."""
    if not len(markers) or not len(quads):
        return np.zeros(len(quads), bool)
    middle = markers.mean(1)
    radius = np.linalg.norm(markers - middle[:, None], axis=2).min(1)
    apart = np.linalg.norm(quads.mean(1)[:, None] - middle, axis=2)
    return np.asarray((apart < radius).any(1))


def stem(name: str) -> str:
    """The common name of the dictionaries of a family: `4X4` of `4X4_100`, otherwise the name itself."""
    return name.rpartition("_")[0] if name[0].isdigit() else name


def smallest(name: str, needed: int) -> str:
    """The smallest dictionary of a family with at least `needed` markers; the first markers are the same in all."""
    kin = [n for n in names() if name[0].isdigit() and stem(n) == stem(name) and marker_count(n) >= needed]
    return min(kin, key=marker_count) if kin else name


def family_of(dictionary: str, border: int) -> Family:
    """The entry of `FAMILIES` that contains the markers of a dictionary."""
    return next(
        (f for f in FAMILIES if stem(f[0]) == stem(dictionary) and f[1] == border), (dictionary, border)
    )
