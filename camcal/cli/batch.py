"""`camcal batch`: many calibrations in one run."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import click

from camcal.cli.options import options as options_of
from camcal.cli.options import origin_of
from camcal.cli.verbosity import note, verbosity_options

#: failed jobs that are named on the terminal; summary.csv has all
NAMED = 20
#: off a terminal, one line for each of so many parts of the jobs
LINES = 10


@click.command("batch")
@click.argument("source", metavar="FOLDER|JOBS.yaml")
@options_of("batch")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, source: str, output: str, **options: Any) -> int:
    """Calibrate many cameras or rigs: one report each, a summary of all, control charts of each type.

    FOLDER has a sub-folder of pictures, or a table of points, per camera; JOBS.yaml lists jobs, of rigs too,
    with individual options. Options given here apply to every job that does not set them. A job that fails does
    not stop the others. The exit code is 1 if a job or one of its gates failed.
    """
    from camcal.batch.ci import checks, markdown
    from camcal.batch.fleet import LEAST, controls, csv_text, with_fleet
    from camcal.batch.jobs import read_jobs
    from camcal.batch.page import counts, page, sentence
    from camcal.batch.prior import FOLDER as FLEET
    from camcal.batch.prior import write_fleet
    from camcal.batch.run import run
    from camcal.batch.storage import Storage, shown
    from camcal.cli.output import write_for_ci
    from camcal.data.writing import check_writable
    from camcal.detect.workers import usable_processors
    from camcal.report.ci import append_summary
    from camcal.system.text import counted

    if options["junit"] is not None:
        check_writable(options["junit"], options["force"])

    jobs = read_jobs(source, _given(ctx, options))
    rows = run(
        jobs,
        output,
        options["jobs"] or usable_processors(),
        options["scheduler"],
        options["resume"],
        options["force"],
        Progress(),
    )
    charts = controls(rows)
    rows = with_fleet(rows, charts)
    storage = Storage(output)
    storage.write("summary.csv", csv_text(rows))
    storage.write("summary.html", page(rows, charts))
    if options["fleet_prior"] or any(job.options.get("fleet_prior") for job in jobs):
        written = write_fleet(rows, storage)
        note(f"{counted(written, 'camera')} with the prior of their type: {shown(output)}/{FLEET}")
        if written < len(rows):
            note(
                f"  A prior needs {LEAST} cameras of one type with the same model, as `--model opencv5` gives it."
            )
    if options["junit"] is not None or options["annotations"]:
        write_for_ci("camcal batch", source, checks(rows, output), options)
    if options["summary"] is not None:
        append_summary(options["summary"], markdown(rows, source, output))
    numbers = counts(rows)
    note(sentence(numbers))
    _name_bad(rows)
    note(f"Reports, summary.csv and summary.html: {shown(output)}")
    fallen = numbers["failed"] or numbers["gate fallen"]
    return 1 if fallen or (options["fail_on_outlier"] and numbers["outlier"]) else 0


def _given(ctx: click.Context, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that were given for all jobs, by flag, environment or configuration."""
    return {name: value for name, value in options.items() if origin_of(ctx, name) != "default"}


def _name_bad(rows: Iterable[Mapping[str, Any]]) -> None:
    bad = 0
    for row in rows:
        said = [row["reason"], f"unlike its type: {row['outlier']}" if row["outlier"] else ""]
        if any(said):
            bad += 1
            if bad <= NAMED:
                note(f"  {row['name']}: {'; '.join(filter(None, said))}")
    if bad > NAMED:
        note(f"  and {bad - NAMED} more in summary.csv")


class Progress:
    """Shows the progress of the jobs with the remaining time: a bar on a terminal, otherwise a few lines."""

    def __init__(self) -> None:
        self.began = time.monotonic()
        self.first: int | None = None
        self.said = 0

    def __call__(self, row: Mapping[str, Any], done: int, total: int) -> None:
        """Process a row; `done` of `total` jobs have finished."""
        if self.first is None:
            self.first = done - 1  # those of an earlier run took no time
            self.said = self.first * LINES // total
        note(f"{row['name']}: {row.get('reason') or row['status']}", 1)
        part = done * LINES // total
        if part > self.said and total >= LINES:
            self.said = part
            passed = time.monotonic() - self.began
            left = passed / (done - self.first) * (total - done)
            note(f"{done} of {total} jobs, {_duration(left)} left.")


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return (
        f"{hours} h {minutes} min" if hours else f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    )
