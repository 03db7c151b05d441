"""Numbers of what commands say while they work, and how long they wait, each just below and just above."""

import io
from types import SimpleNamespace

import pytest

from camcal.cli import batch, job, output, simulate, track_results, watch


@pytest.mark.parametrize(
    ("seconds", "taken"), [(0.99 * job.PATIENT, job.PATIENT), (1.01 * job.PATIENT, 1.01 * job.PATIENT)]
)
def test_time_for_a_picture_of_a_reproducible_run(seconds, taken):
    """At least so much, so that a busy machine gives up no picture; more where more was asked for."""
    assert job.search_options({"reproducible": True, "seconds": seconds})["seconds"] == taken
    assert job.search_options({"reproducible": False, "seconds": seconds})["seconds"] == seconds


@pytest.mark.parametrize(
    ("jobs", "lines"), [(batch.LINES - 1, 0), (batch.LINES, batch.LINES), (500, batch.LINES)]
)
def test_lines_of_a_batch_off_a_terminal(capsys, jobs, lines):
    show = batch.Progress()
    for done in range(1, jobs + 1):
        show({"name": "a", "status": "done"}, done, jobs)
    assert capsys.readouterr().err.count(" left.") == lines


def test_changes_that_are_listed():
    for count, more in ((track_results.SHOWN, False), (track_results.SHOWN + 1, True)):
        changes = [SimpleNamespace(message=f"moved {i}") for i in range(count)]
        summary = SimpleNamespace(
            statuses={}, frames=9, used=9, points=9, ignored=0, changes=changes, change_count=count
        )
        said = list(track_results._said(summary))
        assert sum("moved" in line for line in said) == track_results.SHOWN
        assert ("  and 1 more" in said) == more


def test_how_often_a_bar_is_drawn(monkeypatch):
    """Again after so long, and not before."""
    import rich.progress

    now, drawn = [0.0], []

    class Bar:
        def __init__(self, *_, **__):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def add_task(self, *_, **__):
            return 0

        def update(self, _, completed, total, refresh):
            drawn.append(refresh)

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(rich.progress, "Progress", Bar)
    monkeypatch.setattr(output.sys, "stderr", Terminal())
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    with output.progress("reading") as show:
        for moment in (0.0, 0.9 * output.REDRAWN, 1.1 * output.REDRAWN, 1.9 * output.REDRAWN):
            now[0] = moment
            show(1, 9)
    assert drawn == [True, False, True, False]


def test_a_folder_is_looked_at_before_a_person_notices():
    """The eye takes a tenth of a second for at once; a look takes less than a millisecond."""
    assert 100 * 1e-3 <= watch.LOOK <= 0.1


def test_decimals_of_simulated_points():
    """Below the thousandth part of the smallest noise that a fit resolves, 1e-6 px, and above float64 at 1e4 px."""
    assert 1e4 * 2.0**-52 < 10.0**-simulate.POINT_DIGITS < 1e-9
