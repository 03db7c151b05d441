"""DLT coefficient files of motion laboratories: one column per camera, L1 to L11 down.

u = (L1 X + L2 Y + L3 Z + L4) / (L9 X + L10 Y + L11 Z + 1), v with L5 to L8 (Abdel-Aziz & Karara 1971): a projection
matrix with m34 = 1, by rows. DLTdv, Argus, easyWand, StereoMorph and Kinovea exchange these files. Their pixels
are those of the program that digitised the points, so that coefficients and points belong together as they are.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from camcal.data.layout import find_separator, is_number
from camcal.errors import DataError
from camcal.system.documents import LARGEST
from camcal.system.reading import read_text

Array = np.ndarray

ROWS = 11  #: coefficients of the direct linear transformation with m34 = 1
#: |m34| against the largest entry, below which it counts as 0: dividing would leave fewer than 7 digits
NO_DEPTH = 1e-9
#: of a determinant, for rows of length 1: a thousand times that of the arithmetic; 1e-6 with f = 1 px and c = 1000 px
ROUNDING = 1e-13


def looks_like_dlt(text: str) -> bool:
    """Return whether a text is eleven rows with the same number of numbers."""
    rows = _rows(text)
    return (
        len(rows) == ROWS
        and len({len(r) for r in rows}) == 1
        and all(is_number(f, ",") for r in rows for f in r)
    )


def read_dlt(path: str | os.PathLike) -> Array:
    """The projection matrices (C, 3, 4) of a file, m34 = 1.

    Raises
    ------
    DataError
        If the file is missing or holds anything but eleven rows of numbers.
    """
    source = Path(path)
    return matrices(read_text(source, LARGEST, "a table of DLT coefficients"), source)


def matrices(text: str, source: Path) -> Array:
    """The projection matrices (C, 3, 4) of the text of a file; see `read_dlt`."""
    if not looks_like_dlt(text):
        raise DataError(
            f"'{source}' is not a file of DLT coefficients, which has {ROWS} rows of numbers and one "
            f"column for each camera: "
            f"{_flaw(_rows(text))}.",
            "Give the file that the digitising program saved as DLT coefficients.",
        )
    coefficients = np.array(_rows(text), float).T
    if not np.isfinite(coefficients).all():
        raise DataError(
            f"'{source}' holds a coefficient that is not finite.", "Export the coefficients again."
        )
    found = np.c_[coefficients, np.ones(len(coefficients))].reshape(-1, 3, 4)
    for column, matrix in enumerate(found, 1):
        if _singular(matrix):
            raise DataError(
                f"'{source}', column {column}: the coefficients do not describe a camera: the matrix "
                f"with the rows L1 to L3, L5 to L7 and L9 to L11 is singular.",
                "Export the coefficients again.",
            )
    return found


def _singular(matrix: Array) -> bool:
    """Return whether a projection matrix (3, 4) has no centre of projection, up to rounding."""
    rows = matrix[:, :3]
    return bool(abs(np.linalg.det(rows)) <= ROUNDING * np.linalg.norm(rows, axis=1).prod())


def _flaw(rows: list[list[str]]) -> str:
    """The first difference of a table from eleven rows of numbers."""
    if len(rows) == ROWS + 1 and not any(is_number(f, ",") for f in rows[0]):
        return (
            f"its first row is a header ({', '.join(rows[0][:4])}); remove it, as cameras are numbered from 1"
        )
    if len(rows) != ROWS:
        return f"it holds {len(rows)} rows"
    for line, row in enumerate(rows, 1):
        wrong = [f for f in row if not is_number(f, ",")]
        if wrong:
            return f"row {line} holds '{wrong[0][:20]}'"
        if len(row) != len(rows[0]):
            return f"row {line} holds {len(row)} numbers, the first {len(rows[0])}"
    raise AssertionError("a file of DLT coefficients")


def dlt_text(matrices: Sequence[Array]) -> str:
    """The text of projection matrices (3, 4); every coefficient reads back exactly if m34 is 1.

    Raises
    ------
    DataError
        If m34 is 0 beside the other entries: the world's origin lies in the plane of that camera's centre.
    """
    columns = []
    for index, m in enumerate(matrices):
        m34 = m[2, 3]
        if abs(m34) <= NO_DEPTH * np.abs(m[2]).max():
            raise DataError(
                f"camera {index + 1}: the world origin lies in the plane through the camera's centre "
                f"parallel to the image, so m34 = 0; the eleven coefficients need m34 = 1.",
                "Move the world origin.",
            )
        columns.append((m if m34 == 1 else m / m34).reshape(-1)[:ROWS])
    return "".join(",".join(repr(float(x)) for x in row) + "\n" for row in np.array(columns).T)


def _rows(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.strip()]
    return [[f.strip() for f in line.split(find_separator(line))] for line in lines]
