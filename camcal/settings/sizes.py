"""Kinds of values that measure something: image sizes, boards, lengths, pixels, angles."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from camcal.errors import UsageError
from camcal.settings.kinds import Kind, Real, parts_of, real, refuse
from camcal.system.text import quoted

UNITS = ("um", "mm", "cm", "m", "in")
#: board sizes in cells: two rows are the least that make a plane; a side of 1000 does not fit in a picture
LEAST_CELLS, MOST_CELLS = 2, 1000
#: lengths in their own unit: a square of a nanometre in km, and the reverse, with a margin of a million
LEAST_LENGTH, MOST_LENGTH = 1e-18, 1e18
#: a positive distance in the unit of the data, or inf
DISTANCE = Real(0, above=True, infinite=True, metavar="D|inf")


class Length(NamedTuple):
    """A length and its unit; `unit` is "unit" if none was given."""

    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:g}" + ("" if self.unit == "unit" else self.unit)


def parse_grid(text: str) -> tuple[int, int]:
    """Read `9x6` as (columns, rows).

    Raises
    ------
    UsageError
        If it is not two whole numbers of at least 2.
    """
    match = re.fullmatch(r"(\d{1,9})[xX](\d{1,9})", text.strip())
    if not match:
        raise UsageError(f"{quoted(text)} is not the size of a board.", "Write COLUMNSxROWS, as in 9x6.")
    columns, rows = int(match[1]), int(match[2])
    if min(columns, rows) < LEAST_CELLS or max(columns, rows) > MOST_CELLS:
        raise UsageError(
            f"a board of {columns}x{rows} cannot be used.", f"Each side needs {LEAST_CELLS} to {MOST_CELLS}."
        )
    return columns, rows


def parse_length(text: str) -> Length:
    """Read `25mm` as (25.0, "mm"); a bare number has the unit "unit".

    Raises
    ------
    UsageError
        If it is not a positive number with a known unit or none.
    """
    match = re.fullmatch(r"([0-9.]+(?:[eE][-+]?\d+)?)\s*([a-zA-Z]*)", text.strip())
    value = (real(match[1]) if match else None) or 0.0
    unit = match[2] if match else ""
    if not LEAST_LENGTH <= value <= MOST_LENGTH or (unit and unit not in UNITS):
        raise UsageError(
            f"{quoted(text)} is not a length.",
            f"Write a positive number below {MOST_LENGTH:g} and {', '.join(UNITS)} or no unit.",
        )
    return Length(value, unit or "unit")


def _with_x(value: Any) -> str:
    """Write `[640, 480]` as `640x480`."""
    return value if isinstance(value, str) or not hasattr(value, "__len__") else "x".join(map(str, value))


class ImageSize(Kind):
    """The size of a picture: `640x480`, or [640, 480]."""

    metavar = "WxH"

    def convert(self, value: Any) -> tuple[int, int]:
        """Return (width, height), px."""
        found = re.fullmatch(r"\s*(\d{1,7})\s*[xX]\s*(\d{1,7})\s*", str(_with_x(value)))
        if not found:
            raise UsageError(
                f"{quoted(value)} is not an image size; width x height in pixels is needed.", "Try: 640x480"
            )
        width, height = int(found[1]), int(found[2])
        if min(width, height) < 1:
            raise UsageError(f"a picture of {width}x{height} has no pixels.", "Try: 640x480")
        return width, height


class BoardSize(Kind):
    """The size of a board in inner corners: `9x6`, or [9, 6]."""

    metavar = "CxR"

    def convert(self, value: Any) -> tuple[int, int]:
        """Return (columns, rows)."""
        return parse_grid(str(_with_x(value)))


class LengthKind(Kind):
    """A positive length with its unit: `25mm`, `0.025m`, or a bare number."""

    metavar = "LENGTH"

    def convert(self, value: Any) -> Length:
        """Return the length as (value, unit)."""
        if isinstance(value, (tuple, list)) and len(value) == 2:
            value = str(value[0]) + ("" if value[1] == "unit" else str(value[1]))
        return parse_length(str(value))


class Pixel(Kind):
    """A point in a picture: `100,200`, or [100, 200]."""

    metavar = "U,V"

    def convert(self, value: Any) -> tuple[float, float]:
        """Return (u, v)."""
        numbers = numbers_of(value, 2)
        if numbers is None:
            raise UsageError(
                f"{quoted(value)} is not a pixel; its two coordinates are needed.", "Try: 100,200"
            )
        return numbers[0], numbers[1]


class Numbers(Kind):
    """A fixed count of numbers separated by commas, or a list."""

    def __init__(self, count: int, example: str, metavar: str = "NUMBERS"):
        self.count, self.example, self.metavar = count, example, metavar

    def convert(self, value: Any) -> tuple[float, ...]:
        """Return the numbers."""
        numbers = numbers_of(value, self.count)
        if numbers is None:
            raise UsageError(
                f"{quoted(value)} is not {self.count} numbers with commas.", f"Try: {self.example}"
            )
        return numbers


def numbers_of(value: Any, count: int) -> tuple[float, ...] | None:
    """Return `count` finite numbers, or None if the value is anything else."""
    try:
        numbers = [real(part) for part in parts_of(value)]
    except TypeError:
        return None
    found = tuple(n for n in numbers if n is not None and math.isfinite(n))
    return found if len(found) == len(numbers) == count else None


class Radians(float):
    """An angle that has already been converted."""


class KeptField(Kind):
    """The field of view that an undistorted picture keeps: `all`, `no-black`, or an angle such as `90deg`."""

    metavar = "all|no-black|ANGLE"

    def convert(self, value: Any) -> str | float:
        """Return the word, or the angle in rad."""
        if isinstance(value, Radians) or (isinstance(value, str) and value in ("all", "no-black")):
            return value
        found = re.fullmatch(r"\s*([0-9.]+)\s*(deg)?\s*", str(value))
        degrees = real(found[1]) if found else None
        if degrees is None or not 0 < degrees < 360:  # a field of view is part of a full turn
            raise refuse(value, "all, no-black or an angle", "Try: 90deg")
        return Radians(math.radians(degrees))
