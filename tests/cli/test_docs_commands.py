"""Every command that the docs name exists, with every option that they give it."""

import re
import shlex
from pathlib import Path

import click
import pytest

from camcal.cli import COMMANDS
from camcal.registry import load

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def written(page):
    """The text of each `camcal ...` in code of a page: fenced lines, and inline code."""
    text = page.read_text(encoding="utf-8")
    every = re.findall(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    fences = [block for kind, block in every if kind in ("", "sh")]
    inline = re.findall(r"(?<!`)`([^`]+)`(?!`)", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
    for part in [*(line for fence in fences for line in fence.splitlines()), *inline]:
        for found in re.finditer(r"(?:^|&& |\$ |do )(?:\.venv/bin/)?camcal ([a-z][^;&|]*)", part.strip()):
            yield found[1].split(" #")[0]


def unknown(text):
    """What of a command line camcal does not have: its command, a sub-command, an option."""
    try:
        words = shlex.split(text.replace("…", "").replace("...", ""))
    except ValueError:
        words = text.split()
    name, *rest = words
    if name not in COMMANDS:
        return name
    command = load(COMMANDS[name][0])
    if isinstance(command, click.Group) and rest and re.fullmatch(r"[a-z]+", rest[0]):
        name, *rest = rest
        if name not in command.commands:
            return name
        command = command.commands[name]
    known = {flag for p in command.params for flag in (*p.opts, *p.secondary_opts)} | {"--help", "-h"}
    if isinstance(command, click.Group):
        known |= {
            f for c in command.commands.values() for p in c.params for f in (*p.opts, *p.secondary_opts)
        }
    flags = [w.partition("=")[0].strip("[](),.:") for w in rest if re.match(r"\[?--?[a-zA-Z]", w)]
    return next((f for f in flags if f not in known and f[:2] not in known | {"-v"}), None)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_options_exist(page):
    assert [(text, what) for text in written(page) if (what := unknown(text)) is not None] == []


def test_it_finds_what_is_wrong():
    assert unknown("rectify rig.yaml left=a right=b -o out --alpha 0") is None
    assert unknown("rectifie rig.yaml") == "rectifie"
    assert unknown("rectify rig.yaml --alfa 0") == "--alfa"
    assert unknown("simulate pictures -o x") == "pictures"
    assert sum(len(list(written(page))) for page in PAGES) > 200
