"""Kinds of values: how text, a YAML value or a Python object becomes the value that the program works with.

`convert` accepts what it returns, so that converting twice changes nothing.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path, PurePath
from typing import Any

from camcal.errors import UsageError
from camcal.registry import load, suggestion
from camcal.system.text import quoted


class Kind:
    """A kind of value; the base class accepts everything unchanged."""

    metavar: str = "VALUE"  #: how the value is named in the help

    def convert(self, value: Any) -> Any:
        """Return the value in the form that the program uses.

        Raises
        ------
        UsageError
            If it is not of this kind: what was found and what is needed, with a hint.
        """
        return value

    def words(self) -> list[str]:
        """Names that shell completion offers."""
        return []


def refuse(value: Any, needed: str, hint: str | None = None) -> UsageError:
    """Return the error for a value that is not what was `needed`."""
    return UsageError(f"{quoted(value)} is not {needed}.", hint)


def real(value: Any) -> float | None:
    """Return a number, or text that is one, as a float; None for anything else."""
    if isinstance(value, bool):
        return None
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def parts_of(value: Any) -> list[Any]:
    """Split `a,b,c`, or return the items of a sequence (a list, a tuple, an array)."""
    return value.split(",") if isinstance(value, str) else list(value)


class Switch(Kind):
    """On or off."""

    def convert(self, value: Any) -> bool:
        """Return True or False; words such as `yes` are rejected."""
        if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b":
            return bool(value)
        raise refuse(value, "true or false")


class SwitchOr(Switch):
    """On, off, or one of a few words that are variants of on."""

    def __init__(self, *known: str):
        self.known, self.metavar = known, "|".join(known)

    def convert(self, value: Any) -> bool | str:  # type: ignore[override]
        """Return True, False or the word."""
        if isinstance(value, str) and value in self.known:
            return value
        try:
            return super().convert(value)
        except UsageError:
            raise refuse(value, f"true, false or {' or '.join(self.known)}") from None

    def words(self) -> list[str]:
        """Return the words."""
        return list(self.known)


class Whole(Kind):
    """A whole number from `low` to `high`, both included."""

    def __init__(self, low: int, high: int | None = None, metavar: str = "WHOLE NUMBER"):
        self.low, self.high, self.metavar = low, high, metavar

    def convert(self, value: Any) -> int:
        """Return an int."""
        try:
            number = int(value) if isinstance(value, str) else operator.index(value)
        except (TypeError, ValueError):
            raise refuse(value, self.needed) from None
        if isinstance(value, bool) or number < self.low or (self.high is not None and number > self.high):
            raise refuse(value, self.needed)
        return number

    @property
    def needed(self) -> str:
        """Return the range in words."""
        return f"a whole number from {self.low} " + ("up" if self.high is None else f"to {self.high}")


class Real(Kind):
    """A number from `low` to `high`; `above` excludes `low` itself, `infinite` allows infinity."""

    def __init__(
        self,
        low: float = -math.inf,
        high: float = math.inf,
        above: bool = False,
        infinite: bool = False,
        metavar: str = "NUMBER",
    ):
        self.low, self.high, self.above, self.infinite = low, high, above, infinite
        self.metavar = metavar

    def convert(self, value: Any) -> float:
        """Return a float."""
        number = real(value)
        if number is None or not (self.infinite or math.isfinite(number)):
            raise refuse(value, self.needed)
        if not (self.low < number or (self.low == number and not self.above)) or number > self.high:
            raise refuse(value, self.needed)
        return number

    @property
    def needed(self) -> str:
        """Return the range in words."""
        if self.low == -math.inf:
            return "a number"
        least = f"a number above {self.low:g}" if self.above else f"a number from {self.low:g}"
        if self.infinite:
            return f"{least}, or inf"
        if self.high == math.inf:
            return least if self.above else f"{least} up"
        return f"{least} {'and at most' if self.above else 'to'} {self.high:g}"


#: a number above 0
POSITIVE = Real(0, above=True)


class Places(Kind):
    """An increasing sequence of numbers, or a single positive number."""

    metavar = "LENGTH|P1,P2,..."

    def convert(self, value: Any) -> tuple[float, ...]:
        """Return a tuple of floats."""
        found = [real(p) for p in (parts_of(value) if isinstance(value, (str, list, tuple)) else [value])]
        numbers = [n for n in found if n is not None and math.isfinite(n)]
        rising = all(a < b for a, b in pairwise([0.0, *numbers] if len(numbers) == 1 else numbers))
        if len(numbers) != len(found) or not numbers or not rising:
            raise refuse(value, "a length above 0, or increasing places", "Try: 0.5 or 0,0.2,0.5")
        return tuple(numbers)


class Text(Kind):
    """Any text; a number in YAML counts as the text that is written."""

    metavar = "TEXT"

    def convert(self, value: Any) -> str:
        """Return a str."""
        if isinstance(value, (str, int, float)) and not isinstance(value, bool):
            return str(value)
        raise refuse(value, "text")


class FilePath(Kind):
    """A file or a folder."""

    metavar = "FILE"

    def convert(self, value: Any) -> Path:
        """Return a Path."""
        if isinstance(value, (str, PurePath)) and str(value):
            return Path(value)
        raise refuse(value, "the name of a file")


class CameraSource(FilePath):
    """A camera file; in Python a camera too."""

    def convert(self, value: Any) -> Any:
        """Return the Path, or the camera unchanged."""
        return value if hasattr(value, "lens") else super().convert(value)


class OutputPath(FilePath):
    """A file or a folder to write to."""


class Words(Kind):
    """One of a few words."""

    def __init__(self, known: tuple[str, ...]):
        self.known, self.metavar = known, "|".join(known)

    def convert(self, value: Any) -> str:
        """Return the word."""
        if isinstance(value, str) and value in self.known:
            return value
        hint = suggestion(str(value), self.known) or f"Known: {', '.join(self.known)}."
        raise UsageError(f"{quoted(value)} is not known here.", hint)

    def words(self) -> list[str]:
        """Return the words."""
        return list(self.known)


class Name(Kind):
    """A name from a table, with optional arguments after a colon: `brown:radial=3`.

    Parameters
    ----------
    kind : str
        What the table holds, for messages: "model".
    table : str
        "module:object" of a mapping with these names; its module must not import numpy.
    also : tuple of str
        Names besides those of the table.
    files : bool
        Whether the name of a report (.yaml, .yml, .json) is good too.
    """

    def __init__(
        self, kind: str, table: str, also: tuple[str, ...] = (), files: bool = False, metavar: str = "NAME"
    ):
        self.kind, self.table, self.also, self.files, self.metavar = kind, table, also, files, metavar

    def convert(self, value: Any) -> str:
        """Return the text unchanged after checking that its name is known."""
        text = str(value).strip()
        if self.files and is_report(text):
            return text
        name = text.partition(":")[0].strip()
        known = self.words()
        if name not in known:
            hint = suggestion(name, known) or f"Known: {', '.join(known)}."
            raise UsageError(f"unknown {self.kind} '{name}'.", hint)
        return text

    def words(self) -> list[str]:
        """Return the names of the table."""
        return [*load(self.table), *self.also]


def is_report(name: Any) -> bool:
    """Return whether a text is the name of a report: it ends in .yaml, .yml or .json."""
    return str(name).lower().endswith((".yaml", ".yml", ".json"))


class Assignments(Kind):
    """Names with values: `p1,p2,k3=0.1`, or a list or mapping; several of them are merged.

    A name without a value gets None, which is refused where `values` says that each needs one. `qualified` names may
    say of what they are: `left.fx`.
    """

    def __init__(
        self,
        metavar: str = "NAME[=VALUE],...",
        example: str = "p1,p2,k3=0.1",
        values: bool = False,
        qualified: bool = False,
    ):
        self.metavar, self.example, self.values, self.qualified = metavar, example, values, qualified

    def convert(self, value: Any) -> dict[str, float | None]:
        """Return a dict name -> float or None."""
        found: dict[str, float | None] = {}
        for name, held in self._pairs(value):
            number = None if held is None else real(held)
            if held is not None and (number is None or not math.isfinite(number)):
                raise UsageError(f"{name}={held}: {quoted(held)} is not a number.", f"Try: {self.example}")
            if held is None and self.values:
                raise UsageError(f"'{name}' has no value; a number is needed.", f"Try: {self.example}")
            if name in found and found[name] != number:
                raise UsageError(f"'{name}' is given twice, with different values.", "Leave one out.")
            found[name] = number
        return found

    def _pairs(self, value: Any) -> list[tuple[str, Any]]:
        if isinstance(value, Mapping):
            return [(str(name), held) for name, held in value.items()]
        if isinstance(value, str):
            return [self._split(part) for part in value.split(",")]
        if isinstance(value, (list, tuple)):
            return [pair for part in value for pair in self._pairs(part)]
        raise refuse(value, self.metavar, f"Try: {self.example}")

    def _split(self, part: str) -> tuple[str, str | None]:
        name, equals, held = (text.strip() for text in part.partition("="))
        if not re.fullmatch(r"[\w.-]+" if self.qualified else r"[A-Za-z_]\w*", name) or (equals and not held):
            raise refuse(part, "NAME or NAME=VALUE", f"Try: {self.example}")
        return name, held if equals else None


class Several(Kind):
    """Any number of values of one kind: a flag that may be repeated, a list, or a single value."""

    def __init__(self, item: Kind):
        self.item, self.metavar = item, item.metavar

    def convert(self, value: Any) -> tuple[Any, ...]:
        """Return a tuple."""
        items = value if isinstance(value, (list, tuple)) else [value]
        return tuple(self.item.convert(item) for item in items)

    def words(self) -> list[str]:
        """Return the shell completions of an item."""
        return self.item.words()
