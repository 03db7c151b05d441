"""A film whose frames have a known motion: a rolling shutter and the board's shape are weighed as two models."""

import re
from dataclasses import replace

import numpy as np
import pytest

import camcal
from camcal.assess.rolling import Readout, corrected, readout
from camcal.data.observations import Observations, View
from camcal.geometry import rotations
from camcal.geometry.plane_flow import flow_at
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.plan import boards
from camcal.solve.refine import How
from tests.solved import grid

SIZE = (640, 480)
CAMERA = Camera(lenses.make("opencv5"), np.array([600.0, 600, 322, 241, -0.25, 0.08, 0, 0, 0]), SIZE)
GRID = grid()


def film(time, depth, frames=16, noise=0.05):
    """Frames of a board that moves; rows are read in `time` frames, and the board is bent by `depth` squares."""
    rng = np.random.default_rng(4)
    middle = GRID.mean(0)
    bend = depth * (1 - np.square((GRID[:, 0] - 4) / 4))
    views, flows = [], {}
    for i in range(frames):
        tilt, about = rng.uniform(0.1, 0.7), rng.uniform(0, 2 * np.pi)
        turn = rotations.exp(tilt * np.array([np.cos(about), np.sin(about), 0]))
        pose = Pose(turn, np.r_[rng.uniform(-2, 2, 2), rng.uniform(12, 18)] - turn @ middle)
        uv = CAMERA.project(pose.apply(GRID + bend[:, None] * [0, 0, 1]))
        flow = rng.normal(0, 1, 8) * [4, 4, 4, 4, 4, 4, 1, 1]
        shift = ((uv[:, 1] + 0.5) / SIZE[1])[:, None] * flow_at(flow, uv, SIZE)
        views.append(
            View(f"m#{i}", GRID, uv + time * shift + rng.normal(0, noise, uv.shape), None, np.arange(54))
        )
        flows[f"m#{i}"] = {"flow": flow.tolist()}
    target = {"kind": "checkerboard", "columns": 9, "rows": 6, "square": 1.0}
    return Observations.from_views(views, SIZE, target=target, picture_quality=flows)


def kept(solution):
    return solution.observations.target["shape"]["kind"], {w.code: w for w in solution.warnings}


def test_a_shutter_is_not_taken_for_a_shape():
    solution = camcal.calibrate(film(0.5, 0.0), board_shape="auto")
    shape, said = kept(solution)
    assert shape == "flat" and "board-not-flat" not in said
    assert (
        "all within 0." in said["rolling-shutter"].message and "were moved" in said["rolling-shutter"].message
    )
    time, sigma = map(float, re.findall(r"(0\.\d+) \+- (0\.\d+)", said["rolling-shutter"].message)[0])
    assert abs(time - 0.5) < 4 * sigma + 0.005
    assert solution.camera.values["fx"] == pytest.approx(600, abs=1)  # 607 without the correction
    assert solution.stages[-1].info["attempt"] == "rolling-shutter"
    bare = camcal.calibrate(film(0.5, 0.0), board_shape="auto", checks=False)
    assert [w.code for w in bare.warnings] == ["rolling-shutter"]  # never corrected without a word


def test_a_shape_is_not_taken_for_a_shutter():
    shape, said = kept(camcal.calibrate(film(0.0, 0.1), board_shape="auto"))
    assert shape in ("bowl", "free") and "rolling-shutter" not in said


def test_a_shape_and_a_shutter_are_both_found():
    solution = camcal.calibrate(film(0.5, 0.1), board_shape="auto")
    shape, said = kept(solution)
    assert shape in ("bowl", "free") and "rolling-shutter" in said
    assert solution.camera.values["fx"] == pytest.approx(600, abs=1.5)


def test_nothing_is_corrected_without_a_motion_of_the_frames():
    moved = replace(film(0.5, 0.0), picture_quality={})
    solution = camcal.calibrate(moved, board_shape="flat")
    assert not any(s.name == "rolling-shutter" for s in solution.stages)
    assert np.array_equal(solution.observations.uv, moved.uv)


def test_points_corrected_for_the_readout_show_none():
    moved = film(0.5, 0.0)
    solution = camcal.calibrate(corrected(moved, 0.5), board_shape="flat")
    found = readout(solution)
    assert abs(found.time) < 4 * found.sigma
    assert solution.camera.values["fx"] == pytest.approx(600, abs=1)
    assert np.array_equal(corrected(moved, 0.0).uv, moved.uv)


def test_the_fit_is_that_of_the_readout_time_even_where_the_steps_do_not_end(monkeypatch):
    flat = camcal.calibrate(replace(film(0.5, 0.0), picture_quality={}), board_shape="flat", checks=False)
    flat = replace(
        flat, observations=replace(flat.observations, picture_quality=film(0.5, 0.0).picture_quality)
    )
    monkeypatch.setattr(boards.rolling, "readout", lambda _: Readout(0.02, 0.001, 0.5, np.zeros(9), 1.0))
    time, made = boards._corrected_fit(flat, 0.4, How())
    assert np.array_equal(made.observations.uv, corrected(flat.observations, time).uv)
