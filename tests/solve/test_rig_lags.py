"""Cameras that are not in step."""

from dataclasses import replace

import numpy as np
import pytest

from camcal import calibrate_rig
from camcal.solve.rig_lags import lags
from camcal.solve.rig_start import corners_of, links, spanning_tree
from camcal.solve.turns import symmetries
from tests.rigs import LENS, observed, truth
from tests.solve.test_rig_start import exact


def found(pictures, data):
    turns, corners = symmetries(data), corners_of(data.xyz)
    known = links(pictures, turns, corners, len(data.cameras))
    return lags(pictures, known, spanning_tree(known, data.cameras)[1], turns, corners)


@pytest.mark.parametrize(("camera", "lag"), [(1, 1), (2, -2), (0, 1), (2, 5)])
def test_a_lag_is_found_with_its_size(camera, lag):
    _, data, _, pictures = exact("abc", instants=20)
    late = np.where(pictures.camera == camera, pictures.view + lag, pictures.view)
    assert found(replace(pictures, view=late - late.min()), data) == {camera: lag}


def test_of_two_cameras_the_second_is_named():
    _, data, _, pictures = exact("ab", instants=20)
    late = np.where(pictures.camera == 1, pictures.view + 1, pictures.view)
    assert found(replace(pictures, view=late), data) == {1: 1}


def test_cameras_in_step_and_a_board_that_stands_still():
    _, data, _, pictures = exact("abc", instants=20)
    assert found(pictures, data) == {}
    still = replace(pictures, poses=pictures.poses[np.searchsorted(pictures.camera, pictures.camera)])
    assert found(still, data) == {}


def test_it_is_a_warning_that_names_camera_and_frames():
    data, _ = observed(truth("abc"), instants=16)
    view = np.where(data.camera == 2, data.view + 1, data.view)
    late = replace(data, view=view, view_ids=tuple(map(str, range(17))))
    solution = calibrate_rig(late, model=LENS, robust="none")
    (said,) = [w for w in solution.warnings if w.code == "cameras-out-of-step"]
    assert said.severity == "wrong" and "c by 1 frame late" in said.message
    assert solution.verdict == "fail" and "--lag c=1" in said.hint
    good = calibrate_rig(late, model=LENS, robust="none", lag={"c": 1})
    assert good.rms_point < 0.3 and not any(w.code == "cameras-out-of-step" for w in good.warnings)
    whole = calibrate_rig(data, model=LENS, robust="none")
    assert good.rig.baseline("a", "c") == pytest.approx(whole.rig.baseline("a", "c"), abs=1e-6)
