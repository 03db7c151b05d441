"""A full disk, an error of the disk, SIGKILL and SIGTERM at accesses to the disk, in every command that writes.

The commands come from the table of options. Quick by default: SIGKILL and one other fault, in turn, of each command;
`CAMCAL_FAULTS=all pytest tests/hardening/test_faults.py` takes every kind at every access.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from camcal.system.documents import parse_yaml
from tests.hardening.examples import EXAMPLES, runs, writing

ROOT = Path(__file__).resolve().parents[2]
ALL = os.environ.get("CAMCAL_FAULTS") == "all"
KINDS = ("full", "EIO", "kill", "terminate")
EXPECTED = {"full": {0, 1, 2, 3}, "EIO": {0, 1, 2, 3}, "kill": {-9}, "terminate": {143}}
OUT = "out"


def test_every_command_that_writes_has_an_example():
    assert [name for name in writing() if name not in EXAMPLES] == []


@pytest.fixture(scope="module")
def server():
    """Run command lines in forks: `server(folder, words, kind, at)`."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.hardening.server"]
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )

    def call(folder, words, kind="none", at=0):
        request = {"folder": str(folder), "args": words, "kind": kind, "at": at}
        process.stdin.write(json.dumps(request) + "\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline())

    yield call
    process.stdin.close()
    process.wait(30)


def whole(path):
    """Whether a file is there to its end."""
    data = path.read_bytes()
    kind = path.suffix
    if kind == ".yaml":
        return isinstance(parse_yaml(data.decode(), path), dict)
    if kind == ".npz":
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None
    ends = {
        ".html": b"</html>",
        ".svg": b"</svg>",
        ".png": b"IEND\xaeB`\x82",
        ".xml": b">",
        ".jpg": b"\xff\xd9",
    }
    return data.rstrip().endswith(ends[kind]) if kind in ends else data.endswith(b"\n")


def files(folder):
    return {p.relative_to(folder): p for p in folder.rglob("*") if p.is_file()}


def digests(folder):
    return {
        name: hashlib.sha256(p.read_bytes()).hexdigest()
        for name, p in files(folder).items()
        if name.parts[0] != OUT or name.parts[-1] == "precious"
    }


def fresh(folder):
    shutil.rmtree(folder / OUT, ignore_errors=True)
    (folder / OUT).mkdir()
    (folder / OUT / "precious").write_text("of somebody else\n")


def chosen(kind, count):
    """The accesses at which something happens: all on demand, else one for each kind of fault."""
    if ALL:
        return range(1, count + 1)
    return [{"full": (count + 1) // 2, "EIO": count, "kill": count // 2 + 1, "terminate": 1}[kind]]


def kinds_for(name):
    """All kinds on demand, else SIGKILL and one of the others, so that each meets a third of the commands."""
    others = [k for k in KINDS if k != "kill"]
    place = [n for n, _ in runs()].index(name)
    return KINDS if ALL else ("kill", others[place % len(others)])


def check_left(folder, done, kind, at):
    """Nothing half-written, nobody else's file touched, an exit code of the table, no traceback."""
    where = (kind, at, done)
    assert done["code"] in EXPECTED[kind], where
    assert "Traceback" not in done["said"] and "bug in camcal" not in done["said"], where
    lines = [x for x in done["said"].splitlines() if x.startswith("Error:")]
    if kind not in ("kill", "terminate") and done["code"] not in (0, 1):
        assert len(lines) == 1, where
    for name, path in files(folder / OUT).items():
        if path.name.endswith(".part"):
            assert kind == "kill", (name, where)
        elif path.suffix != ".csv" or "--state" not in done.get("words", ()):
            assert whole(path), (name, where)


@pytest.mark.parametrize("name", [name for name, _ in runs()])
def test_faults(made, tmp_path, server, name):
    words = [w.replace("OUT", OUT) for w in dict(runs())[name]]
    folder = tmp_path / "work"
    shutil.copytree(made, folder)
    fresh(folder)
    before = digests(folder)
    good = server(folder, words)
    assert good["code"] in (0, 1), good
    produced = set(files(folder / OUT))
    assert len(produced) > 1
    assert good["count"] > 0
    growing = "--state" in words
    tried = 0
    for kind in kinds_for(name):
        for at in chosen(kind, good["count"]):
            fresh(folder)
            done = server(folder, words, kind, at)
            if kind in ("kill", "terminate") and done["code"] in (0, 1) and done["count"] < at:
                continue  # fewer accesses than before: names are random, and a cache may be warm
            tried += 1
            check_left(folder, {**done, "words": words}, kind, at)
            assert digests(folder) == before, (kind, at)
            if kind == "kill":
                again = server(folder, [*words, *([] if growing else ["--force"])])
                assert again["code"] == good["code"], (kind, at, again)
                left = files(folder / OUT)
                assert {n for n in left if n.name.endswith(".part")} == set(), (kind, at)
                assert produced <= set(left), (kind, at)
    assert tried
    log = os.environ.get("CAMCAL_FAULTS_LOG")
    if log:
        with open(log, "a") as stream:  # noqa: PTH123
            stream.write(f"{name},{good['count']},{tried}\n")
