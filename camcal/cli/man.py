"""Man pages, generated from the commands: `python -m camcal.cli.man FOLDER`.

FOLDER gets camcal.1 and a page for each command, camcal-estimate.1 and so on, in the macros of man(7).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import click

from camcal.cli import COMMANDS
from camcal.cli.group import camcal
from camcal.cli.reference import HEAD, argument, metavar
from camcal.registry import load
from camcal.version import __version__


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name of each file and its text."""
    names = [f"camcal-{name}" for name in COMMANDS]
    yield (
        "camcal.1",
        _page("camcal", "calibrate cameras", camcal, [*_commands(), *_exit_codes(), *_see(names)]),
    )
    for name, (path, summary) in COMMANDS.items():
        command = load(path)
        more = [*_parts(f"camcal {name}", command), *_exit_codes(), *_see(["camcal"])]
        yield f"camcal-{name}.1", _page(f"camcal {name}", summary.rstrip("."), command, more)


def _page(name: str, summary: str, command: click.Command, more: list[str]) -> str:
    title = name.replace(" ", "-")
    lines = [
        f'.TH "{title.upper()}" 1 "" "camcal {__version__}" "camcal"',
        ".SH NAME",
        f"{_plain(title)} \\- {_plain(summary)}",
        ".SH SYNOPSIS",
        *_synopsis(name, command),
        ".SH DESCRIPTION",
        *_text(command.help or ""),
        *_options(command),
        *more,
    ]
    return "\n".join(lines) + "\n"


def _synopsis(name: str, command: click.Command) -> list[str]:
    words = [argument(p) for p in command.params if isinstance(p, click.Argument)]
    words += ["COMMAND"] if isinstance(command, click.Group) else []
    return [f".B {_plain(name)}", _plain(" ".join([*words, "[OPTIONS]"]))]


def _options(command: click.Command) -> list[str]:
    lines = []
    for option in (p for p in command.params if isinstance(p, click.Option)):
        flags = ", ".join((*sorted(option.opts, key=len), *option.secondary_opts))
        value = "" if option.is_flag or option.count else f" \\fI{_plain(metavar(option))}\\fR"
        from_environment = f" Environment: {option.envvar}." if option.envvar else ""
        lines += [".TP", f"\\fB{_plain(flags)}\\fR{value}", _plain((option.help or "") + from_environment)]
    return [".SH OPTIONS", *lines] if lines else []


def _parts(name: str, command: click.Command) -> list[str]:
    """The sub-commands of a group."""
    if not isinstance(command, click.Group):
        return []
    lines = [".SH COMMANDS"]
    for part, inner in command.commands.items():
        lines += [f".SS {_plain(f'{name} {part}')}", *_text(inner.help or "")]
        lines += _options(inner)[1:]
    return lines


def _commands() -> list[str]:
    lines = [".SH COMMANDS"]
    for name, (_, summary) in COMMANDS.items():
        lines += [".TP", f"\\fB{_plain(name)}\\fR", _plain(summary)]
    return lines


def _exit_codes() -> list[str]:
    """The table of the reference, so that exit codes are documented once."""
    lines = [".SH EXIT STATUS"]
    for row in HEAD.splitlines():
        cells = [c.strip() for c in row.strip("|").split("|")]
        if cells[0].isdigit():
            lines += [".TP", cells[0], _plain(cells[1])]
    return lines


def _see(names: list[str]) -> list[str]:
    return [".SH SEE ALSO", ", ".join(f"\\fB{_plain(name)}\\fR(1)" for name in names)]


def _text(help: str) -> list[str]:
    lines: list[str] = []
    for paragraph in cleandoc(help).split("\n\n"):
        kept = paragraph.startswith("\b")
        lines.append(".PP")
        lines += [".nf"] if kept else []
        lines += [_plain(line) for line in paragraph.removeprefix("\b").strip("\n").splitlines()]
        lines += [".fi"] if kept else []
    return lines


def _plain(text: str) -> str:
    """Escape roff syntax: backslashes, hyphens of options, a dot at the start of a line."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("`", "")
    return "\\&" + text if text.startswith((".", "'")) else text


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for file, page in pages():
        (folder / file).write_text(page, encoding="utf-8")
