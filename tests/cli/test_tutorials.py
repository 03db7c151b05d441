"""The tutorials and the page of questions work as they stand: their commands in order, then their Python, in a folder
with what a clone has.

A line that ends with `# exit N` has that exit code, every other one 0.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "docs" / "how-to.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
#: what only a shell can do
SHELL = re.compile(r"[;|<>$]|^(?!camcal )")


def blocks(page, kind):
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def lines(block):
    """The commands of a block; a here-document is part of its command."""
    found, end = [], None
    for line in block.splitlines():
        if end is not None:
            found[-1] += "\n" + line
            end = None if line == end else end
        elif line.strip():
            found.append(line)
            here = re.search(r"<<'(\w+)'$", line)
            end = here[1] if here else None
    return found


def in_a_shell(line, place):
    """Run a line with bash, where `camcal` and `python` are these ones."""
    programs = place.parent / "bin"
    programs.mkdir(exist_ok=True)
    for name, more in (("camcal", "-m camcal "), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {more}"$@"\n')
        (programs / name).chmod(0o755)
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    return subprocess.run(["bash", "-c", line], env=env, capture_output=True, text=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tutorial(camcal, page):
    place = Path.cwd()
    for name in ("sample_data", "configs", "examples"):
        (place / name).symlink_to(ROOT / name)
    done = 0
    for line in [line for block in blocks(page, "sh") for line in lines(block)]:
        command, _, comment = line.partition(" # exit ")
        if SHELL.search(command.split("'")[0].split('"')[0]):
            finished = in_a_shell(command, place)
            code, err = finished.returncode, finished.stderr
        else:
            code, _, err = camcal(*shlex.split(command)[1:])
        assert code == int(comment or 0), f"{line}\n{err}"
        done += 1
    assert done >= 3
    names = {}
    for text in blocks(page, "python"):
        exec(compile(text, page.name, "exec"), names)


def test_the_index_knows_each():
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert [p.name for p in PAGES if f"({p.relative_to(ROOT / 'docs')})" not in text] == []
