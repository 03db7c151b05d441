"""What is drawn of a long table, each number just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.track import plots

needs_plots = pytest.importorskip("matplotlib")


def table(tmp_path, frames, changed=()):
    path = tmp_path / "track.csv"
    rows = [f"{i},{'1' if i in changed else '0'},1.0" for i in range(frames)]
    path.write_text("frame,changed,m11\n" + "\n".join(rows) + "\n")
    return plots.read_table(path)["frame"].astype(int).tolist()


def test_rows_that_are_drawn(tmp_path, monkeypatch):
    """All up to the limit, every second of one more; alarms always, but no more than that of them."""
    assert plots.MOST == 4000  # four to a pixel of a panel
    monkeypatch.setattr(plots, "MOST", 40)
    assert table(tmp_path, 40) == list(range(40))
    assert table(tmp_path, 41) == list(range(0, 41, 2))
    assert 43 in table(tmp_path, 60, {43}) and 43 not in table(tmp_path, 60)
    odd = set(range(41, 400, 2))
    assert len(odd & set(table(tmp_path, 400, odd))) == 40


def drawn(frames):
    lines = []
    changed = np.ones(frames, int)
    plots._mark(
        SimpleNamespace(axvline=lambda at, **_: lines.append(at)),
        {"frame": np.arange(frames), "changed": changed},
    )
    return len(lines)


def test_alarms_that_get_a_line():
    assert [drawn(n) for n in (plots.LINES, plots.LINES + 1)] == [plots.LINES, plots.LINES]


@pytest.mark.parametrize(("far", "shown"), [(0, True), (1, False)])
def test_values_beyond_a_panel(far, shown):
    """Of a hundred steps, the one at the end may lie outside, and the last but one may not."""
    limits = []
    value = np.zeros(1000)
    count = 10 * plots.ENDS + (0 if far else 5)
    value[:count] = 100.0
    axis = SimpleNamespace(set_ylim=lambda low, high: limits.append(high))
    plots._limit(axis, {"fx": value, "sigma_fx": np.ones(1000)}, ["fx"])
    assert (limits[0] > 100) == shown
