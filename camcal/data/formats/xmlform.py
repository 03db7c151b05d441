"""Functions shared by the XML formats."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element

from camcal.data.formats.base import Array, floats


def words(
    element: Element | None, name: str, count: int | tuple[int, ...] = 1, default: Iterable[float] = ()
) -> Array:
    """The numbers in the first descendant of a name; KeyError if it is missing and there is no default."""
    found = None if element is None else next(element.iter(name), None)
    if found is None or not (found.text or "").strip():
        if default != ():
            return floats(list(default))
        raise KeyError(name)
    return floats([float(w) for w in (found.text or "").replace(",", " ").split()], count, name)


def one(element: Element | None, name: str, default: float | None = None) -> float:
    """The number in the first descendant of a name."""
    return float(words(element, name, 1, () if default is None else (default,))[0])


def header() -> str:
    """The first line of an XML file."""
    return '<?xml version="1.0" encoding="UTF-8"?>\n'
