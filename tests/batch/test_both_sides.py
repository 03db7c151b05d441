"""Limits of batches, each just below and just above."""

from collections import deque
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.batch import arrivals, ci, fleet, grabber, jobs, live_page, page, run, watch
from camcal.batch.storage import Storage
from camcal.batch.watch import Step, Watcher
from camcal.errors import UsageError

DONE = {
    "type": "",
    "digest": "",
    "status": run.DONE,
    "verdict": "pass",
    "reason": "",
    "rms_point": 0.1,
    "seconds": 0.0,
}


def done(name, **more):
    return DONE | {"name": name} | more


# ------------------------------------------------------------------------------------ jobs and workers
def test_the_longest_name():
    assert jobs._name("n" * jobs.LONGEST_NAME, "job 1") == "n" * jobs.LONGEST_NAME
    with pytest.raises(UsageError, match="cannot be the name of a file"):
        jobs._name("n" * (jobs.LONGEST_NAME + 1), "job 1")


@pytest.mark.parametrize(
    ("seconds", "waiting", "taken"),
    [
        (None, 1000, 1),  # nothing is known yet
        (1.01 * run.GROUP, 1000, 1),
        (0.99 * run.GROUP / 2, 1000, 2),
        (0.99 * run.GROUP / run.MOST_IN_GROUP, 10_000, run.MOST_IN_GROUP),
        (0.9 * run.GROUP / (run.MOST_IN_GROUP + 1), 10_000, run.MOST_IN_GROUP),
        (1e-3, 2 * run.AHEAD * 3, 2),  # three workers with work ahead: each finds as much
        (1e-3, 2 * run.AHEAD * 3 - 1, 1),
    ],
)
def test_jobs_handed_out_together(seconds, waiting, taken):
    pace = {} if seconds is None else {"points": seconds}
    jobs = deque(SimpleNamespace(kind="points") for _ in range(waiting))
    assert len(run._group(jobs, pace, 3)) == taken


def test_rows_are_noted_after_so_many_and_so_long(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(run.time, "monotonic", lambda: now[0])
    (tmp_path / run.STATE).mkdir()
    state = run.State(Storage(str(tmp_path)))
    for count in range(run.ROWS - 1):
        state.add(done(str(count)))
    assert not list(tmp_path.rglob("*.jsonl"))
    state.add(done("last"))
    assert len(list(tmp_path.rglob("*.jsonl"))) == 1
    now[0] = run.NOTED
    state.add(done("early"))
    assert len(list(tmp_path.rglob("*.jsonl"))) == 1
    now[0] = 1.001 * run.NOTED
    state.add(done("late"))
    assert len(list(tmp_path.rglob("*.jsonl"))) == 2


# ------------------------------------------------------------------------------------ pages and summaries
def test_rows_of_pages():
    rows = [done(f"{i:04d}", rank=i, outlier="") for i in range(page.MOST_ROWS + 1)]
    for count, rest in ((page.MOST_ROWS, False), (page.MOST_ROWS + 1, True)):
        made = page._table(rows[:count])
        assert made.count("<tr") == page.MOST_ROWS + 1 and ("1 more in summary.csv" in made) == rest
    for count in (ci.MOST_ROWS, ci.MOST_ROWS + 1):
        text = ci.markdown(rows[:count], "s", "o")
        assert text.count("\n| 0") == ci.MOST_ROWS


def test_dots_of_a_control_chart():
    for count, dots in ((page.MOST_DOTS, page.MOST_DOTS), (page.MOST_DOTS + 2, page.MOST_DOTS // 2 + 1)):
        values = np.zeros(count)
        control = fleet.Control(
            "t", "fx", tuple(map(str, range(count))), values, np.ones(count), 0.0, 1.0, 3.0
        )
        points = next(layer for layer in page.control_chart(control).layers if hasattr(layer, "radius"))
        assert len(points.xy) == dots


def test_pictures_of_the_live_page():
    steps = [Step(f"{i}", "found", "", 9, 0.1, None, None, "", "", "", i) for i in range(live_page.SHOWN + 1)]
    for count in (live_page.SHOWN, live_page.SHOWN + 1):
        text = live_page.page(steps[:count], None, None)
        assert text.count("<tr>") == live_page.SHOWN + 1 and f">{count - 1}<" in text


# ------------------------------------------------------------------------------------ arriving pictures
def test_zeros_behind_the_end_of_a_picture(tmp_path):
    for zeros, complete in ((arrivals._TAIL - 2, True), (arrivals._TAIL - 1, False)):
        path = tmp_path / f"{zeros}.jpg"
        path.write_bytes(b"\xff\xd8 data \xff\xd9" + bytes(zeros))
        assert arrivals.is_complete(path) == complete


def test_a_target_is_certain_from_three_pictures_on(monkeypatch, tmp_path):
    for count, certain in ((watch.CERTAIN, True), (watch.CERTAIN - 1, False)):

        def detect(paths, on_event, n=count, **_):
            on_event("target", {"spec": "checkerboard:9x6", "pictures": n})

        monkeypatch.setattr(watch, "detect_images", detect)
        session = SimpleNamespace(outcomes={}, search={}, target=None, certain=None)
        Watcher._recognise(session)
        assert session.certain == certain


def test_frames_that_are_looked_at(monkeypatch, tmp_path):
    """A film's stride is the time between two looks; rates that are none look at every frame."""
    for rate, stride in ((1.4 / grabber.STEP, 1), (1.6 / grabber.STEP, 2), (grabber.FASTEST, 1)):
        capture = SimpleNamespace(isOpened=lambda: True, get=lambda _, r=rate: r)
        monkeypatch.setattr(grabber.cv2, "VideoCapture", lambda _, c=capture: c)
        made = grabber.Grabber(tmp_path / "film.avi", tmp_path / "frames")
        assert made.stride == stride


# ------------------------------------------------------------------------------------ limits of a fleet
def test_the_limit_of_an_outlier():
    """Shewhart's three standard deviations where fewer than one false alarm in twenty fleets is to be expected."""
    few, many = fleet.limit_for(1, 10_000), fleet.limit_for(100, 10_000)
    assert few == fleet.SHEWHART < many
    # of many cameras the quantile of the normal distribution, once in twenty fleets on either side
    assert many == pytest.approx(NormalDist().inv_cdf(1 - 0.5 * 0.05 / 100), rel=2e-3)
