"""Each kind of failure has its exit code, one line, a hint, and no traceback."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOY_PROGRAM = (
    "from camcal.cli import COMMANDS; from camcal.settings.commands import OPTIONS;"
    "from tests.cli.conftest import TOY, TOY_OPTIONS; COMMANDS['toy'] = TOY; OPTIONS['toy'] = TOY_OPTIONS;"
    "from camcal.__main__ import main; main()"
)


def entry(*args, program=None, **kwargs):
    """Start camcal as a process of its own, through its real entry point."""
    how = ["-c", program] if program else ["-m", "camcal"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, *how, *args], text=True, env=environment, **kwargs)


def finished(*args, **kwargs):
    process = entry(*args, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, **kwargs)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.mark.parametrize(
    ("what", "code", "lines"),
    [
        ("camcal", 1, ["Error: a gate failed.", "  one thing to try", "  and another"]),
        ("usage", 2, ["Error: a contradiction.", "  leave one out"]),
        ("data", 3, ["Error: 2 images were found; 3 are needed."]),
        ("estimation", 4, ["Error: degenerate.", "  tilt the board"]),
        ("click", 2, ["Error: wrong use.", "  camcal toy --help shows what it takes."]),
        ("missing-file", 3, ["Error: there.csv: No such file or directory."]),
        ("interrupt", 130, ["Interrupted."]),
        ("abort", 130, ["Interrupted."]),
    ],
)
def test_expected_failures(toy, what, code, lines):
    assert toy(what) == (code, "", "\n".join(lines) + "\n")


@pytest.mark.parametrize("what", ["bug", "end-of-file", "nameless-os-error"])
def test_a_bug_is_one_line_and_a_log(toy, tmp_path, what):
    code, out, err = toy(what)
    (log,) = (tmp_path / "state" / "camcal").glob("*.log")
    assert code == 70
    assert out == ""
    assert err.count("\n") == 1
    assert "a bug in camcal" in err
    assert str(log) in err
    text = log.read_text()
    assert "Traceback" in text
    assert f"camcal toy {what}" in text
    assert "numpy" in text


@pytest.mark.parametrize("place", [("toy", "bug", "-vv"), ("-vv", "toy", "bug"), ("-v", "toy", "-v", "bug")])
def test_vv_shows_the_traceback(toy, camcal, place):
    code, _, err = camcal(*place)
    assert code == 70
    assert "Traceback" in err
    assert "ZeroDivisionError" in err


def test_a_bug_without_a_place_for_its_log(toy, tmp_path, monkeypatch):
    """The state folder cannot be made and neither can the others: the message says so."""
    (tmp_path / "file").write_text("")
    for name in ("XDG_STATE_HOME", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "file"))
    code, _, err = toy("bug")
    assert code == 70
    assert "no log could be written" in err


@pytest.mark.parametrize(
    ("what", "said"),
    [("memory", "there is not enough memory"), ("full", "the system refused: No space left on device")],
)
def test_what_the_system_refuses_is_no_bug(toy, tmp_path, what, said):
    code, _, err = toy(what)
    assert code == 3 and err.startswith(f"Error: {said}.")
    assert not (tmp_path / "state").exists()


def test_a_gate_that_fell(toy):
    assert toy("gate") == (1, "", "")


def test_real_entry_point_usage():
    code, out, err = finished("estimat")
    assert (code, out) == (2, "")
    assert err == "Error: unknown command 'estimat'.\n  Did you mean 'estimate'?\n"


def test_real_entry_point_data():
    code, out, err = finished("estimate", "absent.csv")
    assert (code, out) == (3, "")
    assert err.startswith("Error: ")
    assert "absent.csv" in err


def test_real_entry_point_bug():
    code, out, err = finished("toy", "bug", program=TOY_PROGRAM)
    assert (code, out) == (70, "")
    assert "a bug in camcal: ZeroDivisionError: division by zero" in err
    assert "Traceback" not in err


def test_interrupt_by_signal():
    process = entry(
        "toy", "sleep", program=TOY_PROGRAM, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=1
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "Interrupted.\n")


def test_reader_that_went_away():
    """`camcal list commands | head -0`: the reader is gone before anything is written."""
    read_end, write_end = os.pipe()
    os.close(read_end)
    process = entry("list", "commands", stdout=write_end, stderr=subprocess.PIPE)
    os.close(write_end)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (141, "")
