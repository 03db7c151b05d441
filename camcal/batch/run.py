"""Distribution of jobs, with resumption after a kill; a failed job does not stop the others.

What is done stands in OUT/batch-state: files of rows (JSON lines), each written in one piece, so that neither a
kill nor an object store without appending does harm. Reports that a killed run had not noted yet are read.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any

from camcal.batch.executors import Cluster, Local, open_pool
from camcal.batch.jobs import Job
from camcal.batch.rows import Row, Rows, packed
from camcal.batch.storage import Storage, shown
from camcal.batch.summary import DONE, FAILED, summary_row
from camcal.batch.work import JOB, run_jobs
from camcal.detect.workers import one_thread_each
from camcal.errors import CamcalError, UsageError
from camcal.system.documents import parse_yaml

STATE = "batch-state"
#: s; longest time between two writes of the state: after a kill the next run reads the reports written since
NOTED = 5.0
#: rows in a file of the state, at most
ROWS = 1000
#: tasks in flight for each worker: one running and one waiting
AHEAD = 2
#: s; short jobs are handed out in groups of about this length, by the clock, so that jobs of points come to groups of
#: 50 also on a machine with other work: a group costs 15 ms of processor time besides 7 ms a job
GROUP = 2.0
#: jobs in a group at most: those of a lost worker are repeated
MOST_IN_GROUP = 50

OnRow = Callable[[Row, int, int], Any]


class State:
    """The rows of finished jobs, in memory and in OUT/batch-state."""

    def __init__(self, storage: Storage):
        self.storage = storage
        self.rows: dict[str, bytes] = {}
        self._new: list[Row] = []
        self._files = 0
        self._written = time.monotonic()

    def load(self, jobs: Sequence[Job]) -> None:
        """Load the rows of jobs that finished with the present inputs and options; failed ones are repeated."""
        wanted = {job.name: (job.digest, job.type) for job in jobs}
        for name in sorted(self.storage.names(STATE)):
            text = self.storage.read(f"{STATE}/{name}") or ""
            self._files = max(self._files, int(name.partition(".")[0]) if name[:1].isdigit() else 0)
            for line in text.splitlines():
                # the jobs of damaged lines are repeated
                with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError):
                    self._take(json.loads(line), wanted)
        there = {name.removesuffix(".yaml") for name in self.storage.names() if name.endswith(".yaml")}
        for name in [name for name in self.rows if name not in there]:
            del self.rows[name]
        # a report lacks the covariances that a prior needs
        known = {job.name for job in jobs if not job.options.get("fleet_prior")}
        for name in sorted(there & known - set(self.rows)):
            row = self._from_report(name)
            if row is not None:
                self._take(row, wanted)

    def _take(self, row: Row, wanted: dict[str, tuple[str, str]]) -> None:
        digest, type_ = wanted.get(row["name"], (None, ""))
        if row["status"] == DONE and row["digest"] == digest:
            self.rows[row["name"]] = packed(row | {"type": type_})

    def _from_report(self, name: str) -> Row | None:
        """The row of a report that a killed run wrote but did not record; None if it is not a report of a batch."""
        try:
            report = parse_yaml(self.storage.read(f"{name}.yaml") or "", f"{name}.yaml", aliases=0)
            digest = report["options"][JOB]["value"]
            row = summary_row(report)
        except (CamcalError, AttributeError, KeyError, TypeError, ValueError):
            return None
        return {"name": name, "type": "", "digest": digest, "seconds": None, **row}

    def add(self, row: Row) -> None:
        """Add a new row; it is saved together with others."""
        self.rows[row["name"]] = packed(row)
        self._new.append(row)
        if len(self._new) >= ROWS or time.monotonic() - self._written > NOTED:
            self.save()

    def save(self) -> None:
        """Save new rows."""
        if self._new:
            self._files += 1
            text = "".join(json.dumps(row) + "\n" for row in self._new)
            self.storage.write(f"{STATE}/{self._files:06d}.jsonl", text)
        self._new, self._written = [], time.monotonic()


def run(
    jobs: Sequence[Job],
    out: str,
    workers: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    force: bool = False,
    on_row: OnRow = lambda row, done, total: None,
) -> Rows:
    """Run all jobs; return their rows in the order of the jobs.

    Parameters
    ----------
    jobs : sequence of Job
    out : str
        A folder or an address; it gets NAME.yaml for each job.
    workers : int
        Processes.
    scheduler : str, optional
        Address of a Dask cluster, instead of local processes.
    resume, force : bool
        What is done with reports that are there: those of finished jobs are kept, or all are replaced.
    on_row : callable
        Called with each row as it comes, and how many of how many jobs are done.

    Raises
    ------
    UsageError
        If there are reports of these jobs and neither `resume` nor `force`; where `out` cannot be written;
        where there is no cluster.
    """
    storage = Storage(out)
    _check_free(storage, jobs, resume or force)
    storage.make(STATE)
    state = State(storage)
    if resume:
        state.load(jobs)
    todo = [job for job in jobs if job.name not in state.rows]
    try:
        if todo:
            with one_thread_each():
                pool = open_pool(scheduler, min(workers, len(todo)))
                for row in _rows(todo, storage.root, pool):
                    state.add(row)
                    on_row(row, len(state.rows), len(jobs))
    finally:
        state.save()
    return Rows([state.rows[job.name] for job in jobs])


def _check_free(storage: Storage, jobs: Sequence[Job], allowed: bool) -> None:
    there = storage.names()
    taken = [job.name for job in jobs if f"{job.name}.yaml" in there]
    if taken and not allowed:
        raise UsageError(
            f"{shown(storage.root)} holds {len(taken)} report{'s' * (len(taken) > 1)} of these jobs already, "
            f"'{taken[0]}.yaml' among them.",
            "Continue with --resume, replace them with --force, or choose another folder.",
        )


def _rows(jobs: Iterable[Job], out: str, pool: Local | Cluster) -> Iterator[Row]:
    """The rows of jobs as they finish, in any order; a bounded number is in flight."""
    waiting, alone = deque(jobs), deque[Job]()
    flying: dict[Future, list[Job]] = {}
    pace: dict[str, float] = {}  # s for a job of a kind, in the last group of such jobs
    finished = False
    try:
        while waiting or alone or flying:
            # after a loss, the jobs in flight are run one by one, which finds the one that ends its process
            room = 1 if alone else AHEAD * pool.count
            while (waiting or alone) and len(flying) < room:
                group = [alone.popleft()] if alone else _group(waiting, pace, pool.count)
                try:
                    flying[pool.executor.submit(run_jobs, group, out)] = group
                except pool.lost:
                    alone.extendleft(reversed(group))
                    pool.restart()
                if len(group) == 1 and room == 1:
                    break
            done, _ = wait(flying, return_when=FIRST_COMPLETED)
            lost: list[Job] = []
            for future in done:
                group = flying.pop(future)
                try:
                    rows = future.result()
                except pool.lost:
                    lost += group
                    continue
                # those that fail may be quick
                spent = [row["seconds"] for row in rows if row["status"] == DONE]
                if spent:
                    pace[group[0].kind] = sum(spent) / len(spent)
                yield from rows
            if lost:
                lost += [job for group in flying.values() for job in group] if isinstance(pool, Local) else []
                flying = {} if isinstance(pool, Local) else flying
                pool.restart()
                if len(lost) == 1 and room == 1:
                    yield _lost_row(lost[0])
                else:
                    alone.extend(lost)
        finished = True
    finally:
        pool.close(finished)


def _group(waiting: deque[Job], pace: Mapping[str, float], workers: int) -> list[Job]:
    """The next jobs of one kind: about GROUP seconds of work at the `pace` (s) of a job, one if that is not known yet;
    fewer towards the end.

    A job of pictures takes a thousand times as long as one of points: they are not counted as one kind.
    """
    fair = len(waiting) // (AHEAD * workers)
    group = [waiting.popleft()]
    seconds = pace.get(group[0].kind, GROUP)
    most = min(MOST_IN_GROUP, fair, int(GROUP / seconds) if seconds > 0 else 1)
    while waiting and len(group) < most and waiting[0].kind == group[0].kind:
        group.append(waiting.popleft())
    return group


def _lost_row(job: Job) -> Row:
    return {
        "name": job.name,
        "type": job.type,
        "digest": job.digest,
        "status": FAILED,
        "reason": "its process was ended by the system (out of memory?), twice.",
        "seconds": None,
    }
