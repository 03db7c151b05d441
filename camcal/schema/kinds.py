"""The types of the sections of a report."""

from __future__ import annotations

import sys
from typing import Annotated, Any, ClassVar

import msgspec
from msgspec import UNSET, Meta, UnsetType

__all__ = ["UNSET", "Section", "UnsetType", "key"]


class Section(msgspec.Struct):
    """A group of keys. Unknown keys are ignored when it is read, and rejected when it is written."""

    open: ClassVar[bool] = False  #: whether other keys may be written too


def key(text: str, **limits: Any) -> Meta:
    """Return the annotation of a key: its description in docs/report.md, and the limits of its value."""
    return Meta(description=text, **limits)


#: a number that is neither infinite nor NaN
Finite = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
#: a length above 0
Length = Annotated[float, Meta(gt=0, le=sys.float_info.max)]
#: a figure; null or NaN where there is none
Figure = float | None
#: a standard deviation: null where nothing was estimated, infinite where it is not determined
Sigma = Annotated[float, Meta(ge=0)] | None
Count = Annotated[int, Meta(ge=0)]
Positive = Annotated[int, Meta(ge=1)]
Size = tuple[Positive, Positive]
Vector = tuple[Finite, Finite, Finite]
Matrix = tuple[Vector, Vector, Vector]
Row = tuple[Finite, Finite, Finite, Finite]
Projection = tuple[Row, Row, Row]
