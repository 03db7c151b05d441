"""Jobs, in any process: read, calibrate, write the report, and summarise it in a row."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from camcal.batch.jobs import CAMERAS, INTRINSICS, POINTS, Job, options_of
from camcal.batch.rows import Row
from camcal.batch.storage import Storage, address_of, local_copies
from camcal.batch.summary import FAILED, for_prior, summary_row
from camcal.errors import CamcalError, only
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions
from camcal.settings.kinds import is_report
from camcal.settings.option import readable
from camcal.settings.rig import RigOptions, split_camera
from camcal.system.text import readable as text_of

if TYPE_CHECKING:
    from camcal.data.observations import Observations
    from camcal.plan.solution import RigSolution, Solution

T = TypeVar("T")

#: Reports that are written at a time: a disk that is asked to keep a file (fsync) takes .4 to 5 ms, as long as a quick
#: calibration, and other files need not wait for that
WRITERS = 8
JOB = "job"  #: the entry among the options of a report that holds the digest of its job


def run_jobs(jobs: Sequence[Job], out: str) -> list[Row]:
    """Run some jobs; return their rows once all reports are on disk.

    Jobs of points with the same options are calibrated together, the others one by one, each of which has its report
    before the next begins.
    """
    storage = Storage(out)
    ahead = _together(jobs) if len(jobs) > 1 else {}
    rows: list[Row] = [
        {
            "name": j.name,
            "type": j.type,
            "digest": j.digest,
            "seconds": ahead[j.name].seconds if j.name in ahead else 0.0,
        }
        for j in jobs
    ]
    both = list(zip(jobs, rows, strict=True))
    batches = [[pair for pair in both if pair[0].name in ahead]]
    batches += [[pair] for pair in both if pair[0].name not in ahead]
    with ThreadPoolExecutor(WRITERS) as writers:
        for some in batches:
            for job, row, text in _reported(some, ahead):
                writers.submit(_keep, job, row, text, storage)
    return rows


def _reported(some: Sequence[tuple[Job, Row]], ahead: dict[str, _Ahead]) -> list[tuple[Job, Row, str]]:
    """The texts of the reports of the jobs that do not fail; their figures are added to their rows.

    Each step is made for all jobs before the next: a step whose code and tables are in the cache takes two thirds of
    the time.
    """
    from camcal.report.yaml import dump_yaml

    reports = [(job, row, _step(job, row, _report, job, ahead.pop(job.name, None))) for job, row in some]
    made = [(job, row, report) for job, row, report in reports if report is not None]
    for job, row, report in made:
        _step(job, row, _summarise, row, job, *report)
    texts = [(job, row, _step(job, row, dump_yaml, report[0])) for job, row, report in made]
    return [(job, row, text) for job, row, text in texts if text is not None]


def _step(job: Job, row: Row, work: Callable[..., T], *args: Any) -> T | None:
    """The result of a step of a job, whose time is added to the row; None if the job fails or has failed."""
    if row.get("status") == FAILED:
        return None
    began, found = time.perf_counter(), None
    with _failures_in(row, job):
        found = work(*args)
    row["seconds"] = round(row["seconds"] + time.perf_counter() - began, 4)
    return found


def _summarise(row: Row, job: Job, report: dict[str, Any], solution: Any) -> None:
    """Add the figures of a finished job to its row."""
    row |= summary_row(report)
    if job.options.get("fleet_prior"):
        row |= for_prior(report, solution)


class _Input(NamedTuple):
    """The input of a job: its sources and the local paths of these, all its options, the data and how to calibrate."""

    sources: Sequence[str]
    paths: Sequence[str]
    values: dict[str, Any]
    data: Observations
    options: dict[str, Any]


class _Ahead(NamedTuple):
    """A job that was calibrated together with others, and its share of the time, s."""

    read: _Input
    solution: Solution | CamcalError
    seconds: float


def _together(jobs: Sequence[Job]) -> dict[str, _Ahead]:
    """The solutions of jobs of points, those with the same options at once.

    A job that cannot be read, or whose group meets a bug, is left out: it is done by itself, where its failure is
    recorded.
    """
    from camcal.plan.calibrate import calibrate_many

    found: dict[str, _Ahead] = {}
    alike: dict[str, list[tuple[str, _Input, float]]] = {}
    for job in jobs:
        began = time.perf_counter()
        with suppress(Exception):
            if job.kind == POINTS:
                read = _read(job)
                alike.setdefault(repr(read.options), []).append((job.name, read, time.perf_counter() - began))
    for group in alike.values():
        began = time.perf_counter()
        with suppress(Exception):
            made = calibrate_many([read.data for _, read, _ in group], **group[0][1].options)
            share = (time.perf_counter() - began) / len(group)
            for (name, read, seconds), solution in zip(group, made, strict=True):
                found[name] = _Ahead(read, solution, seconds + share)
    return found


def _keep(job: Job, row: Row, text: str, storage: Storage) -> None:
    """Write the report of a job; if that is impossible, the job has failed."""
    with _failures_in(row, job):
        storage.write(f"{job.name}.yaml", text)


@contextmanager
def _failures_in(row: Row, job: Job) -> Iterator[None]:
    """Record any error in the row of a job instead of its figures; it must not stop the others."""
    try:
        yield
        return
    except CamcalError as error:
        reason = f"{error.message} {error.hint or ''}".strip()
    except MemoryError:
        reason = "there is not enough memory for this job."
    except OSError as error:
        reason = f"{error.filename or job.name}: {error.strerror or error}."
    except Exception as error:  # noqa: BLE001 - as above
        reason = f"a bug in camcal: {type(error).__name__}: {error}"
    kept = {name: value for name, value in row.items() if name in ("name", "type", "digest", "seconds")}
    row.clear()
    row |= kept | {"status": FAILED, "reason": text_of(reason)}


def _report(job: Job, ahead: _Ahead | None) -> tuple[dict[str, Any], Any]:
    """The report of a job, and its solution: of a camera or of a rig."""
    from camcal.report import document, rig

    if ahead is not None:
        sources, paths, values, _, _ = ahead.read
        solution: Any = only([ahead.solution])
    else:
        solution, sources, paths, values = _solved(job)
    described = {
        name: {"value": readable(value), "from": "job" if name in job.options else "default"}
        for name, value in values.items()
    }
    described[JOB] = {"value": job.digest, "from": "batch"}
    solution = replace(solution, options=described)
    form = rig if job.kind == CAMERAS else document
    make = form.compact_document if values["compact"] else form.document
    report = make(solution, command=["batch", job.name])
    for entry in report["inputs"]["files"]:
        entry["path"] = address_of(entry["path"], sources, paths)
    return report, solution


def _solved(job: Job) -> tuple[Any, Sequence[str], Sequence[str], dict[str, Any]]:
    """Calibrate a single job: its solution, its sources and their local paths, and all its options."""
    from camcal.plan.calibrate import calibrate

    if job.kind == POINTS:
        read = _read(job)
        return calibrate(read.data, **read.options), read.sources, read.paths, read.values
    values = _values(job)
    names, sources = zip(*(_split(job, source) for source in job.sources), strict=True)
    with local_copies(sources) as paths:
        if job.kind == CAMERAS:
            return _rig(names, paths, values), sources, paths, values
        from camcal.detect.images import detect_images

        data, options = _posed(detect_images(paths, **_search(values)), values)
        options["refine_points"] = values["refine_corners"]
        return calibrate(data, **options), sources, paths, values


def _values(job: Job) -> dict[str, Any]:
    """All options of a job."""
    return {name: option.default for name, option in options_of(job.kind).items()} | dict(job.options)


def _read(job: Job) -> _Input:
    """Read a table of points."""
    from camcal.data.points import read_points

    values = _values(job)
    with local_copies(job.sources) as paths:
        data = read_points(*paths, image_size=values["image_size"])
    return _Input(job.sources, paths, values, *_posed(data, values))


def _posed(data: Observations, values: dict[str, Any]) -> tuple[Observations, dict[str, Any]]:
    """The data on their board, and the options of the calibration, as of `camcal checkerboard` and `camcal
    estimate`.
    """
    options = {name: values[name] for name in CalibrationOptions.options()}
    options["board_shape"] = options["board_shape"] or data.usual_board_shape
    data = _on_board(data, options)
    if is_report(options["board_shape"]):
        options["board_shape"] = "flat"
    return data, options


def _split(job: Job, source: str) -> tuple[str, str]:
    """The camera of a source ("" for a table or a single camera), and the source itself."""
    pair = split_camera(source) if job.kind == CAMERAS else None
    return pair or ("", source)


def _search(values: dict[str, Any]) -> dict[str, Any]:
    return {name: values[name] for name in DetectionOptions.options() if name != "jobs"} | {"jobs": 1}


def _rig(names: Sequence[str], paths: Sequence[str], values: dict[str, Any]) -> RigSolution:
    """Read the data and calibrate as `camcal rig` does."""
    from camcal.data.rig_table import RigViews, read_rig
    from camcal.plan.rig import calibrate_rig

    options = {name: values[name] for name in RigOptions.options() if name != "cameras"}
    options["cameras"] = values[INTRINSICS]
    pictures = all(names)
    if pictures:
        from camcal.detect.rig_images import detect_rig

        folders: dict[str, list[str]] = {}
        for name, path in zip(names, paths, strict=True):
            folders.setdefault(name, []).append(path)
        views = detect_rig(folders, **_search(values))
    else:
        views = RigViews.of(read_rig(paths[0], values["image_size"]))
    options["board_shape"] = options["board_shape"] or views.usual_board_shape
    parts = {name: _on_board(part, options) for name, part in views.parts.items()}
    if is_report(options["board_shape"]):
        options["board_shape"] = "flat"
    refine_points = values["refine_corners"] if pictures else False
    return calibrate_rig(replace(views, parts=parts), refine_points=refine_points, **options)


def _on_board(data: Observations, options: dict[str, Any]) -> Observations:
    """The data on the board of a report, if `board_shape` names one."""
    if not is_report(options["board_shape"]):
        return data
    from camcal.report.board import on_known_board

    return on_known_board(data, options["board_shape"])
