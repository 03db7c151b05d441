"""Help is complete, light, and answers a typing error with what was meant."""

import subprocess
import sys
from pathlib import Path

import click
import pytest

from camcal.cli import COMMANDS
from camcal.cli.reference import reference
from camcal.registry import load
from camcal.version import __version__

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"numpy", "scipy", "cv2", "matplotlib", "rich", "yaml"}


def loaded_by(*args):
    """Return the top-level packages that a command line imports."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "camcal", *args],
        capture_output=True, text=True, cwd=ROOT, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-400:]
    return {
        line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines() if "|" in line
    }


@pytest.mark.parametrize("args", [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)])
def test_help_loads_nothing_heavy(args):
    packages = loaded_by(*args)
    assert "click" in packages  # else the figures were not read
    assert not packages & HEAVY


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help(camcal, name):
    path, summary = COMMANDS[name]
    command = load(path)
    assert command.name == name
    assert command.help
    assert summary.endswith(".")
    assert [p.name for p in command.params if isinstance(p, click.Option) and not p.help] == []
    code, out, err = camcal(name, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"Usage: camcal {name}")


def test_help_lists_each_command(camcal):
    code, out, _ = camcal("--help")
    assert code == 0
    assert [name for name in COMMANDS if f"\n  {name} " not in out] == []
    assert max(map(len, out.splitlines())) <= 80


def test_nothing_asked(camcal):
    code, out, err = camcal()
    assert (code, out) == (2, "")
    assert err.startswith("Usage: camcal")


def test_version(camcal):
    assert camcal("--version") == (0, f"camcal {__version__}\n", "")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["chekerboard"], "Error: unknown command 'chekerboard'.\n  Did you mean 'checkerboard'?\n"),
        (["xyz"], "Error: unknown command 'xyz'.\n  camcal --help lists the commands.\n"),
        (["stereo"], "Error: unknown command 'stereo'.\n  Did you mean 'rig' (left=PICTURES right=PICTURES)?\n"),
        (["dlt", "p"], "Error: unknown command 'dlt'.\n  Did you mean 'estimate --start dlt'?\n"),
        (["rig", "--left", "a"], "Error: unknown option '--left'.\n  camcal rig --help"),
        (["estimate", "--modle", "x"], "Error: unknown option '--modle'.\n  Did you mean '--model'?\n"),
        (["--quite"], "Error: unknown option '--quite'.\n  Did you mean '--quiet'?\n"),
        (["list", "modls"], "Error: KIND: 'modls' is not known here.\n  Did you mean 'models'?\n"),
        (["list"], "Error: KIND is missing.\n  camcal list --help shows what it takes.\n"),
        (["estimate", "-m", "opencv6", "p"], "Error: --model: unknown model 'opencv6'.\n  Did you"),
        (["estimate", "--optimizer", "lmm", "p"], "Error: --optimizer: unknown optimizer 'lmm'.\n  Did you"),
    ],
)  # fmt: skip
def test_did_you_mean(camcal, args, message):
    code, out, err = camcal(*args)
    assert (code, out) == (2, "")
    assert err.startswith(message)


def test_reference_is_current():
    """Renew it with `python -m camcal.cli.reference > docs/cli.md`."""
    assert (ROOT / "docs" / "cli.md").read_text(encoding="utf-8") == reference()


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_is_documented(name):
    by_hand = [ROOT / "README.md", *(p for p in (ROOT / "docs").glob("*.md") if p.name != "cli.md")]
    assert any(f"camcal {name}" in page.read_text(encoding="utf-8") for page in by_hand)


def test_exit_codes_are_the_same_everywhere():
    """README, the reference and the boundary name the same codes."""
    from camcal import errors
    from camcal.cli import boundary

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    codes = {c.exit_code for c in errors.CamcalError.__subclasses__()}
    for code in codes | {0, 1, boundary.BUG, boundary.INTERRUPTED, boundary.BROKEN_PIPE}:
        assert f"| {code} | " in reference()
        assert f"| {code} | " in readme
