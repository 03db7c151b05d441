"""Coverage-guided fuzzing over every reader: few inputs here, as many as are asked for on demand."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hardening.readers import subjects

pytest.importorskip("atheris", reason="atheris has wheels for Linux on x86-64")

from tests.hardening.guided import RUNS

ROOT = Path(__file__).resolve().parents[2]


def guided(*args):
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.hardening.guided", *args]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)


def test_every_reader():
    done = guided()
    assert done.returncode == 0, done.stdout + done.stderr
    lines = [line.rsplit(",", 2) for line in done.stdout.splitlines()[:-1]]
    assert [name for name, _, _ in lines] == [s.name for s in subjects()]
    assert all(int(count) >= RUNS and ended == "passed" for _, count, ended in lines), lines
