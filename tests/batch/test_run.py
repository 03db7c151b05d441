"""Jobs over processes: failures, lost workers, what is kept, and what a second run does."""

import importlib
import multiprocessing.forkserver
import multiprocessing.util
import os
import re
import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import pytest
import yaml

from camcal.batch import executors
from camcal.batch import run as running
from camcal.batch.executors import Local
from camcal.batch.jobs import Job, read_jobs
from camcal.batch.run import run
from camcal.batch.work import run_jobs
from camcal.errors import UsageError

from .cameras import write_camera

QUICK = {"checks": False, "crosscheck": False, "robust": "none", "model": "pinhole"}


def jobs_of(tmp_path, count=3, **more):
    for number in range(count):
        write_camera(tmp_path / f"c{number}.csv", number)
    entries = [
        {"name": f"c{n}", "points": f"c{n}.csv", "image_size": "640x480", **QUICK, **more}
        for n in range(count)
    ]
    (tmp_path / "jobs.yaml").write_text(yaml.safe_dump({"jobs": entries}))
    return read_jobs(str(tmp_path / "jobs.yaml"))


class Here:
    """A pool that works in this process; `deadly` jobs lose their worker, `gone` ones only the first time."""

    lost = (BrokenProcessPool,)
    count = 2

    def __init__(self, deadly=(), gone=()):
        self.executor, self.deadly, self.gone = self, set(deadly), set(gone)
        self.groups, self.restarts, self.closed = [], 0, None

    def submit(self, function, jobs, out):
        self.groups.append([job.name for job in jobs])
        future = Future()
        names = {job.name for job in jobs}
        if names & (self.deadly | self.gone):
            self.gone -= names
            future.set_exception(BrokenProcessPool())
        else:
            future.set_result([{"name": job.name, "status": "done", "seconds": 0.001} for job in jobs])
        return future

    def restart(self):
        self.restarts += 1

    def close(self, done):
        self.closed = done


def named(count):
    return [Job(f"j{n}", "points", ("p",), {}) for n in range(count)]


def test_a_job_that_ends_its_process_fails_alone():
    pool = Here(deadly=["j3"], gone=["j5"])
    rows = {row["name"]: row for row in running._rows(named(40), "out", pool)}
    assert len(rows) == 40
    assert [n for n, row in rows.items() if row["status"] == "failed"] == ["j3"]
    assert "process was ended" in rows["j3"]["reason"] and pool.closed is True


def test_short_jobs_go_in_groups_that_shrink_to_the_end():
    pool = Here()
    assert len(list(running._rows(named(2000), "out", pool))) == 2000
    sizes = [len(group) for group in pool.groups]
    assert sizes[0] == 1 and max(sizes) == running.MOST_IN_GROUP and sizes[-1] == 1


def test_jobs_of_pictures_do_not_go_in_groups_of_the_size_of_those_of_points():
    """A thousand quick jobs before them: a group of fifty of these would have no report for minutes."""

    class Mixed(Here):
        def submit(self, function, jobs, out):
            assert len({job.kind for job in jobs}) == 1
            future = super().submit(function, jobs, out)
            seconds = 0.001 if jobs[0].kind == "points" else running.GROUP / 2.5
            for row in future.result():
                fails = row["name"] in ("k0", "k7")  # at once
                row |= {"seconds": 0.001, "status": "failed"} if fails else {"seconds": seconds}
            return future

    pool = Mixed()
    jobs = named(1000) + [Job(f"k{n}", "images", ("p",), {}) for n in range(40)]
    assert len(list(running._rows(jobs, "out", pool))) == 1040
    sizes = {kind: [len(g) for g in pool.groups if g[0][0] == kind] for kind in "jk"}
    assert max(sizes["j"]) == running.MOST_IN_GROUP and max(sizes["k"]) == 2 and sizes["k"][0] == 1


def test_what_is_in_flight_is_bounded():
    taken = []

    def jobs():
        for job in named(1000):
            taken.append(job.name)
            yield job

    class Slow(Here):
        def submit(self, function, jobs, out):
            assert len(self.groups) - self.finished <= running.AHEAD * self.count
            return super().submit(function, jobs, out)

        @property
        def finished(self):
            return len(self.groups) - running.AHEAD * self.count if len(self.groups) > 4 else 0

    assert len(list(running._rows(jobs(), "out", Slow()))) == 1000


def test_a_stopped_run_ends_its_pool():
    pool = Here()
    rows = running._rows(named(5), "out", pool)
    next(rows)
    rows.close()
    assert pool.closed is False


def test_reports_rows_and_a_second_run(tmp_path):
    jobs = jobs_of(tmp_path)
    out = str(tmp_path / "out")
    seen = []
    rows = run(jobs, out, workers=2, on_row=lambda row, done, total: seen.append((done, total)))
    assert [row["name"] for row in rows] == ["c0", "c1", "c2"] and {row["status"] for row in rows} == {"done"}
    assert sorted(seen) == [(1, 3), (2, 3), (3, 3)]
    assert all(abs(row["focal"] - 800) < 5 * row["sigma_focal"] for row in rows)
    assert abs(rows[0]["distortion"]) < 1e-6  # a pinhole
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*.yaml")}
    with pytest.raises(UsageError, match="3 reports of these jobs"):
        run(jobs, out)
    assert run(jobs, out, resume=True, on_row=lambda *_: pytest.fail("repeated")) == rows
    assert before == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*.yaml")}
    again = run(jobs, out, force=True)
    assert [row["focal"] for row in again] == [row["focal"] for row in rows]


def test_what_is_not_noted_is_read_from_the_reports(tmp_path):
    jobs = jobs_of(tmp_path)
    out = tmp_path / "out"
    rows = run(jobs, str(out))
    for path in (out / running.STATE).iterdir():
        path.unlink()
    (out / "c1.yaml").write_text("half a rep")
    done = []
    again = run(jobs, str(out), resume=True, on_row=lambda row, *_: done.append(row["name"]))
    assert done == ["c1"]
    without = [{k: v for k, v in row.items() if k != "seconds"} for row in rows]
    assert [{k: v for k, v in row.items() if k != "seconds"} for row in again] == without


def test_changed_and_failed_jobs_are_done_again(tmp_path):
    jobs = jobs_of(tmp_path)
    out = str(tmp_path / "out")
    (tmp_path / "c2.csv").rename(tmp_path / "away.csv")
    rows = run(jobs, out)
    assert [row["status"] for row in rows] == ["done", "done", "failed"] and "no such file" in rows[2][
        "reason"
    ]
    (tmp_path / "away.csv").rename(tmp_path / "c2.csv")
    changed = jobs_of(tmp_path)
    changed[0] = Job("c0", "points", changed[0].sources, {**changed[0].options, "model": "opencv4"})
    done = []
    rows = run(changed, out, resume=True, on_row=lambda row, *_: done.append(row["name"]))
    assert sorted(done) == ["c0", "c2"] and rows[0]["model"] == "opencv4"
    assert {row["status"] for row in rows} == {"done"}


def test_every_kind_of_error_is_a_row(tmp_path, monkeypatch):
    (job,) = jobs_of(tmp_path, 1)
    for error in (RuntimeError("boom"), MemoryError(), OSError(28, "No space left on device", "x")):

        def fail(*args, error=error, **kwargs):
            raise error

        monkeypatch.setattr("camcal.plan.calibrate.calibrate", fail)
        (tmp_path / "out").mkdir(exist_ok=True)
        (row,) = run_jobs([job], str(tmp_path / "out"))
        assert row["status"] == "failed" and row["reason"]
    assert not list((tmp_path / "out").iterdir())


def test_the_same_over_fsspec(tmp_path):
    pytest.importorskip("fsspec")
    jobs = jobs_of(tmp_path, 2)
    remote = [Job(j.name, j.kind, tuple(f"file://{s}" for s in j.sources), j.options) for j in jobs]
    local = run(jobs, str(tmp_path / "local"))
    rows = run(remote, f"file://{tmp_path}/remote")
    assert [row["focal"] for row in rows] == [row["focal"] for row in local]
    assert sorted(p.name for p in (tmp_path / "remote").iterdir()) == sorted(
        p.name for p in (tmp_path / "local").iterdir()
    )
    run(remote, f"file://{tmp_path}/remote", resume=True, on_row=lambda *_: pytest.fail("repeated"))
    missing = Job("x", "points", (f"file://{tmp_path}/absent.csv",), jobs[0].options)
    (row,) = run([missing], f"file://{tmp_path}/remote2")
    assert row["status"] == "failed" and "no such file" in row["reason"]
    report = yaml.safe_load((tmp_path / "remote" / "c0.yaml").read_text())
    assert [f["path"] for f in report["inputs"]["files"]] == [f"file://{tmp_path}/c0.csv"]  # not of the copy


class Refusing:
    """A file system that answers every question with an error of its own."""

    def __getattr__(self, name):
        def refuse(*args, **kwargs):
            raise RuntimeError("Access Denied, of ssh://me:secret@host/x")

        return refuse


def test_what_a_remote_file_system_refuses(monkeypatch):
    """Its errors are the user's, in one line, and passwords are shown to nobody."""
    from camcal.batch import storage
    from camcal.errors import DataError

    pytest.importorskip("fsspec")
    monkeypatch.setattr("fsspec.core.url_to_fs", lambda address: (Refusing(), "x"))
    place = storage.Storage("s3://key:secret@host/x")
    for call in (place.make, lambda: place.write("a", ""), lambda: place.read("a"), place.names):
        with pytest.raises(DataError, match="cannot be") as caught:
            call()
        assert "secret" not in caught.value.message and "Access Denied" in caught.value.message
    monkeypatch.setattr("fsspec.core.url_to_fs", Refusing().anything)
    with pytest.raises(UsageError, match="Access Denied"):
        storage.Storage("ssh://host/x")


def test_places_that_cannot_hold_reports(monkeypatch):
    pytest.importorskip("fsspec")
    from camcal.batch import storage
    from camcal.errors import UsageError

    with pytest.raises(UsageError, match="memory of one process"):
        storage.Storage("memory://x/out")

    def incomplete(address):
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr("fsspec.core.url_to_fs", incomplete)
    with pytest.raises(UsageError, match="Install s3fs") as caught:
        storage.Storage("s3://bucket/x")
    assert "along with camcal" in caught.value.hint


def test_what_workers_begin_with_can_be_imported():
    """The server of the workers passes over a module that is missing, without a word."""
    for name in executors.NEEDED:
        importlib.import_module(name)


def deadly(jobs, out):
    """Stand for `run_jobs` in a worker: some jobs take their process with them."""
    if any(job.name == "j1" for job in jobs):
        os._exit(9)
    return [{"name": job.name, "status": "done", "seconds": 0.01} for job in jobs]


@pytest.mark.skipif(sys.platform == "win32", reason="processes end otherwise there")
def test_a_real_process_that_ends(monkeypatch):
    monkeypatch.setattr(running, "run_jobs", deadly)
    rows = {row["name"]: row["status"] for row in running._rows(named(6), "out", Local(2))}
    assert rows == {f"j{n}": "failed" if n == 1 else "done" for n in range(6)}


@pytest.mark.skipif(sys.platform != "linux", reason="a server process starts the workers on Linux alone")
def test_workers_start_where_the_folder_of_temporary_files_has_a_long_path(tmp_path, monkeypatch):
    """The socket of the server process would be there, and its path may have 107 bytes."""
    folder = tmp_path / ("x" * 120)
    folder.mkdir()
    assert executors._context().get_start_method() == "forkserver"
    server = multiprocessing.forkserver.ForkServer()
    monkeypatch.setattr(multiprocessing.forkserver, "ensure_running", server.ensure_running)
    monkeypatch.setattr(multiprocessing.util, "get_temp_dir", lambda: str(folder))
    assert executors._context().get_start_method() == "spawn"


def test_compact_reports_hold_the_same_camera(tmp_path):
    from camcal.report.loading import load_camera

    full = run(jobs_of(tmp_path, 1), str(tmp_path / "full"))
    jobs = jobs_of(tmp_path, 1, compact=True)
    small = run(jobs, str(tmp_path / "small"))
    assert {k: v for k, v in small[0].items() if k not in ("seconds", "digest")} == {
        k: v for k, v in full[0].items() if k not in ("seconds", "digest")
    }
    cameras = [load_camera(tmp_path / name / "c0.yaml") for name in ("full", "small")]
    assert cameras[0].params.tolist() == cameras[1].params.tolist()
    sizes = [(tmp_path / name / "c0.yaml").stat().st_size for name in ("full", "small")]
    assert sizes[1] < sizes[0] / 4
    for path in (tmp_path / "small" / running.STATE).iterdir():
        path.unlink()
    again = run(jobs, str(tmp_path / "small"), resume=True, on_row=lambda *_: pytest.fail("repeated"))
    assert again[0]["focal"] == small[0]["focal"] and again[0]["views"] == 6


def test_rigs(tmp_path):
    """Rigs are calibrated as by `camcal rig`, and compared by each camera and the distance."""
    from camcal import calibrate_rig, load
    from camcal.batch.fleet import controls, with_fleet
    from camcal.data.rig_table import read_rig
    from tests.hardening.inputs import _rig

    _rig(tmp_path)
    same = {
        "cameras": "rig.csv",
        "image_size": "640x480",
        "model": "pinhole",
        "checks": False,
        "crosscheck": False,
    }
    entries = [{"name": "whole", **same}, {"name": "small", "compact": True, **same}]
    (tmp_path / "jobs.yaml").write_text(yaml.safe_dump({"jobs": entries}))
    jobs = read_jobs(str(tmp_path / "jobs.yaml"))
    out = tmp_path / "out"
    rows = run(jobs, str(out))
    assert [row["status"] for row in rows] == ["done", "done"], rows
    alone = calibrate_rig(read_rig(tmp_path / "rig.csv", {"": (640, 480)}), model="pinhole", checks=False)
    for name in ("whole", "small"):
        rig = load(out / f"{name}.yaml")
        rig = getattr(rig, "rig", rig)
        assert rig.baseline("left", "right") == pytest.approx(alone.rig.baseline("left", "right"), abs=1e-9)
    assert (out / "small.yaml").stat().st_size < 0.4 * (out / "whole.yaml").stat().st_size
    assert [r["name"] for r in run(jobs, str(out), resume=True)] == ["whole", "small"]  # none is repeated
    # nine like it, and one whose right camera is turned away in focal length and in its place
    fleet = [{**rows[0], "name": f"r{i}"} for i in range(10)]
    parts, focal = fleet[9]["parts"], fleet[9]["parts"]["right"]["focal"]
    fleet[9] |= {"parts": {**parts, "right": {**parts["right"], "focal": focal + 500}}}
    fleet[9]["baselines"] = {"left-right": {"value": 2.0, "sigma": 0.01}}
    found = {row["name"]: row["outlier"] for row in with_fleet(fleet, controls(fleet)) if row["outlier"]}
    assert list(found) == ["r9"] and "right focal" in found["r9"] and "left-right" in found["r9"]
    assert "left focal" not in found["r9"]


def test_a_report_that_cannot_be_written_fails_its_job_alone(tmp_path, monkeypatch):
    from camcal.batch.storage import Storage

    write = Storage.write

    def full(self, name, text):
        if name == "c1.yaml":
            raise OSError(28, "No space left on device", name)
        write(self, name, text)

    monkeypatch.setattr(Storage, "write", full)
    rows = run_jobs(jobs_of(tmp_path), str(tmp_path))
    assert [row["status"] for row in rows] == ["done", "failed", "done"]
    assert "No space left" in rows[1]["reason"]
    assert sorted(p.name for p in tmp_path.glob("c?.yaml")) == ["c0.yaml", "c2.yaml"]


def test_jobs_of_a_group_are_the_jobs_of_their_own(tmp_path):
    """Alike jobs are calibrated together; one that fails, or has other options, does not change the others."""
    jobs = jobs_of(tmp_path, 5)
    (tmp_path / "c1.csv").write_text("view,X,Y,Z,u,v\n1,0,0,0,1,1\n")
    (tmp_path / "c3.csv").write_text("no table\n")
    jobs[4] = replace(jobs[4], options={**jobs[4].options, "skew": True})

    def reports(groups, out):
        (tmp_path / out).mkdir()
        rows = [row for group in groups for row in run_jobs(group, str(tmp_path / out))]
        texts = {path.name: _timeless(path.read_text()) for path in (tmp_path / out).iterdir()}
        return [{**row, "seconds": None} for row in rows], texts

    together, one_by_one = reports([jobs], "a"), reports([[job] for job in jobs], "b")
    assert together == one_by_one
    assert [row["status"] for row in together[0]] == ["done", "failed", "done", "failed", "done"]


def test_a_job_by_itself_has_its_report_before_the_next_begins(tmp_path, monkeypatch):
    """So that a kill does not lose the hours of a group; those calibrated together have theirs together."""
    from camcal.batch import work

    jobs = jobs_of(tmp_path, 5)
    jobs[1:3] = [replace(job, kind="images") for job in jobs[1:3]]
    there, own = [], work._solved

    def solved(job):
        there.append({path.name for path in (tmp_path / "out").glob("*.yaml")})
        return own(replace(job, kind="points"))

    monkeypatch.setattr(work, "_solved", solved)
    monkeypatch.setattr(work, "ThreadPoolExecutor", AtOnce)
    (tmp_path / "out").mkdir()
    rows = run_jobs(jobs, str(tmp_path / "out"))
    assert [row["name"] for row in rows] == [f"c{n}" for n in range(5)]
    assert {row["status"] for row in rows} == {"done"}
    assert there == [{"c0.yaml", "c3.yaml", "c4.yaml"}, {"c0.yaml", "c1.yaml", "c3.yaml", "c4.yaml"}]


class AtOnce:
    """A pool of threads that does everything when it is submitted."""

    def __init__(self, count):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, function, *args):
        function(*args)


def _timeless(report):
    return re.sub(r"seconds: \S+|date: .*", "", report)


def test_a_bug_in_a_group_is_met_job_by_job(tmp_path, monkeypatch):
    from camcal.plan import calibrate as plan

    def broken(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(plan, "calibrate_many", broken)
    (tmp_path / "out").mkdir()
    rows = run_jobs(jobs_of(tmp_path, 2), str(tmp_path / "out"))
    assert [row["status"] for row in rows] == ["done", "done"]
