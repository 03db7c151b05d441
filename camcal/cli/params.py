"""Parameter types: text on the command line or a value in YAML -> what the program works with."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, NoReturn

import click

from camcal.errors import UsageError


class Length(NamedTuple):
    """A length and its unit; `unit` is "unit" where none was given."""

    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:g}" + ("" if self.unit == "unit" else self.unit)


class HintedError(click.BadParameter):
    """A bad value with one thing to try."""

    def __init__(self, message: str, hint: str | None = None, **kwargs: Any):
        super().__init__(message, **kwargs)
        self.hint = hint


class CamcalType(click.ParamType):
    """A parameter type whose errors carry a hint."""

    def refuse(
        self, message: str, hint: str | None, param: click.Parameter | None, ctx: click.Context | None
    ) -> NoReturn:
        """Raise the error for a value that does not fit."""
        raise HintedError(message, hint, param=param, ctx=ctx)

    @contextmanager
    def own_words(self, param: click.Parameter | None, ctx: click.Context | None) -> Iterator[None]:
        """Turn a UsageError of another room into the error of this parameter."""
        try:
            yield
        except UsageError as error:
            raise HintedError(error.message, error.hint, param=param, ctx=ctx) from error


class SizeType(CamcalType):
    """The size of a picture: `640x480`, or `[640, 480]` in YAML."""

    name = "WxH"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return (width, height)."""
        found = re.fullmatch(r"\s*(\d{1,7})\s*[xX]\s*(\d{1,7})\s*", _with_x(value))
        if not found:
            message = f"{_shown(value)} is not an image size; width x height in pixels is needed."
            self.refuse(message, "Try: 640x480", param, ctx)
        width, height = int(found[1]), int(found[2])
        if min(width, height) < 1:
            self.refuse(f"a picture of {width}x{height} has no pixels.", "Try: 640x480", param, ctx)
        return width, height


class BoardType(CamcalType):
    """The size of a board in inner corners: `9x6`, or `[9, 6]` in YAML."""

    name = "CxR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return (columns, rows)."""
        from camcal.detect.targets.base import parse_grid

        with self.own_words(param, ctx):
            return parse_grid(_with_x(value))


class LengthType(CamcalType):
    """A positive length with its unit: `25mm`, `0.025m`, or a bare number."""

    name = "length"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Length:
        """Return the length as (value, unit)."""
        if isinstance(value, Length):
            return value
        from camcal.detect.targets.base import parse_length

        with self.own_words(param, ctx):
            return Length(*parse_length(str(value)))


class PixelType(CamcalType):
    """A place in a picture: `100,200`, or `[100, 200]` in YAML."""

    name = "U,V"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Return (u, v)."""
        parts = value if isinstance(value, (list, tuple)) else str(value).split(",")
        numbers = [_float(part) for part in parts]
        if len(numbers) != 2 or any(n is None or not math.isfinite(n) for n in numbers):
            message = f"{_shown(value)} is not a pixel; its two coordinates are needed."
            self.refuse(message, "Try: 100,200", param, ctx)
        u, v = (float(n) for n in numbers if n is not None)
        return u, v


class DistanceType(CamcalType):
    """A positive distance in the unit of the data, or `inf`."""

    name = "distance"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the distance."""
        number = _float(value)
        if number is None or not number > 0:
            message = f"{_shown(value)} is not a distance; a positive number, or inf, is needed."
            self.refuse(message, "Try: inf", param, ctx)
        return number


class FixType(CamcalType):
    """Parameters to hold: `p1,p2,k3=0.1`, or a list or mapping in YAML; a dict name -> value or None."""

    name = "fix"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> dict[str, float | None]:
        """Return the names with the values to hold them at; None holds a parameter where it starts."""
        if isinstance(value, Mapping):
            pairs = [(str(name), held) for name, held in value.items()]
        else:
            parts = value.split(",") if isinstance(value, str) else list(value)
            pairs = [self._split(str(part), param, ctx) for part in parts]
        fixed: dict[str, float | None] = {}
        for name, held in pairs:
            number = None if held is None else _float(held)
            if held is not None and (number is None or not math.isfinite(number)):
                self.refuse(f"{name}={held}: {_shown(held)} is not a number.", "Try: k3=0.1", param, ctx)
            if name in fixed and fixed[name] != number:
                self.refuse(f"'{name}' is fixed twice, at different values.", "Leave one out.", param, ctx)
            fixed[name] = number
        return fixed

    def _split(
        self, part: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str | None]:
        name, equals, held = (text.strip() for text in part.partition("="))
        if not re.fullmatch(r"[A-Za-z_]\w*", name) or (equals and not held):
            self.refuse(f"{_shown(part)} is not NAME or NAME=VALUE.", "Try: p1,p2,k3=0.1", param, ctx)
        return name, held if equals else None


class SpecType(CamcalType):
    """A name of one of the tables, with arguments after a colon: `brown:radial=3`. The table is read late."""

    def __init__(self, kind: str, table: Callable[[], Iterable[str]]):
        self.name, self.kind, self.table = kind, kind, table

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text as it is, once its name is known."""
        from camcal.registry import suggestion

        name = str(value).partition(":")[0].strip()
        known = list(self.table())
        if name not in known:
            hint = suggestion(name, known) or f"Known: {', '.join(known)}."
            self.refuse(f"unknown {self.kind} '{name}'.", hint, param, ctx)
        return str(value).strip()

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Offer the names of the table."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(name) for name in self.table() if name.startswith(incomplete)]


class ShapeType(SpecType):
    """A kind of board shape, or the report (a YAML or JSON file) that holds one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the kind, or the path as it is."""
        if is_report(value):
            return str(value)
        return super().convert(value, param, ctx)


def is_report(shape: Any) -> bool:
    """Whether a board shape is the name of a report."""
    return str(shape).lower().endswith((".yaml", ".yml", ".json"))


class Word(click.Choice):
    """One of a few words; the error names the closest one, or all of them."""

    def __init__(self, words: Sequence[str]):
        super().__init__(list(words))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        from camcal.registry import suggestion

        if value in self.choices:
            return value
        hint = suggestion(str(value), self.choices) or f"Known: {', '.join(self.choices)}."
        raise HintedError(f"{_shown(value)} is not known here.", hint, param=param, ctx=ctx)


def _float(text: Any) -> float | None:
    try:
        return float(text)
    except (TypeError, ValueError):
        return None


def _with_x(value: Any) -> str:
    """Write `[640, 480]` as `640x480`."""
    return "x".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _shown(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else str(value)


IMAGE_SIZE = SizeType()
BOARD = BoardType()
LENGTH = LengthType()
FIX = FixType()
