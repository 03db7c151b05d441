"""`camcal watch` as a user sees it: it ends by itself or on ^C, and leaves a whole report."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import yaml

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data" / "board"
PICTURES = sorted(SAMPLES.glob("*.jpg"))


@contextmanager
def started(*args):
    process = start(*args)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def start(*args):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "camcal", "watch", *map(str, args)]
    return subprocess.Popen(command, env=env, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def test_once_is_a_calibration_with_advice(camcal):
    code, _, err = camcal("watch", SAMPLES, "--once", "-o", "w.yaml", "--board", "9x6")
    assert code == 0 and "Next: hold the target at the" in err
    assert camcal("checkerboard", SAMPLES, "-o", "c.yaml", "--board", "9x6")[0] == 0
    watched, alone = (yaml.safe_load(Path(name).read_text()) for name in ("w.yaml", "c.yaml"))
    assert watched["camera"] == alone["camera"] and watched["views"] == alone["views"]
    assert watched["options"]["board_shape"]["value"] == alone["options"]["board_shape"]["value"] == "auto"
    Path("empty").mkdir()
    assert camcal("watch", "empty", "--once", "-o", "e.yaml")[0] == 3
    assert camcal("watch", "absent", "-o", "e.yaml")[0] == 3
    for absent, said in (
        ("/dev/video99", "there is no camera '/dev/video99'"),
        ("0", "/dev/video0"),
        ("a.mp4", "there is no film 'a.mp4'"),
        ("/dev/null", "cannot be opened as a film or a camera"),
    ):
        code, _, err = camcal("watch", absent, "-o", "e.yaml")
        assert code == 3 and said in err and len(err.splitlines()) == 2
    assert camcal("watch", SAMPLES, "--once", "-o", "w.yaml")[0] == 2  # exists


def test_it_ends_when_the_camera_is_known(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    process = start(
        folder, "-o", tmp_path / "r.yaml", "--board", "9x6", "--target-px", "1000", "--serve", "0"
    )
    address = re.search(r"http://\S+", process.stderr.readline()).group()
    assert b"Waiting for the first picture" in urllib.request.urlopen(address).read()
    for path in PICTURES[:5]:
        shutil.copy(path, folder)
    said = process.communicate(timeout=120)[1]
    assert process.returncode == 0, said
    assert "next: hold the target" in said and "Worst uncertainty" in said
    report = yaml.safe_load((tmp_path / "r.yaml").read_text())
    assert report["crosscheck"] and report["verdict"] == "pass"
    assert (
        report["options"]["board_shape"]["value"] == "flat"
    )  # its target means the same from picture to picture


def test_an_interrupt_leaves_a_whole_report(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for path in PICTURES[:4]:
        shutil.copy(path, folder)
    report = tmp_path / "r.yaml"
    with started(folder, "-o", report, "--target-px", "1e-9", "--no-cache") as process:
        deadline = time.monotonic() + 120
        while not (report.exists() and len(yaml.safe_load(report.read_text())["views"]) == 4):
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 130 and "Interrupted" in said
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "work") == ["in", "r.yaml"]
