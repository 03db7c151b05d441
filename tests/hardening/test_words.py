"""Hostile words: every option of every command that writes, with values that nobody should give.

The commands and options come from their tables. A few pairs of an option and a value here, one of 400;
`CAMCAL_WORDS=1 pytest tests/hardening/test_words.py` tries all.
"""

import os
import shutil
import zlib

import pytest

from camcal.settings.commands import OPTIONS
from tests.hardening.examples import EXAMPLES
from tests.hardening.test_faults import OUT, digests, fresh, server  # noqa: F401 - a fixture

#: one of so many pairs of an option and a value is tried
SHARE = int(os.environ.get("CAMCAL_WORDS", "400"))
VALUES = [
    "", " ", "-1", "0", "1", "2", "nan", "inf", "1e400", "1e-320", "9" * 400, "999999999", "0x0", "1x1", "-5x-5",
    "99999x99999", "640x480x3", "a" * 5000, "\x1b[31m\u202e", "\udcff", "../../x", "/", "/dev/zero", "/dev/null",
    "/proc/self/mem", "absent.yaml", "loop", "zero.yaml", "p.csv", "r.yaml", "rig.yaml", "jobs.yaml", "board", "=",
    "left=", "=left", "left=left=1", "fx=nan", "fx=-1", "k1=1e300", "k1,k1", ",,", ";", "[", "{", "*", "**", "[a-",
    "auto", "none", "select", "flat", "opencv4:9", "pinhole:1:2", "checkerboard:0x0", "checkerboard:9x6:1e300m", "file:///x",
    "memory://x", "http://127.0.0.1:9/x", "tcp://127.0.0.1:9",
]  # fmt: skip
#: `--serve` answers until ^C, `--scheduler` waits for a cluster, these show a page or write to where a name says
LEFT_OUT = ("help", "serve", "scheduler")


def pairs(command):
    """(flag, value) of every option of a command: a share of them that is the same in each run."""
    for option in OPTIONS[command]:
        if option.name in LEFT_OUT or not option.on_command_line:
            continue
        flag = option.flag or f"--{option.name.replace('_', '-')}"
        for value in VALUES:
            chance = zlib.crc32(f"{command} {flag} {value}".encode("utf-8", "replace"))
            if chance % SHARE == 0:
                yield flag, value


@pytest.mark.parametrize("command", EXAMPLES)
def test_an_answer_whatever_is_asked(made, tmp_path, server, command):  # noqa: F811
    words = [*command.split(), *(w.replace("OUT", OUT) for w in EXAMPLES[command])]
    folder = tmp_path / "work"
    shutil.copytree(made, folder)
    (folder / "loop").symlink_to("loop")
    (folder / "zero.yaml").symlink_to("/dev/zero")
    before = digests(folder)
    wrong = []
    for flag, value in pairs(command):
        fresh(folder)
        done = server(folder, [*words, flag, value])
        lines = [x for x in done["said"].splitlines() if x.startswith("Error:")]
        fine = done["code"] in (0, 1) or (done["code"] in (2, 3, 4) and len(lines) == 1)
        if not fine or "Traceback" in done["said"] or "\x1b" in done["said"] or "\u202e" in done["said"]:
            wrong.append((flag, value[:40], done["code"], done["said"][-300:]))
    changed = {name for name, digest in digests(folder).items() if before.get(name, digest) != digest}
    assert not wrong and not changed - {f"{OUT}/precious"}, (wrong, changed)
