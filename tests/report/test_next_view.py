"""Words and drawing of a suggested view agree with its pose."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.next_view import NextView, Suggestion
from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.report.charts.base import Line, short
from camcal.report.next_view import drawing, words
from tests.solved import grid, rig, solved

SOLUTION = solved()


def held(x=0.0, y=0.0, z=14.0, turn=(0.0, 0.0, 0.0)):
    """The board's middle at (x, y, z), turned about it."""
    rotation = rotations.exp(np.array(turn))
    return Pose(rotation, np.array([x, y, z]) - rotation @ grid().mean(0))


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (held(), "middle of the picture"),
        (held(), "facing the camera"),
        (held(), "14 squares away"),
        (held(x=-4), "left of the picture"),
        (held(x=4, y=-2.5), "top right of the picture"),
        (held(turn=(0, 0.5, 0)), "turned by 29 degrees with its right side towards"),
        (held(turn=(0, -0.5, 0)), "left side towards"),
        (held(turn=(0.5, 0, 0)), "top side towards"),
        (held(turn=(-0.5, 0, 0)), "bottom side towards"),
        (held(turn=(-0.4, 0.4, 0)), "bottom right side towards"),
    ],
)
def test_words(pose, said):
    target = dict(SOLUTION.observations.target or {}) | {"unit": "square"}
    solution = replace(SOLUTION, observations=replace(SOLUTION.observations, target=target))
    assert said in words(solution, grid(), pose)


def near_and_far(chart):
    near = [layer for layer in chart.layers if isinstance(layer, Line) and layer.tone == "accent"]
    return np.concatenate([layer.xy for layer in near]) if near else np.zeros((0, 2))


@pytest.mark.parametrize("seed", range(5))
def test_the_side_drawn_as_nearer_is_nearer(seed):
    rng = np.random.default_rng(seed)
    pose = held(*rng.uniform(-1, 1, 2), turn=rng.uniform(-0.5, 0.5, 3) + [0.2, 0, 0])
    chart = drawing(SOLUTION, Suggestion(pose, 1.0, 0.5))
    near = near_and_far(chart)
    outer = np.array([[-1.0, -1, 0], [9, -1, 0], [9, 6, 0], [-1, 6, 0]])
    far = np.linalg.norm(pose.apply(outer), axis=1)
    nearest = SOLUTION.camera.project(pose.apply(outer[[far.argmin()]]))
    assert np.linalg.norm(near - nearest, axis=1).min() < 1e-6


def test_a_target_that_faces_the_camera_has_no_nearer_side():
    assert not len(near_and_far(drawing(SOLUTION, Suggestion(held(), 1.0, 0.5))))


def test_the_drawing_stays_in_the_picture_and_says_what_it_gains():
    suggestion = NextView(SOLUTION, candidates=40).best()[0]
    chart = drawing(SOLUTION, suggestion, 3)
    assert chart.title.startswith("Picture 3: ") and f"{suggestion.worst:.2g} px" in chart.text
    for layer in chart.layers:
        assert (layer.xy >= -0.5).all() and (layer.xy <= [639.5, 479.5]).all()


def test_a_rig_is_drawn_as_its_outline():
    solution = solved(xyz=rig())
    chart = drawing(solution, NextView(solution, candidates=20).best()[0])
    assert sum(isinstance(layer, Line) for layer in chart.layers) == 1
    assert "turned" not in chart.title


@pytest.mark.parametrize(("value", "said"), [(6918.2, "6920"), (0.68812, "0.688"), (10.0, "10")])
def test_short(value, said):
    assert short(value) == said
