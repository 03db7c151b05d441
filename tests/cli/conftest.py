"""Every test of the command line runs in an empty folder of its own and without CAMCAL_* variables."""

import json
import os
from pathlib import Path

import pytest

from camcal.cli import COMMANDS
from camcal.cli.boundary import run
from camcal.settings import commands

TOY = ("tests.cli.toy:command", "A command of the tests.")
TOY_OPTIONS = (*commands.BOARD, commands.IMAGE_SIZE, *commands.CALIBRATION, *commands.REPORT)

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


@pytest.fixture(autouse=True)
def _clean_place(tmp_path, monkeypatch):
    for name in [name for name in os.environ if name.startswith("CAMCAL_")]:
        monkeypatch.delenv(name)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def camcal(capsys):
    """Run a command line in this process: `code, stdout, stderr = camcal("list", "models")`."""

    def call(*args):
        code = run([str(arg) for arg in args])
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


@pytest.fixture
def toy(camcal, monkeypatch):
    """Run the toy command."""
    monkeypatch.setitem(COMMANDS, "toy", TOY)
    monkeypatch.setitem(commands.OPTIONS, "toy", TOY_OPTIONS)
    return lambda *args: camcal("toy", *args)


@pytest.fixture
def resolved(toy):
    """Return the resolved options of the toy command, `{name: {value, from}}`."""

    def options(*args):
        code, out, err = toy("show", *args)
        assert code == 0, err
        return json.loads(out)

    return options


@pytest.fixture
def report(camcal):
    """The report of the sample pictures."""
    code, _, err = camcal(
        "checkerboard", SAMPLES / "board", "--square", "25mm", "-o", "r.yaml", "--no-crosscheck"
    )
    assert code == 0, err
    return "r.yaml"
