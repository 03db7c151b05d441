"""The command-line reference, docs/cli.md, generated from the commands.

`python -m camcal.cli.reference > docs/cli.md` renews it; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Iterator
from inspect import cleandoc

import click

from camcal.cli import COMMANDS
from camcal.registry import load

HEAD = """\
# The command line

This page is generated from the commands: `python -m camcal.cli.reference > docs/cli.md`.

Results go to stdout, everything else to stderr. An option takes its value from the flag, else from the
environment variable in the last column, else from the [configuration file](configuration.md), else from its
default. `-v` prints more, `-q` only errors; both may stand before or after the name of the command.

| exit code | meaning |
|---|---|
| 0 | done, every gate passed |
| 1 | done, a gate failed (`--max-rms`, cross-check); the report is written |
| 2 | usage or configuration |
| 3 | data: unreadable, too few views or points, not a number |
| 4 | estimation failed: degenerate configuration, diverged |
| 70 | a bug in camcal: one line and where the log is; the traceback with `-vv` |
| 130 | interrupted |
| 141 | the program that read camcal's output has ended |
"""


def reference() -> str:
    """Return the whole page as Markdown."""
    parts = [HEAD, *(_chapter(f"camcal {name}", load(path)) for name, (path, _) in COMMANDS.items())]
    return "\n".join(parts)


def _chapter(title: str, command: click.Command) -> str:
    arguments = [argument(p) for p in command.params if isinstance(p, click.Argument)]
    arguments += ["COMMAND"] if isinstance(command, click.Group) else []
    usage = " ".join([title, *arguments, "[OPTIONS]"])
    rows = [
        _row(p) for p in command.params if isinstance(p, click.Option) and p.name not in ("verbose", "quiet")
    ]
    lines = [
        f"{'#' * title.count(' ')}# {title}",
        "",
        "```",
        usage,
        "```",
        "",
        *_paragraphs(command.help or ""),
        "",
    ]
    if rows:
        lines += ["| option | what it does | default | environment |", "|---|---|---|---|", *rows, ""]
    if isinstance(command, click.Group):
        lines += [_chapter(f"{title} {name}", part) for name, part in command.commands.items()]
    return "\n".join(lines)


def argument(param: click.Argument) -> str:
    """The placeholder of an argument in the usage line."""
    name = param.human_readable_name
    return name if param.required else f"[{name}]"


def _row(option: click.Option) -> str:
    flags = ", ".join(f"`{flag}`" for flag in (*sorted(option.opts, key=len), *option.secondary_opts))
    value = "" if option.is_flag else f" `{metavar(option)}`"
    environment = f"`{option.envvar}`" if option.envvar else ""
    cells = (flags + value, option.help or "", _default(option), environment)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def metavar(option: click.Option) -> str:
    """The placeholder of an option's value in the usage line."""
    if option.metavar:
        return option.metavar
    choices = getattr(option.type, "choices", None)
    return "|".join(choices) if choices else option.type.name.upper()


def _default(option: click.Option) -> str:
    if option.is_flag:
        return "on" if option.default is True else ""
    simple = isinstance(option.default, (str, int, float)) and not option.multiple
    return f"`{option.default}`" if simple else ""


def _paragraphs(text: str) -> Iterator[str]:
    """Return the help text as Markdown lines; click's mark for kept lines becomes a code block."""
    for paragraph in cleandoc(text).split("\n\n"):
        lines = paragraph.splitlines()
        if lines and lines[0].strip() == "\b":
            lines = ["```", *lines[1:], "```"]
        yield from (*lines, "")


if __name__ == "__main__":
    print(reference(), end="")
