"""A known rig on new data."""

from dataclasses import replace

import pytest

from camcal.errors import DataError
from camcal.model.rig import Rig
from camcal.plan.known_rig import evaluate_rig
from camcal.routes.hand_eye.scale import SAME_UNIT
from tests.rigs import observed, pose, truth


@pytest.fixture(scope="module")
def seen():
    rig = truth("ab")
    return rig, observed(rig, instants=4)[0]


@pytest.mark.parametrize("factor", [1.1 * SAME_UNIT, 30.0, 0.02])
def test_a_board_in_another_unit_is_named(seen, factor):
    rig, data = seen
    with pytest.raises(DataError, match=f"{factor:.3g}.* times as long as the board's") as error:
        evaluate_rig(rig, replace(data, xyz=data.xyz / factor))
    assert error.value.hint.startswith("Multiply X, Y and Z by ")
    with pytest.raises(DataError) as error:
        evaluate_rig(rig, replace(data, xyz=data.xyz / factor, target={"square": 2.0}))
    assert error.value.hint.startswith("Try: --square ")


@pytest.mark.parametrize("factor", [1.0, 0.9 * SAME_UNIT])
def test_boards_of_nearly_the_right_size_are_evaluated(seen, factor):
    rig, data = seen
    found = evaluate_rig(rig, replace(data, xyz=data.xyz / factor))
    assert (found.rms_point < 0.4) == (factor == 1.0)


@pytest.mark.parametrize(("baseline", "refused"), [(-200.0, True), (-100.0, False)])
def test_a_factor_is_refused_where_it_sets_boards_apart(baseline, refused):
    """1.65 times as long a baseline sets the boards of two cameras apart by .15 and .08 of their distance."""
    places = truth("ab")
    rig = Rig(places.cameras, {"b": pose((0.02, 0.25, 0.01), (baseline, 3, 20))}, "a")
    data = observed(rig, instants=4)[0]
    data = replace(data, xyz=data.xyz / 1.65)
    if refused:
        with pytest.raises(DataError, match=r"1\.65 times"):
            evaluate_rig(rig, data)
    else:
        assert evaluate_rig(rig, data).rms_point > 1


def test_a_rig_the_wrong_way_round_is_no_matter_of_units():
    """The factor is -1 where the second camera was on the other side: no size of the board explains that."""
    cameras = truth("ab").cameras
    right, left = (Rig(cameras, {"b": pose((0, 0, 0), (x, 0, 0))}, "a") for x in (-250.0, 250.0))
    assert evaluate_rig(left, observed(right, instants=4)[0]).rms_point > 1
