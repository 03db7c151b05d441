"""The interface of calibration targets: points on a plane, a detector, and a pattern to print.

A new target is one file with a subclass of `Target` and one line in the table of `targets/__init__.py`:

1. `kind` names it, and `point_kind` states which sub-pixel fit applies to its points;
2. `points` lists every point of the target in the order of its ids;
3. `find` searches for it in one grey picture and returns a `Detection` or a `Miss`; it never raises on a picture;
4. `pattern` returns the black shapes from which the target is rendered and printed;
5. `parse` reads the arguments of a spec such as `checkerboard:9x6:25mm`.
"""

from __future__ import annotations

import copy
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.records import dataclass
from camcal.settings.detection import DEFAULT_SECONDS
from camcal.settings.kinds import real
from camcal.settings.sizes import UNITS

Array = np.ndarray

#: processor time of this thread, so that a busy machine finds the same boards as an idle one
clock = time.thread_time
#: reasons of a `Miss` for a picture in which nothing resembles the target
NOTHING = frozenset({"none", "too-dark", "too-bright", "too-blurred"})
#: points or squares; a smaller grid may be chance, and is accepted only if its size was requested
LEAST_UNASKED = 12
LEAST_POINTS = 4  #: of a detection: their eight coordinates determine the homography of a plane
#: share of a board's corners, discs or squares that must be seen, as they cannot be identified one by one: where more
#: than a fifth is hidden, the size of the board is uncertain
LEAST_SEEN = 0.8
#: largest ratio of the times for pictures with sides in the ratio of 2: four times the pixels, and a quarter more
LARGER = 5.0
MOST_GAP = 5.0  #: largest gap, in sides of a tag or square; beyond it, most of the board is empty
#: gaps, in sides, for which a target that was not named is searched: the blur of an edge closes smaller ones, which
#: are 1 px between squares of 20 px
GAPS = (0.05, MOST_GAP)


@dataclass(frozen=True)
class Detection:
    """The points of a target found in one picture.

    Attributes
    ----------
    point_ids : (N,) int array
        Rows of `Target.points`, ascending.
    uv : (N, 2) array
        Their images, px; (0, 0) is the centre of the top-left pixel.
    sigma : (N,) array or None
        Standard deviation of each point in each coordinate, px.
    info : mapping
        Further results of the search: `rejected` ({id: reason}), `blur`, `square_px`, ...
        Plain values and arrays only, so that it can be passed between processes and cached.
    """

    point_ids: Array
    uv: Array
    sigma: Array | None = None
    info: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.point_ids)


@dataclass(frozen=True)
class Miss:
    """The reason why a picture gave no target.

    Attributes
    ----------
    reason : str
        One of `none`, `time`, `too-dark`, `too-bright`, `too-blurred`, `too-small`, `other-size`, `cut-off`.
    message : str
        The reason in words, for the report.
    info : mapping
        Further results of the search: `size` (columns, rows) for `other-size`.
    """

    reason: str
    message: str
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Pattern:
    """The printed pattern: black shapes on white, in the target's unit, x to the right and y downward.

    Attributes
    ----------
    polygons : tuple of (K, 2) arrays
        Black polygons that do not overlap.
    circles : (C, 3) array
        Black discs: x, y, radius.
    extent : (x0, y0, x1, y1)
        Bounds of the white sheet that the target needs, including its quiet margin.
    """

    polygons: tuple[Array, ...]
    circles: Array
    extent: tuple[float, float, float, float]


class Target(ABC):
    """A planar calibration target; z = 0, x along the columns, y along the rows, seen from the printed side.

    Attributes
    ----------
    columns, rows : int
        Size in cells of the target: inner corners of a checkerboard, squares of a ChArUco board,
        tags of an AprilTag grid, circles of a circle grid.
    square : float
        Length of a cell (side of a tag for a grid of tags, distance between neighbours for circles), in `unit`.
    unit : str
        `um`, `mm`, `cm`, `m`, `in`; `unit` for a bare number, `square` if no length is known.
    negative : bool
        Whether black and white are exchanged in print, or in the pictures; see `targets.find`.
    """

    kind: str  #: name in the table
    negative: bool = False
    point_kind: str = "saddle"  #: which sub-pixel fit applies: `saddle`, `circle`

    def __init__(self, columns: int, rows: int, square: float = 1.0, unit: str = "square"):
        self.columns, self.rows = int(columns), int(rows)
        self.square, self.unit = float(square), unit

    @property
    def points(self) -> Array:
        """All points (M, 3) in id order, z = 0, in `unit`; by default id = row * columns + column."""
        x, y = np.meshgrid(np.arange(self.columns, dtype=float), np.arange(self.rows, dtype=float))
        return np.c_[x.ravel(), y.ravel(), np.zeros(x.size)] * self.square

    @abstractmethod
    def find(self, gray: Array, seconds: float = DEFAULT_SECONDS) -> Detection | Miss:
        """Search for the target in a grey picture.

        Parameters
        ----------
        gray : (height, width) uint8 or uint16 array
        seconds : float
            Time that the search may take; it plans its steps accordingly.
        """

    @abstractmethod
    def pattern(self) -> Pattern:
        """The black shapes of the target, in `unit`, in the frame of `points`."""

    @classmethod
    @abstractmethod
    def parse(cls, arguments: list[str], named: dict[str, str]) -> Target:
        """Make the target from the parts of a spec, as split by `registry.split_spec`.

        Raises
        ------
        UsageError
            Where an argument is missing, unknown or out of range.
        """

    @property
    def spec(self) -> str:
        """The spec from which `targets.make` makes this target."""
        arguments = [self.kind, f"{self.columns}x{self.rows}", *self._arguments()]
        return ":".join(arguments + ["negative"] * self.negative)

    def _arguments(self) -> list[str]:
        """The part of the spec after the size."""
        return [] if self.unit == "square" else [self._length(self.square)]

    def _length(self, value: float) -> str:
        """A length with the target's unit, as `parse_length` reads it."""
        return f"{value:.6g}" + (self.unit if self.unit in UNITS else "")

    def scaled(self, square: float, unit: str) -> Target:
        """The same target with another cell length, all other lengths in proportion."""
        made = copy.copy(self)
        made.square, made.unit = float(square), unit
        return made

    def describe(self) -> dict[str, Any]:
        """The report's entry `target`."""
        said = {
            "kind": self.kind,
            "columns": self.columns,
            "rows": self.rows,
            "square": self.square,
            "unit": self.unit,
        }
        return said | {"negative": True} if self.negative else said

    def as_negative(self, negative: bool = True) -> Target:
        """The same target, with black and white exchanged if `negative`."""
        made = copy.copy(self)
        made.negative = negative
        return made

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.__dict__ == other.__dict__

    def __hash__(self) -> int:
        return hash((type(self), self.columns, self.rows, self.square, self.unit))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.__dict__.items())})"


def time_for_next(spent: float, left: float) -> bool:
    """Return whether a picture with sides twice as long can be searched within `left` s, if the last took `spent` s."""
    return LARGER * spent <= left


def checked_gap(gap: float, example: str) -> float:
    """The gap between two tags or squares, in sides; UsageError unless it is above 0 and at most `MOST_GAP`."""
    if not 0 < gap <= MOST_GAP:
        raise UsageError(
            f"a gap of {gap:g} sides is out of range.", f"Give it as a fraction of the side: {example}"
        )
    return float(gap)


def check_arguments(
    kind: str, takes: str, plain: Sequence[str], named: Mapping[str, str], known: Sequence[str], example: str
) -> None:
    """Raise a UsageError if a spec has unknown named arguments, or not as many plain ones as its example."""
    unknown = set(named) - set(known)
    if unknown:
        hint = f"Known: {', '.join(known)}. Try: {example}" if known else f"Try: {example}"
        raise UsageError(f"{kind} has no argument '{min(unknown)}'.", hint)
    count = example.count(":")
    if len(plain) != count:
        raise UsageError(f"{kind} takes {takes}; {len(plain)} of {count} are given.", f"Try: {example}")


def ratio(text: str, what: str, example: str) -> float:
    """Read a plain argument that is a number, such as a gap as a fraction of a side; UsageError for other text."""
    value = real(text)
    if value is None:
        raise UsageError(f"{what} '{text}' is not a number.", f"Try: {example}")
    return value


def not_usual(named: Iterable[tuple[str, Any, Any]]) -> list[str]:
    """The named arguments (name, value, default) of a spec that differ from their defaults."""
    return [f"{name}={value}" for name, value, default in named if value != default]


def whole_number(text: str, name: str) -> int:
    """Read the value of an argument such as `start=31`.

    Raises
    ------
    UsageError
        If it is not a non-negative integer.
    """
    if not re.fullmatch(r"\d{1,6}", text.strip()):
        raise UsageError(f"{name}={text} is not a whole number.", f"Write {name}=0, for example.")
    return int(text)
