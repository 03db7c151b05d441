"""Runs over streams: summaries, frames held back, and runs in two parts at any frame."""

import numpy as np
import pytest

from camcal.track.follow import Follower
from camcal.track.frames import Frame
from camcal.track.output import Output
from camcal.track.table import Table

from .helpers import make, sequence


def run(frames, folder, method="kalman", name="t.csv", state=None, **kwargs):
    estimator = make(method, motion="fixed") if method != "rls" else make(method)
    output = Output(Table(estimator.model), "csv", folder / name, growing=state is not None)
    follower = Follower(estimator, output, state_file=state, options={"method": method}, **kwargs)
    follower.resume()
    summary = follower.run(frames)
    output.finish()
    return summary, (folder / name).read_text()


def test_counts(tmp_path):
    frames, _ = sequence("knock", 40, knock=20, angle=0.5, outliers=0.05)
    frames[5] = Frame(5, np.zeros((0, 3)), np.zeros((0, 2)))
    frames[7] = frames[6]
    told = []
    summary, text = run(frames, tmp_path, on_change=told.append)
    assert summary.frames == 39 == len(text.splitlines()) - 1
    assert summary.statuses == {"started": 1, "updated": 36, "predicted": 1, "restarted": 1}
    assert summary.ignored == 1 and summary.change_count == 1
    assert 0.7 < summary.nis / summary.nis_dof < 1.3  # 36 x 11 degrees of freedom: sigma 0.07
    (change,) = summary.changes
    assert told[0].frame == change.frame == 20
    # described again ten frames later, from a camera that is known better
    assert max(change.figures["sigma_rotation_deg"]) < 0.8 * max(told[0].figures["sigma_rotation_deg"])


@pytest.mark.parametrize("hold", [0, 3])
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("method", ["rls", "iekf", "smoother"])
def test_in_two_parts_as_in_one(tmp_path, method, whole, hold):
    frames, _ = sequence("knock", 36, knock=20, angle=0.5)
    frames[10], frames[12] = frames[12], frames[10]
    _, expected = run(frames, tmp_path, method, "whole.csv", hold=hold)
    for cut in (5, 11, 21, 35):
        name, state = f"{cut}.csv", tmp_path / f"{cut}.state"
        run(frames[:cut], tmp_path, method, name, state, hold=hold, every=4)
        rest = frames if whole else frames[cut:]
        summary, text = run(rest, tmp_path, method, name, state, hold=hold, every=4)
        assert text == expected
        assert summary.frames == len(expected.splitlines()) - 1
        assert summary.ignored == (0 if hold else 2)
        assert summary.change_count == 1
