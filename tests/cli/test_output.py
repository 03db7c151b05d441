import json

import numpy as np
import pytest
import yaml

from camcal.cli import output
from camcal.cli.verbosity import note


def test_number():
    assert output.number(None) == "-"
    assert output.number(float("nan")) == "-"
    assert output.number(54) == "54"
    assert output.number(832.5012345) == "832.501"
    assert output.number(-2.28601e-05) == "-2.28601e-05"


@pytest.mark.parametrize(("format", "read"), [("json", json.loads), ("yaml", yaml.safe_load)])
def test_exactly_one_document(capsys, format, read):
    document = {"matrix": np.eye(2), "rms": np.float64(0.1), "none": None, "size": (640, 480)}
    output.emit(document, format, lambda: pytest.fail("no table was asked for"))
    said = capsys.readouterr()
    assert said.err == ""
    assert read(said.out) == {"matrix": [[1, 0], [0, 1]], "rms": 0.1, "none": None, "size": [640, 480]}


def test_table_off_a_terminal(capsys):
    rows = [["a [name] in brackets", 0.123456789, None], ["b " * 60, 12.0, 3]]
    output.emit(None, "table", lambda: output.table(["name", "value", "n"], rows))
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "a [name] in brackets" in out
    assert "0.123457" in out
    assert "\x1b" not in out


def test_notes_go_to_stderr(capsys):
    note("said")
    note("left out", 1)
    assert capsys.readouterr() == ("", "said\n")


def test_no_animation_off_a_terminal(capsys):
    with output.progress("reading") as show:
        show(1, 3)
    assert capsys.readouterr() == ("", "")


def test_progress_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with output.progress("reading") as show:
        show(1, 3)
    said = capsys.readouterr()
    assert said.out == ""
    assert "reading" in said.err
