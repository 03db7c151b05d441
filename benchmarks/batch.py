"""Calibrations a second of `camcal batch`, beside plain cv2.

    python benchmarks/batch.py [--cameras 1000] [--write docs/batch-figures.md]

Simulated cameras of one type, 20 views of 9 x 6 points each, opencv5. Three ways to the same cameras:

* calibrations alone: points in memory, `camcal.calibrate(checks=False)` beside `cv2.calibrateCamera`;
* whole jobs: read a table, calibrate, write a report (`camcal batch`), beside np.loadtxt, cv2.calibrateCamera and a
  YAML file with the camera matrix and the distortion, in a process pool;
* the same with all checks, which cv2 has no counterpart of.

Each process has one thread. Rates are per second of processor time, which a busy machine does not change much; how
the work scales from one process to two is measured by the wall clock and needs a quiet machine.
"""

from __future__ import annotations

import argparse
import os

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
os.environ.update(dict.fromkeys(THREADS, "1"))

import csv  # noqa: E402 - the number of threads is read when numpy is loaded
import json  # noqa: E402
import multiprocessing  # noqa: E402
import platform  # noqa: E402
import resource  # noqa: E402
import shutil  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from concurrent.futures import ProcessPoolExecutor  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import yaml  # noqa: E402

import camcal  # noqa: E402
from camcal.batch.jobs import Job  # noqa: E402
from camcal.batch.run import MOST_IN_GROUP  # noqa: E402
from camcal.data.observations import Correspondences  # noqa: E402
from camcal.data.writing import write_points  # noqa: E402
from camcal.geometry import rotations  # noqa: E402
from camcal.model import lenses  # noqa: E402

VIEWS, SIZE = 20, (640, 480)
GRID = np.c_[np.mgrid[0:9, 0:6].T.reshape(-1, 2), np.zeros(54)]
#: jobs on a cluster of 1,000 workers
PLANNED, WORKERS = 100_000, 1000
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
def by_cv2(views: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, np.ndarray, np.ndarray]:
    xyz, uv = ([part.astype(np.float32) for part in parts] for parts in zip(*views, strict=True))
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(xyz, uv, SIZE, None, None)
    return rms, matrix, distortion


def by_camcal(views: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    return camcal.calibrate(Correspondences.from_views(views, SIZE), checks=False).rms_point


def alone(args: tuple[str, Sequence[int]]) -> tuple[float, float]:
    """Wall and processor seconds for some calibrations, points in memory."""
    name, seeds = args
    cv2.setNumThreads(1)
    data = [camera_views(seed) for seed in seeds]
    work: Callable = {"cv2": by_cv2, "camcal": by_camcal}[name]
    work(data[0])
    wall, processor = time.perf_counter(), time.process_time()
    for views in data:
        work(views)
    return time.perf_counter() - wall, time.process_time() - processor


def cv2_job(args: tuple[str, str]) -> float:
    """A whole job of plain cv2: table in, YAML out."""
    source, target = args
    cv2.setNumThreads(1)
    table = np.loadtxt(source, delimiter=",", skiprows=1, usecols=(1, 2, 3, 4, 5))
    views = [(part[:, :3], part[:, 3:]) for part in np.split(table, VIEWS)]
    rms, matrix, distortion = by_cv2(views)
    text = yaml.safe_dump({"rms": rms, "matrix": matrix.tolist(), "distortion": distortion.ravel().tolist()})
    Path(target).write_text(text)
    return rms


def children() -> float:
    """Processor seconds of all processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def in_pool(items: Sequence[tuple[str, str]], workers: int) -> tuple[float, float]:
    """Wall and processor seconds of whole jobs of cv2 in a plain process pool, its start included."""
    wall, processor = time.perf_counter(), children()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(cv2_job, items, chunksize=max(1, len(items) // (4 * workers))))
    return time.perf_counter() - wall, children() - processor


def by_batch(folder: Path, cameras: int, workers: int, **options: object) -> tuple[float, float]:
    """Wall and processor seconds of `camcal batch`, its start included."""
    jobs = [
        {"name": f"c{i}", "points": f"c{i}.csv", "image_size": "640x480", **options} for i in range(cameras)
    ]
    (folder / "jobs.yaml").write_text(yaml.safe_dump({"jobs": jobs}))
    shutil.rmtree(folder / "out", ignore_errors=True)
    command = [
        sys.executable,
        "-m",
        "camcal",
        "batch",
        folder / "jobs.yaml",
        "-o",
        folder / "out",
        "-j",
        workers,
        "-q",
    ]
    wall, processor = time.perf_counter(), children()
    subprocess.run([*map(str, command)], check=True)
    times = time.perf_counter() - wall, children() - processor
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
    text = figures(given.cameras)
    print(text)
    if given.write:
        given.write.write_text(text)


QUICK = {"model": "opencv5", "checks": False, "crosscheck": False, "robust": "none"}
#: what a job of `camcal batch` does -> options
WAYS: dict[str, dict[str, object]] = {
    "`checks: false`, `compact: true`": {**QUICK, "compact": True},
    "`checks: false`": QUICK,
    "all checks": {"model": "opencv5"},
}


def figures(count: int) -> str:
    """The page."""
    rows = []
    few = min(count, 200)
    reference = 0.0
    for name in ("cv2", "camcal"):
        wall, processor = alone((name, range(few)))
        with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
            both = max(w for w, _ in pool.map(alone, [(name, range(i, few, 2)) for i in range(2)]))
        reference = reference or few / processor
        rows.append(_row(f"calibrations alone, {name}", few / processor, reference, wall / both))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for seed in range(count):
            write_points(folder / f"c{seed}.csv", Correspondences.from_views(camera_views(seed), SIZE))
        items = [(str(folder / f"c{i}.csv"), str(folder / f"cv{i}.yaml")) for i in range(count)]
        one, _ = in_pool(items, 1)
        two, processor = in_pool(items, 2)
        reference = count / processor
        rows.append(_row("whole jobs, cv2 in a pool", reference, reference, one / two))
        seconds = {}
        for name, options in WAYS.items():
            some = count if "checks" in options else min(count, 50)
            one, _ = by_batch(folder, some, 1, **options)
            two, processor = by_batch(folder, some, 2, **options)
            seconds[name] = processor / some
            rows.append(_row(f"whole jobs, `camcal batch`, {name}", 1 / seconds[name], reference, one / two))
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    with tempfile.TemporaryDirectory() as place:
        parent = simulated(PLANNED, Path(place))
    return _page(rows, parent, memory, seconds["`checks: false`, `compact: true`"], count)


def _row(name: str, rate: float, reference: float, scaling: float) -> str:
    return f"| {name} | {rate:.1f} | {rate / reference:.2f} | {scaling:.2f} |"


PAGE = """# Batches, measured

Written by `python benchmarks/batch.py --cameras {count} --write docs/batch-figures.md`: simulated cameras of one type,
20 views of 54 points, opencv5, OpenCV {cv2}, numpy {numpy}, Python {python}, {processors} processors. The rate is per
second of processor time, in which a busy machine matters less; the last column, from the wall clock, is what a
second process gains: nothing to go by where the machine was busy with other work (load average {load:.1f} at the end).

| what | calibrations per processor second | beside cv2 | 2 processes over 1 |
|---|---|---|---|
{rows}

A whole job reads a table, calibrates and writes a report: with poses, sigmas, uncertainty maps and the data themselves,
with `compact: true` the camera with its sigmas, the error figures and the verdict. That of cv2 is np.loadtxt,
cv2.calibrateCamera and a YAML file with the camera matrix and the distortion. The start of the processes is included.

The largest process had {memory:.0f} MB.

## 100,000 jobs on 1,000 workers

The parent, measured with jobs that take no time: a file of 100,000 jobs is read and checked in {read:.1f} s; handing
them out, taking their rows and keeping the state takes {run:.1f} s ({overhead:.0f} µs a job), control charts,
summary.csv and summary.html ({html:.1f} MB) {summary:.1f} s of processor time. It has {memory_read:.0f} MB when
the jobs are read and {parent_memory:.0f} MB at most. No more than two groups of jobs for each worker are in flight.

On paper: at {job:.1f} ms a job (`checks: false`, `compact: true`), 100,000 jobs are {hours:.2f} processor hours,
{work:.1f} s on 1,000 workers. Jobs travel in groups of up to {group} ({tasks:,.0f} tasks), which at about 1 ms a
task is {scheduler:.0f} s for the scheduler; without groups it would need {alone:.0f} s.
"""


def _page(rows: list[str], parent: dict[str, float], memory: float, job: float, count: int) -> str:
    tasks = PLANNED / MOST_IN_GROUP
    return PAGE.format(
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
