"""Man pages: one for camcal and one for each command, of all options, which groff reads without a complaint."""

import shutil
import subprocess

import pytest

from camcal.cli import COMMANDS
from camcal.cli.man import pages

PAGES = dict(pages())


def test_a_page_for_each_command():
    assert list(PAGES) == ["camcal.1", *(f"camcal-{name}.1" for name in COMMANDS)]
    for name, (_, summary) in COMMANDS.items():
        assert summary.rstrip(".").replace("-", "\\-") in PAGES[f"camcal-{name}.1"].split(".SH SYNOPSIS")[0]


def test_options_and_exit_codes():
    page = PAGES["camcal-rectify.1"]
    assert "\\fB\\-o, \\-\\-output\\fR \\fIFOLDER\\fR" in page and "Environment: CAMCAL_ALPHA." in page
    assert ".SH EXIT STATUS\n.TP\n0\ndone" in page and "\n.TP\n141\n" in page
    assert "camcal simulate rig" in PAGES["camcal-simulate.1"].replace("\\-", "-")


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not here")
def test_groff_reads_them():
    for name, text in PAGES.items():
        done = subprocess.run(
            ["groff", "-man", "-ww", "-Tascii", "-P-c", "-P-b", "-P-u", "-rLL=78n"],
            input=text,
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stderr) == (0, ""), name
        assert "NAME" in done.stdout
