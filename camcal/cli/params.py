"""Parameter types: text on the command line or a value in YAML -> what the program works with."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

import click

LENGTH_UNITS = ("um", "mm", "cm", "m", "in")


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


class PairType(CamcalType):
    """Two whole numbers: `640x480`, or `[640, 480]` in YAML."""

    def __init__(self, name: str, what: str, example: str, least: int):
        self.name, self.what, self.example, self.least = name, what, example, least

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return the pair as (first, second)."""
        if isinstance(value, str):
            found = re.fullmatch(r"\s*(\d+)\s*[xX]\s*(\d+)\s*", value)
            pair = found.groups() if found else ()
        else:
            pair = tuple(value) if isinstance(value, (list, tuple)) else ()
        if len(pair) != 2 or not all(isinstance(n, str) or type(n) is int for n in pair):
            self.refuse(f"{_shown(value)} is not {self.what}.", f"Try: {self.example}", param, ctx)
        first, second = int(pair[0]), int(pair[1])
        if min(first, second) < self.least:
            self.refuse(
                f"{first}x{second}: both numbers must be at least {self.least}.",
                f"Try: {self.example}",
                param,
                ctx,
            )
        return first, second


class LengthType(CamcalType):
    """A positive length with its unit: `25mm`, `0.025m`, or a bare number."""

    name = "length"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Length:
        """Return the length as (value, unit)."""
        if isinstance(value, Length):
            return value
        found = re.fullmatch(r"\s*([0-9.eE+-]+?)\s*([a-zA-Zµ]*)\s*", str(value))
        size = _float(found[1]) if found else None
        if found is None or size is None or isinstance(value, bool):
            self.refuse(f"{_shown(value)} is not a length.", "Try: 25mm", param, ctx)
        unit = found[2].replace("µ", "u") or "unit"
        if unit not in (*LENGTH_UNITS, "unit"):
            self.refuse(
                f"{_shown(value)}: unknown unit '{unit}'.", f"Known: {', '.join(LENGTH_UNITS)}.", param, ctx
            )
        if not (math.isfinite(size) and size > 0):
            self.refuse(f"{_shown(value)}: a length must be positive.", "Try: 25mm", param, ctx)
        return Length(size, unit)


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

    def __init__(self, kind: str, table: Callable[[], Mapping[str, Any]], extra: tuple[str, ...] = ()):
        self.name, self.kind, self.table, self.extra = kind, kind, table, extra

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text as it is, once its name is known."""
        from camcal.registry import suggestion

        name = str(value).partition(":")[0].strip()
        known = [*self.table(), *self.extra]
        if name not in known:
            hint = suggestion(name, known) or f"Known: {', '.join(known)}."
            self.refuse(f"unknown {self.kind} '{name}'.", hint, param, ctx)
        return str(value).strip()

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Offer the names of the table."""
        from click.shell_completion import CompletionItem

        names = [*self.table(), *self.extra]
        return [CompletionItem(name) for name in names if name.startswith(incomplete)]


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


def _shown(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else str(value)


IMAGE_SIZE = PairType("WxH", "an image size; width x height in pixels is needed", "640x480", 1)
BOARD = PairType("CxR", "a board; its inner corners, columns x rows, are needed", "9x6", 2)
LENGTH = LengthType()
FIX = FixType()
