"""`camcal list`: the names that options take."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import click

from camcal.cli.options import KindType, options
from camcal.cli.output import emit, table
from camcal.cli.verbosity import verbosity_options
from camcal.settings.kinds import Words

#: kind -> (module, its table); each module may hold SUMMARIES, name -> one line, beside the table; a table of
#: summaries has its own lines.
TABLES: dict[str, tuple[str, str]] = {
    "models": ("camcal.model.lenses", "LENSES"),
    "targets": ("camcal.detect.targets", "TARGETS"),
    "optimizers": ("camcal.solve.optimizers", "OPTIMIZERS"),
    "closed-forms": ("camcal.start", "CLOSED_FORMS"),
    "estimators": ("camcal.track", "ESTIMATORS"),
    "gains": ("camcal.track", "GAIN_SUMMARIES"),
    "motions": ("camcal.track", "MOTION_SUMMARIES"),
    "robust-methods": ("camcal.solve", "ROBUST_SUMMARIES"),
    "board-shapes": ("camcal.solve", "BOARD_SHAPE_SUMMARIES"),
    "formats": ("camcal.data.formats", "FORMATS"),
    "point-files": ("camcal.data.point_files", "POINT_FILES"),
    "commands": ("camcal.cli", "COMMANDS"),
}


def entries(kind: str) -> list[dict[str, str]]:
    """List `{name, summary}` of one table, without loading the entries."""
    module_name, attribute = TABLES[kind]
    module = importlib.import_module(module_name)
    known: Mapping[str, object] = getattr(module, attribute, {})
    summaries: Mapping[str, str] = getattr(module, "SUMMARIES", {})
    own = attribute.endswith("SUMMARIES")
    return [
        {"name": name, "summary": str(value) if own else summaries.get(name, _own_text(value))}
        for name, value in known.items()
    ]


def _own_text(value: object) -> str:
    """Return the help line if the table of commands holds it; other tables hold only a path."""
    return value[1] if isinstance(value, tuple) else ""


@click.command("list")
@click.argument("kind", type=KindType(Words(tuple(TABLES))), metavar="KIND")
@options("list")
@verbosity_options
def command(kind: str, format: str) -> None:
    """List the entries of one KIND, with a line on each.

    KIND is models, targets, optimizers, closed-forms, estimators, gains, motions, robust-methods, board-shapes,
    formats, point-files or commands.
    """
    found: list[dict[str, Any]] = [*entries(kind)]
    if kind == "formats":
        found = _with_room(found)
        columns = ["name", "summary", "reads", "writes", "lens models"]
        emit(
            found,
            format,
            lambda: table(columns, [[*list(e.values())[:4], _shown(e["models"])] for e in found]),
        )
        return
    emit(found, format, lambda: table(["name", "summary"], [[e["name"], e["summary"]] for e in found]))


def _with_room(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The formats with what each can represent, which is known once they are loaded."""
    from camcal.data.formats.files import named_format

    made = []
    for entry in found:
        form = named_format(entry["name"])
        writes = "yes" if form.write is not None or form.name == "camcal" else "no"
        room = {"reads": "yes", "writes": writes, "models": list(form.models), "endings": list(form.endings)}
        more = {
            "several": form.several,
            "poses": form.poses,
            "image_size": form.size,
            "first_pixel": form.centre,
        }
        made.append({**entry, **room, **more})
    return made


def _shown(models: list[str]) -> str:
    """Lens models on one line; all of them for camcal's own format."""
    return ", ".join(m.replace("+", " +") for m in models) or "all"
