"""stdout and stderr, full, closed or of another encoding; signals. All through the real entry point."""

import io
import os
import signal
import subprocess
import sys
import time

import pytest

from camcal.errors import DataError
from camcal.system.streams import Outlet

RUN = f'{sys.executable} -m camcal "$@"'


def shell(line, *args, **environment):
    return subprocess.run(
        ["sh", "-c", line, "sh", *args],
        capture_output=True,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )


def test_what_an_encoding_lacks_is_replaced():
    raw = io.BytesIO()
    out = Outlet(io.TextIOWrapper(raw, "ascii"), "stdout")
    out.write("1 ± 2 █ \x1b[31m\udcff")
    out.flush()
    assert raw.getvalue() == rb"1 ? 2 ? ?[31m\xff"


def test_a_closed_stream():
    with pytest.raises(DataError, match="cannot write to stdout: it is closed"):
        Outlet(None, "stdout").write("x")
    Outlet(None, "stderr", lossy=True).write("x")


@pytest.mark.parametrize("line", [f"{RUN} >/dev/full", f"{RUN} >&-"])
@pytest.mark.parametrize("args", [("list", "models"), ("list", "models", "--format", "json"), ("--help",)])
def test_a_lost_result_is_no_success(line, args):
    done = shell(line, *args)
    assert done.returncode == 3
    assert done.stderr.startswith(b"Error: cannot write to stdout: ")


@pytest.mark.parametrize("line", [f"{RUN} 2>/dev/full", f"{RUN} 2>&-", f"{RUN} <&-"])
def test_lost_messages_do_not_matter(line):
    done = shell(line, "list", "models")
    assert done.returncode == 0
    assert b"opencv5" in done.stdout


def test_ascii():
    done = shell(RUN, "list", "warnings", PYTHONIOENCODING="ascii")
    assert done.returncode in (0, 2)
    assert done.stdout.isascii()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_asked_to_end(tmp_path, number, code):
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip("the tests run under nohup: the signal stays ignored")
    os.mkfifo(tmp_path / "frames.csv")
    arguments = [sys.executable, "-m", "camcal", "track", "frames.csv", "-o", "t.csv", "--state", "s"]
    process = subprocess.Popen(arguments, cwd=tmp_path, stderr=subprocess.PIPE)
    # a run that waits for its input
    end = time.monotonic() + 60
    while not (tmp_path / "s").exists() and time.monotonic() < end:
        time.sleep(0.05)
    process.send_signal(number)
    try:
        said = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    assert process.returncode == code
    assert b"Terminated." in said
    assert not [p.name for p in tmp_path.iterdir() if p.name.endswith(".part")]
