"""Calibrations a second of `camcal batch`, beside plain cv2.

    python benchmarks/batch.py [--cameras 1000] [--write docs/batch-figures.md]

Simulated cameras of one type, 20 views of 9 x 6 points each, opencv5. Three ways to the same cameras:

* calibrations alone: points in memory, `camcal.calibrate(model="opencv5", checks=False)`, and `camcal.calibrate_many`
  with as many as a group of jobs has, beside `cv2.calibrateCamera`, and beside `cv2.calibrateCameraExtended`, which
  gives standard deviations as camcal does;
* whole jobs: read a table, calibrate, write a report (`camcal batch`), beside np.loadtxt, the function of cv2 and a
  YAML file with the camera matrix, the distortion and the standard deviations where there are any, in a process pool;
* the same with all checks, which cv2 has no counterpart of.

Each process has one thread. Rates are per second of processor time, which a busy machine changes less than the clock
on the wall. One and two workers take turns.
"""

from __future__ import annotations

import argparse
import os

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
os.environ.update(dict.fromkeys(THREADS, "1"))

import contextlib  # noqa: E402 - the number of threads is read when numpy is loaded
import csv  # noqa: E402
import ctypes  # noqa: E402
import json  # noqa: E402
import platform  # noqa: E402
import resource  # noqa: E402
import shutil  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import yaml  # noqa: E402
from batch_cv2 import SIZE, VIEWS, Views, by_cv2, by_cv2_with_sigmas  # noqa: E402
from batch_parts import parts, table  # noqa: E402

import camcal  # noqa: E402
from camcal.batch.jobs import Job  # noqa: E402
from camcal.batch.run import MOST_IN_GROUP  # noqa: E402
from camcal.data.observations import Correspondences  # noqa: E402
from camcal.data.writing import write_points  # noqa: E402
from camcal.geometry import rotations  # noqa: E402
from camcal.model import lenses  # noqa: E402

GRID = np.c_[np.mgrid[0:9, 0:6].T.reshape(-1, 2), np.zeros(54)]
#: jobs on a cluster of 1,000 workers
PLANNED, WORKERS = 100_000, 1000
PR_SET_CHILD_SUBREAPER = 36  #: of Linux's prctl
#: s; what a Dask scheduler needs for a task (its documentation says about 200 us to 1 ms)
TASK = 1e-3


def camera_views(seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points and images of a camera of the type, with 0.2 px of noise."""
    rng = np.random.default_rng(seed)
    lens = lenses.make("opencv5")
    focal = 800 + rng.normal(0, 4)
    params = np.array(
        [focal, focal, 320 + rng.normal(0, 3), 240 + rng.normal(0, 3), -0.2, 0.08, 1e-3, -5e-4, 0.0]
    )
    views = []
    while len(views) < VIEWS:
        rotation = rotations.exp(rng.uniform(-0.5, 0.5, 3))
        translation = np.array([-4.0, -2.5, 14]) + rng.uniform(-1, 1, 3) * [1, 1, 2]
        uv = lens.project(params, GRID @ rotation.T + translation)[0]
        if ((uv < 5) | (uv > np.array(SIZE) - 5)).any():  # a camera does not see those: the checks say so
            continue
        views.append((GRID, uv + rng.normal(0, 0.2, uv.shape)))
    return views


# ------------------------------------------------------------------------------------ what is compared
def by_camcal(views: Views) -> float:
    data = Correspondences.from_views(views, SIZE)
    return camcal.calibrate(data, model="opencv5", checks=False).rms_point


BARE: dict[str, Callable] = {
    "`cv2.calibrateCamera`": by_cv2,
    "`cv2.calibrateCameraExtended`": by_cv2_with_sigmas,
    "camcal": by_camcal,
}


def alone(count: int) -> dict[str, float]:
    """Processor seconds of a calibration by each of BARE, points in memory; they take turns."""
    cv2.setNumThreads(1)
    spent = dict.fromkeys(BARE, 0.0)
    for seed in range(-1, count):
        views = camera_views(max(seed, 0))
        for name, work in BARE.items():
            begin = time.process_time()
            work(views)
            spent[name] += (time.process_time() - begin) / count if seed >= 0 else 0.0
    grouped = sum(many(first, count) for first in range(0, count, MOST_IN_GROUP))
    spent[f"camcal, up to {MOST_IN_GROUP} at once"] = grouped / count
    return spent


def many(first: int, count: int) -> float:
    """Processor seconds of a group of calibrations from one of so many cameras on, points in memory."""
    views = [camera_views(seed) for seed in range(first, min(first + MOST_IN_GROUP, count))]
    begin = time.process_time()
    data = (Correspondences.from_views(v, SIZE) for v in views)
    found = camcal.calibrate_many(data, model="opencv5", checks=False)
    assert all(isinstance(f, camcal.Solution) for f in found)
    return time.process_time() - begin


def adopt_orphans() -> None:
    """Make the processes that a command leaves when it ends, such as the server of its workers, children of this one.

    Their time would be missing otherwise (Linux; elsewhere it is).
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def children() -> float:
    """Processor seconds of all processes that have ended, after the last of them has."""
    with contextlib.suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def in_pool(items: Sequence[tuple[str, str, bool]], workers: int, folder: Path) -> tuple[float, float]:
    """Wall and processor seconds of whole jobs of cv2 in a plain process pool, its start included."""
    (folder / "items.json").write_text(json.dumps(items))
    script = Path(__file__).with_name("batch_cv2.py")
    return _timed([sys.executable, script, folder / "items.json", workers])


def _timed(command: Sequence[object]) -> tuple[float, float]:
    """Wall and processor seconds of a command and all its processes."""
    processor, wall = children(), time.perf_counter()
    subprocess.run([*map(str, command)], check=True)
    wall = time.perf_counter() - wall
    return wall, children() - processor


def by_batch(folder: Path, cameras: int, workers: int, **options: object) -> tuple[float, float]:
    """Wall and processor seconds of `camcal batch`, its start included."""
    jobs = [
        {"name": f"c{i}", "points": f"c{i}.csv", "image_size": "640x480", **options} for i in range(cameras)
    ]
    (folder / "jobs.yaml").write_text(yaml.safe_dump({"jobs": jobs}))
    shutil.rmtree(folder / "out", ignore_errors=True)
    words = ["batch", folder / "jobs.yaml", "-o", folder / "out", "-j", workers, "-q"]
    command = [sys.executable, "-m", "camcal", *words]
    times = _timed(command)
    with (folder / "out" / "summary.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == cameras and {row["status"] for row in rows} == {"done"}
    return times


def _row_of(job: Job) -> dict[str, object]:
    """A row as a job returns it."""
    rng = np.random.default_rng(int.from_bytes(job.name.encode()[-4:], "big"))
    focal, cx, cy, bent = rng.normal([800, 320, 240, -5], [4, 3, 3, 0.1]).tolist()
    return {
        "name": job.name, "type": job.type, "digest": job.digest, "status": "done", "reason": "",
        "rms_point": 0.28 + 0.001 * rng.normal(), "verdict": "pass", "grade": "good", "warnings": "",
        "model": "opencv5", "image_size": "640x480", "views": 20, "points": 1080, "holdout": 0.29,
        "distortion": bent, "focal": focal, "sigma_focal": 0.5, "cx": cx, "sigma_cx": 0.5, "cy": cy,
        "sigma_cy": 0.5, "seconds": 0.01,
    }  # fmt: skip


class _Nothing:
    """A pool whose jobs take no time: what is left is the handing out."""

    lost = (RuntimeError,)
    count = 1

    class executor:
        @staticmethod
        def submit(function: Callable, jobs: Sequence[Job], out: str):
            from concurrent.futures import Future

            future: Future = Future()
            future.set_result([_row_of(job) for job in jobs])
            return future

    def restart(self) -> None: ...

    def close(self, done: bool) -> None: ...


def simulated(count: int, folder: Path) -> dict[str, float]:
    """Seconds and MB of the parent for so many jobs whose work takes no time: all but the calibrations, for real.

    A file of jobs is read, jobs are handed out and their rows kept, the state, the charts, summary.csv and
    summary.html are written. In a process of its own.
    """
    command = [sys.executable, __file__, "--simulate", str(count), "--folder", str(folder)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _simulated(count: int, folder: Path) -> dict[str, float]:
    from camcal.batch import fleet, page, run
    from camcal.batch.jobs import read_jobs
    from camcal.batch.storage import Storage

    spent: dict[str, float] = {}
    began = time.process_time()

    def lap(name: str) -> None:
        nonlocal began
        spent[name], began = time.process_time() - began, time.process_time()

    def memory() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    entries = [
        {"name": f"c{i:06d}", "points": f"c{i:06d}.csv", "image_size": "640x480"} for i in range(count)
    ]
    (folder / "jobs.json").write_text(json.dumps({"jobs": entries}))
    del entries
    began = time.process_time()
    jobs = read_jobs(str(folder / "jobs.json"))
    lap("read")
    spent["memory_read"] = memory()
    run.open_pool = lambda scheduler, workers: _Nothing()  # type: ignore[assignment, return-value]
    rows = run.run(jobs, str(folder / "out"))
    lap("run")
    charts = fleet.controls(rows)
    rows = fleet.with_fleet(rows, charts)
    storage = Storage(str(folder / "out"))
    storage.write("summary.csv", fleet.csv_text(rows))
    storage.write("summary.html", page.page(rows, charts))
    lap("summary")
    assert len(rows) == count and charts
    spent["memory"] = memory()
    spent["html"] = (folder / "out" / "summary.html").stat().st_size / 1e6
    return spent


# ------------------------------------------------------------------------------------ tables
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=1000)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--simulate", type=int, metavar="JOBS", help="only the parent of so many jobs")
    parser.add_argument("--folder", type=Path, default=Path(), help="where --simulate writes")
    given = parser.parse_args()
    if given.simulate:
        print(json.dumps(_simulated(given.simulate, given.folder)))
        return
    adopt_orphans()
    text = figures(given.cameras)
    print(text)
    if given.write:
        given.write.write_text(text)


QUICK = {"model": "opencv5", "checks": False, "crosscheck": False, "robust": "none"}
COMPACT = {**QUICK, "compact": True}
#: what a job of `camcal batch` does -> options
WAYS: dict[str, dict[str, object]] = {
    "`checks: false`, `compact: true`": COMPACT,
    "`checks: false`": QUICK,
    "all checks": {"model": "opencv5"},
}


SOME = 500  #: jobs for one worker and for two, in turns
#: way -> jobs at most: these take long, and their rate is known sooner
MOST = {"all checks": 200}


def figures(count: int) -> str:
    """The page."""
    bare = alone(min(count, 200))
    names = list(bare)
    of = bare[names[0]], bare[names[1]]
    rows = [_row(f"calibrations alone, {n}", min(count, 200), s, *of) for n, s in bare.items()]
    note("\n".join(rows))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for seed in range(count):
            write_points(folder / f"c{seed}.csv", Correspondences.from_views(camera_views(seed), SIZE))
        seconds, jobs = {}, dict[str, int]()
        for name, sigmas in (("a pool of cv2", False), ("a pool of cv2, with sigmas", True)):
            items = [(str(folder / f"c{i}.csv"), str(folder / f"cv{i}.yaml"), sigmas) for i in range(count)]
            seconds[name], jobs[name] = in_pool(items, 2, folder)[1] / count, count
        plain, full = seconds.values()
        for name, options in WAYS.items():
            key, some = f"`camcal batch`, {name}", min(count, MOST.get(name, count))
            seconds[key], jobs[key] = by_batch(folder, some, 2, **options)[1] / some, some
        rows += [_row(f"whole jobs, {n}", jobs[n], s, plain, full) for n, s in seconds.items()]
        note("\n".join(rows[len(bare) :]))
        turns = [[by_batch(folder, min(count, SOME), n, **COMPACT) for n in (1, 2)] for _ in range(3)]
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        spent = parts(folder, min(count, 100), SIZE)
    with tempfile.TemporaryDirectory() as place:
        parent = simulated(PLANNED, Path(place))
    job = seconds["`camcal batch`, `checks: false`, `compact: true`"]
    return _page(rows, parent, memory, job, count, table(spent, plain), np.array(turns))


def note(text: str) -> None:
    """What is known so far, for those who wait."""
    print(text, file=sys.stderr, flush=True)


def _row(name: str, jobs: int, seconds: float, plain: float, with_sigmas: float) -> str:
    return f"| {name} | {jobs} | {1 / seconds:.1f} | {plain / seconds:.2f} | {with_sigmas / seconds:.2f} |"


PAGE = """# Batches, measured

Written by `python benchmarks/batch.py --cameras {count} --write docs/batch-figures.md`: simulated cameras of one type,
20 views of 54 points, opencv5, seeds 0 to {last}, OpenCV {cv2}, numpy {numpy}, Python {python},
{processors} processors, load average {load:.1f} at the end, {date}. The rate is per second of processor
time, in which a busy machine matters less.

| what | jobs | calibrations per processor second | `calibrateCamera` = 1 | `calibrateCameraExtended` = 1 |
|---|---|---|---|---|
{rows}

A whole job reads a table, calibrates and writes a report: with poses, sigmas, uncertainty maps and the data
themselves; with `compact: true` the camera with its sigmas, the error figures and the verdict. That of cv2 is
np.loadtxt on the same table, the function of cv2, and a YAML file (by libyaml) with the camera matrix and the
distortion, and with the standard deviations of `calibrateCameraExtended`, by a script that imports nothing else
(`benchmarks/batch_cv2.py`). Two workers each; the start of all processes is included.

**One worker and two**, in turns, {turns} times {some} jobs with `compact: true`: a job takes {cpu_one:.1f} ms of
processor time with one worker and {cpu_two:.1f} ms with two (the least of each), so that on processors of their own
two do {cpu_gain:.2f} times the jobs of one. By the clock on the wall the best runs differ by a factor of
{wall_gain:.2f}, on processors that had other work as well.

The largest process had {memory:.0f} MB.

## Where the time goes

One process, means of {some_parts} jobs.

{parts}

## 100,000 jobs on 1,000 workers

The parent, measured with jobs that take no time: a file of 100,000 jobs is read and checked in {read:.1f} s; handing
them out, taking their rows and keeping the state takes {run:.1f} s ({overhead:.0f} µs a job), control charts,
summary.csv and summary.html ({html:.1f} MB) {summary:.1f} s of processor time. It has {memory_read:.0f} MB when
the jobs are read and {parent_memory:.0f} MB at most. No more than two groups of jobs for each worker are in flight.

On paper: at {job:.1f} ms a job (`checks: false`, `compact: true`), 100,000 jobs are {hours:.2f} processor hours,
{work:.1f} s on 1,000 workers. Jobs travel in groups of up to {group} ({tasks:,.0f} tasks), which at about 1 ms a
task is {scheduler:.0f} s for the scheduler; without groups it would need {alone:.0f} s.
"""


def _page(
    rows: list[str],
    parent: dict[str, float],
    memory: float,
    job: float,
    count: int,
    parts_of: str,
    turns: np.ndarray,
) -> str:
    """`turns` (T, 2, 2) are wall and processor seconds with one and with two workers."""
    tasks = PLANNED / MOST_IN_GROUP
    some = min(count, SOME)
    (wall_one, cpu_one), (wall_two, cpu_two) = turns.min(0)
    return PAGE.format(
        last=count - 1, date=time.strftime("%Y-%m-%d"), turns=len(turns), some=some,
        cpu_one=1e3 * cpu_one / some, cpu_two=1e3 * cpu_two / some, cpu_gain=2 * cpu_one / cpu_two,
        wall_gain=wall_one / wall_two, some_parts=min(count, 100), parts=parts_of,
        load=os.getloadavg()[0],
        count=count, cv2=cv2.__version__, numpy=np.__version__, python=platform.python_version(),
        processors=os.cpu_count(), rows="\n".join(rows), overhead=1e6 * parent["run"] / PLANNED, memory=memory,
        job=1e3 * job, read=parent["read"], run=parent["run"], summary=parent["summary"], html=parent["html"],
        memory_read=parent["memory_read"], parent_memory=parent["memory"],
        hours=PLANNED * job / 3600, work=PLANNED * job / WORKERS, group=MOST_IN_GROUP, tasks=tasks,
        scheduler=tasks * TASK, alone=PLANNED * TASK,
    )  # fmt: skip


if __name__ == "__main__":
    main()
