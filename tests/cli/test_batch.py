"""`camcal batch` as a user sees it: reports, summary, exit codes, resume, a cluster that loses a worker."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from tests.batch.cameras import write_camera

QUICK = {"checks": False, "crosscheck": False, "robust": "none", "model": "pinhole", "image_size": "640x480"}


def write_jobs(count, **more):
    jobs = []
    for number in range(count):
        write_camera(f"c{number}.csv", number)
        jobs.append({"name": f"c{number}", "points": f"c{number}.csv", **QUICK, **more.get(f"c{number}", {})})
    Path("jobs.yaml").write_text(yaml.safe_dump({"jobs": jobs}))


def summary(out="out"):
    with (Path(out) / "summary.csv").open(newline="") as stream:
        return {row["name"]: row for row in csv.DictReader(stream)}


def test_gates_failures_and_resume(camcal):
    write_jobs(3, c1={"max_rms": 0.01})
    Path("c2.csv").write_text("nothing\n")
    code, out, err = camcal("batch", "jobs.yaml", "-o", "out", "-j", "1")
    assert (code, out) == (1, ""), err
    assert "3 jobs, 2 done, 1 failed, 1 passed, 1 gate fallen, 0 outliers." in err and "c2: " in err
    table = summary()
    assert [table[n]["status"] for n in table] == ["done", "done", "failed"]
    assert [table[n]["verdict"] for n in table] == ["pass", "fail", ""] and "rms_point" in table["c1"][
        "reason"
    ]
    assert sorted(p.name for p in Path("out").glob("*.*")) == [
        "c0.yaml",
        "c1.yaml",
        "summary.csv",
        "summary.html",
    ]
    report = yaml.safe_load(Path("out/c1.yaml").read_text())
    assert report["options"]["max_rms"] == {"value": 0.01, "from": "job"} and report["verdict"] == "fail"
    write_camera("c2.csv", 2)
    assert camcal("batch", "jobs.yaml", "-o", "out", "-j", "1")[0] == 2
    code, _, err = camcal("batch", "jobs.yaml", "-o", "out", "-j", "1", "--resume")
    assert code == 1 and "3 done, 0 failed" in err
    code, _, err = camcal("batch", "jobs.yaml", "-o", "new", "-j", "1", "--max-rms", "0.01")
    assert code == 1 and "3 gates fallen" in err


def test_a_prior_that_the_jobs_ask_for(camcal):
    """In JOBS.yaml as by the flag; two cameras are too few, which is said."""
    write_jobs(2, c0={"fleet_prior": True})
    code, _, err = camcal("batch", "jobs.yaml", "-o", "out", "-j", "1")
    assert code == 0 and "0 cameras with the prior of their type" in err and "A prior needs 8 cameras" in err


def test_the_report_is_that_of_a_single_run(camcal):
    write_camera("p.csv")
    Path("jobs.yaml").write_text(
        yaml.safe_dump({"jobs": [{"name": "p", "points": "p.csv", "model": "opencv4"}]})
    )
    assert camcal("batch", "jobs.yaml", "-o", "out", "--image-size", "640x480", "-j", "1")[0] == 0
    assert camcal("estimate", "p.csv", "-m", "opencv4", "--image-size", "640x480", "-o", "alone.yaml")[0] == 0
    batch, alone = (yaml.safe_load(Path(name).read_text()) for name in ("out/p.yaml", "alone.yaml"))
    assert list(batch) == list(alone)
    for key in ("camera", "views", "holdout", "warnings", "target"):
        assert batch[key] == alone[key]


def test_an_outlier_of_its_type(camcal):
    write_jobs(30)
    write_camera("c7.csv", 7, focal=700.0)
    code, _, err = camcal("batch", "jobs.yaml", "-o", "out", "-j", "2")
    assert code == 0 and "1 outlier." in err and "c7: unlike its type: focal -" in err
    assert "10 jobs" not in err and "27 of 30 jobs, " in err and "left." in err
    assert summary()["c7"]["outlier"].startswith("focal -")
    assert camcal("batch", "jobs.yaml", "-o", "out", "-j", "1", "--resume", "--fail-on-outlier")[0] == 1


def test_what_is_missing_is_named(camcal):
    write_jobs(1)
    code, _, err = camcal("batch", "jobs.yaml", "-o", "out", "--scheduler", "tcp://127.0.0.1:9")
    assert code == 2 and "dask" in err.lower() and not list(Path("out").glob("*.yaml"))
    assert camcal("batch", "absent", "-o", "out")[0] == 3
    code, _, err = camcal("batch", "jobs.yaml", "-o", "jobs.yaml")
    assert code == 2 and "it is a file" in err
    code, _, err = camcal("batch", "jobs.yaml", "-o", "-")
    assert code == 2 and "not a folder name" in err
    code, _, err = camcal("batch", "jobs.yaml", "-o", "out", "--scheduler", "nonsense")
    assert code == 2 and "Dask" in err and "Traceback" not in err


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_their_parent(number):
    """A batch of slow jobs is ended; no process that carries its mark is left."""
    write_jobs(16, **{f"c{n}": {"checks": True, "crosscheck": True} for n in range(16)})
    mark = f"CAMCAL_TEST_{time.time_ns()}"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1", "MARK": mark}
    command = [sys.executable, "-m", "camcal", "batch", "jobs.yaml", "-o", "out", "-j", "2"]
    process = subprocess.Popen(command, env=env, stderr=subprocess.DEVNULL)
    until(lambda: [*Path("out").glob("c*.yaml")])
    assert len(marked(mark)) >= 3
    process.send_signal(number)
    process.wait(30)
    until(lambda: not marked(mark))
    assert not [p for p in Path("out").glob("*.yaml") if not yaml.safe_load(p.read_text())["verdict"]]
    code = subprocess.run([*command, "--resume"], env=env, stderr=subprocess.DEVNULL).returncode
    assert code == 0 and len(summary()) == 16
    assert not [p.name for p in Path("out").rglob("*") if ".part" in p.name]


def marked(mark):
    """Processes whose environment holds a mark."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and mark.encode() in (entry / "environ").read_bytes():
                found.append(entry.name)
        except OSError:
            continue
    return found


def until(ready):
    end = time.monotonic() + 90
    while not (found := ready()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def test_a_cluster_that_loses_a_worker(tmp_path):
    if not os.environ.get("CI"):  # there it fails where Dask is missing: the extra [all] has it
        pytest.importorskip("distributed")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    started = []

    def start(*args):
        process = subprocess.Popen(
            [sys.executable, "-m", *args], env=env, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
        )
        started.append(process)
        return process

    write_jobs(24, **{f"c{n}": {"checks": True, "crosscheck": True} for n in range(24)})
    local = ("--host", "127.0.0.1", "--no-dashboard")
    try:
        start("dask", "scheduler", *local, "--port", "0", "--scheduler-file", "s.json")
        address = until(
            lambda: Path("s.json").exists() and json.loads(Path("s.json").read_text() or "{}").get("address")
        )
        workers = [
            start("dask", "worker", address, "--nthreads", "1", "--no-nanny", *local) for _ in range(2)
        ]
        run = start("camcal", "batch", "jobs.yaml", "-o", "out", "--scheduler", address)
        until(lambda: run.poll() is not None or len([*Path("out").glob("c*.yaml")]) >= 4)
        assert run.poll() is None
        workers[0].kill()
        said = run.communicate(timeout=120)[1].decode()
        assert run.returncode == 0, said
        assert {row["status"] for row in summary().values()} == {"done"} and len(summary()) == 24
    finally:
        for process in reversed(started):
            process.kill()
            process.wait(20)
            process.stderr.close()
