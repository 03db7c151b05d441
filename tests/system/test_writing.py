"""Part files: unguessable, locked while they are written, removed by the next run when their writer was killed."""

import os
import subprocess
import sys

import pytest

from camcal.errors import UsageError
from camcal.system import writing
from camcal.system.writing import PartFile, atomic_write, check_writable


@pytest.fixture(autouse=True)
def _nothing_swept(monkeypatch):
    monkeypatch.setattr(writing, "_swept", set())


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_what_a_killed_run_left_is_swept(tmp_path):
    stale = tmp_path / ".r.yaml.0123456789abcdef.camcal.part"
    stale.write_text("half")
    other = tmp_path / ".notes.part"
    other.write_text("of somebody else")
    atomic_write(tmp_path / "r.yaml", "whole")
    assert names(tmp_path) == [".notes.part", "r.yaml"]


def test_what_another_run_is_writing_stays(tmp_path):
    code = (
        "import sys; from camcal.system.writing import PartFile\n"
        "part = PartFile(sys.argv[1]); print(part.path, flush=True); input()"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "a")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    part = child.stdout.readline().strip()
    atomic_write(tmp_path / "b", "whole")
    assert os.path.exists(part)  # noqa: PTH110
    child.kill()
    child.communicate()
    writing._swept.clear()
    atomic_write(tmp_path / "c", "whole")
    assert names(tmp_path) == ["b", "c"]


def test_links_under_the_name_of_a_part_file_are_not_followed(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (tmp_path / ".r.0123456789abcdef.camcal.part").symlink_to(precious)
    atomic_write(tmp_path / "r", "whole")
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("links", [True, False])
def test_of_two_writers_one_wins(tmp_path, monkeypatch, links):
    if not links:

        def none(*_):
            raise OSError(95, "Operation not supported")

        monkeypatch.setattr(writing.os, "link", none)
    first, second = PartFile(tmp_path / "r"), PartFile(tmp_path / "r")
    first.write(b"first")
    second.write(b"second")
    second.commit(force=False)
    with pytest.raises(UsageError, match="exists already"):
        first.commit(force=False)
    first.discard()
    assert (tmp_path / "r").read_text() == "second"
    assert names(tmp_path) == ["r"]


def test_names_that_are_no_file(tmp_path):
    with pytest.raises(UsageError, match="'-' is not a file name"):
        check_writable("-")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(UsageError, match="exists already"):
        atomic_write(tmp_path / "loop", "x")
