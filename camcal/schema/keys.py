"""The tables of keys in docs/report.md, from the schema.

`python -m camcal.schema.keys docs/report.md` renews them in place: each stands between `<!-- keys: PATH -->` and
`<!-- end -->`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from msgspec import Meta

from camcal.schema.kinds import Section
from camcal.schema.report import Report
from camcal.schema.structure import hints_of

_BLOCK = re.compile(r"<!-- keys: (\S+) -->\n.*?<!-- end -->", re.DOTALL)


def sections(kind: type[Section] = Report, path: str = "") -> Iterator[tuple[str, type[Section]]]:
    """Yield (path, section) of a section and all below it; `[]` stands for any item, `NAME` for any name."""
    yield path or "report", kind
    for name, hint in hints_of(kind).items():
        for inside, inner in _inner(hint):
            yield from sections(inner, (f"{path}.{name}" if path else name) + inside)


def _inner(hint: Any) -> Iterator[tuple[str, type[Section]]]:
    """Yield the sections that a type contains, with the path to them."""
    if isinstance(hint, type) and issubclass(hint, Section):
        yield "", hint
        return
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        arguments = arguments[:1]
    inside = ".NAME" if origin is dict else "[]" if origin is list else ""
    for argument in arguments:
        for more, kind in _inner(argument):
            yield inside + more, kind


def table(kind: type[Section]) -> str:
    """Return the table of the keys of a section, as Markdown."""
    rows = [
        f"| `{name}` | {_text(hint).replace('|', chr(92) + '|')} |" for name, hint in hints_of(kind).items()
    ]
    return "\n".join(["| key | what |", "|---|---|", *rows]) + "\n"


def _text(hint: Any) -> str:
    texts = [m.description for m in get_args(hint)[1:] if isinstance(m, Meta) and m.description]
    return texts[-1]


def renewed(page: str) -> str:
    """Return a page with its tables of keys regenerated.

    Raises
    ------
    KeyError
        If the page has a table of a path that the schema does not have.
    """
    known = dict(sections())
    return _BLOCK.sub(lambda m: f"<!-- keys: {m[1]} -->\n{table(known[m[1]])}<!-- end -->", page)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.write_text(renewed(target.read_text(encoding="utf-8")), encoding="utf-8")
