"""Which closed form the geometry of the data chooses, and which views none can take."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.observations import Correspondences, View
from camcal.errors import DataError, EstimationError
from camcal.plan.calibrate import calibrate
from camcal.start import shape
from tests.start import scenes


def test_one_view_in_space():
    names, why = shape.choose(scenes.scene(scenes.rig(), [[0.1, 0.2, 0.3]]).observations)
    assert names == ["central", "dlt"] and "30 points in space" in why


def test_many_boards():
    names, why = shape.choose(scenes.scene(scenes.board(), scenes.tilts(4)).observations)
    assert names == ["zhang"] and "4 views" in why


def test_a_board_in_any_plane_of_space():
    turn = scenes.rotations.exp(np.array([1.0, 0.5, 0.2]))
    points = scenes.board() @ turn.T + [5, 5, 5]
    assert shape.choose(scenes.scene(points, scenes.tilts(3)).observations)[0] == ["zhang"]


@pytest.mark.parametrize(("bow", "expected"), [(0.005, "zhang"), (0.2, "dlt")])
def test_bowed_sheets(bow, expected):
    points = scenes.board(10, 10, 0.02)
    points[:, 2] = bow * 0.2 * np.cos(points[:, 0] / 0.2 * np.pi)
    names, why = shape.choose(scenes.scene(points, scenes.tilts(3)).observations)
    assert names[-1] == expected
    assert ("nearly" in why) == (expected == "zhang")


def test_rigs_and_boards_together():
    rigs = scenes.scene(scenes.rig(), scenes.tilts(2)).observations.views
    boards = scenes.scene(scenes.board(), scenes.tilts(2)).observations.views
    names, why = shape.choose(Correspondences.from_views(rigs + boards))
    assert names == ["dlt"] and "2 of 4" in why


def test_unusable_views_and_their_reasons():
    good = scenes.scene(scenes.board(), scenes.tilts(1)).observations.views[0]
    rig = scenes.scene(scenes.rig(), scenes.tilts(1)).observations.views[0]
    views = (
        good,
        good.take([0, 1, 10]),
        good.take(np.arange(9)),  # the first row of the board
        rig.take(np.arange(5)),
        View("edge", good.xyz, np.stack([good.uv[:, 0], 2 * good.uv[:, 0]], 1)),
        View("none", np.zeros((0, 3)), np.zeros((0, 2))),
    )
    found = shape.unusable(Correspondences.from_views(views))
    assert sorted(found) == [1, 2, 3, 4, 5]
    for index, word in [
        (1, "3 points"),
        (2, "on a line"),
        (3, "5 points in space"),
        (4, "image points"),
        (5, "0 points"),
    ]:
        assert word in found[index]
    with pytest.raises(DataError, match="4 more"):
        shape.check(Correspondences.from_views(views))


def test_what_a_plane_determines():
    one = scenes.scene(scenes.board(), scenes.tilts(1)).observations
    shape.require_determined(one, ("f", "skew"))
    with pytest.raises(EstimationError, match="1 view of a plane determines 2"):
        shape.require_determined(one, ("fx", "fy", "cx", "cy"))
    shape.require_determined(
        scenes.scene(scenes.board(), scenes.tilts(2)).observations, ("fx", "fy", "cx", "cy")
    )
    rig = scenes.scene(scenes.rig(), scenes.tilts(1)).observations
    shape.require_determined(rig, ("fx", "fy", "cx", "cy", "skew"))


def test_exact_copies_of_one_view_are_one_view():
    one = scenes.scene(scenes.board(), scenes.tilts(1), noise=0.1).observations.views[0]
    copies = tuple(replace(one, id=f"v{i}") for i in range(5))
    with pytest.raises(DataError, match="all 5 views hold exactly the same points"):
        calibrate(Correspondences.from_views(copies, scenes.SIZE), model="pinhole")
