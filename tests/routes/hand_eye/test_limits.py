"""What is refused and what is said, from both sides of every limit."""

import numpy as np
import pytest

from camcal.data.robot_poses import RobotPoses
from camcal.data.rotation_forms import FORMS
from camcal.errors import DataError, EstimationError, UsageError
from camcal.geometry import rotations as so3
from camcal.model.pose import Poses
from camcal.routes.hand_eye import SETUPS, recognise
from camcal.routes.hand_eye.estimate import estimate
from camcal.routes.hand_eye.motions import ABOVE_NOISE, Motions, require_two_axes
from camcal.routes.hand_eye.recognise import Reading
from camcal.routes.hand_eye.remarks import _no_noise
from camcal.routes.hand_eye.scale import SAME_UNIT, require_same_unit, scale
from camcal.routes.hand_eye.variance import outlying
from camcal.routes.hand_eye.views import views_of
from tests.routes.hand_eye.hands import BOARD, hand


def about(axes, degrees, count=8):
    """cam_from_board turned about one axis, and by so many degrees about the x axis besides."""
    rng = np.random.default_rng(0)
    turn = so3.exp(np.outer(rng.uniform(-0.8, 0.8, count), axes))
    more = so3.exp(np.outer(np.radians(degrees) * np.resize([1, -1], count), [1, 0, 0]))
    rotation = more @ turn @ so3.exp(np.array([0.4, 0, 0]))
    return Poses(rotation, np.array([0, 0, 420.0]) - rotation @ BOARD.mean(0))


@pytest.mark.parametrize("setup", SETUPS)
def test_parallel_axes_are_refused_and_named(setup):
    h = hand(setup, 1, poses=about([0, 0, 1], 0))
    with pytest.raises(EstimationError, match=r"parallel axes, the axis z .* of the camera"):
        estimate(setup, h.pictures, h.robot)


@pytest.mark.parametrize("setup", SETUPS)
def test_a_second_axis_is_enough(setup):
    h = hand(setup, 1, poses=about([0, 0, 1], 5))
    found = estimate(setup, h.pictures, h.robot)
    assert np.isfinite(found.sigma).all()


def test_without_turns():
    h = hand("to-hand", 1, poses=about([0, 0, 0], 0))
    with pytest.raises(EstimationError, match="without rotations base_from_camera is undetermined"):
        estimate("to-hand", h.pictures, h.robot)


@pytest.mark.parametrize("second, refused", [(ABOVE_NOISE * 0.11, False), (ABOVE_NOISE * 0.09, True)])
def test_turns_about_a_second_axis_beside_noise(second, refused):
    motions = Motions(np.array([30, second, 0.1]), np.eye(3), np.full(3, 0.1))
    if not refused:
        require_two_axes(motions)
        return
    with pytest.raises(EstimationError, match="axis x"):
        require_two_axes(motions)


@pytest.mark.parametrize("count, enough", [(2, False), (3, True)])
def test_three_poses_are_needed(count, enough):
    h = hand("in-hand", 1, count)
    if enough:
        assert len(estimate("in-hand", h.pictures, h.robot).used) == 3
        return
    with pytest.raises(DataError, match="2 poses have a view; a hand-eye calibration needs 3"):
        estimate("in-hand", h.pictures, h.robot)


@pytest.mark.parametrize(("mm", "said"), [(0.0, True), (1.0, False)])
def test_a_robot_without_noise_of_its_own_is_named(mm, said):
    h = hand("in-hand", 4, 12, mm=mm, deg=mm / 10)
    found = estimate("in-hand", h.pictures, h.robot)
    notes = list(_no_noise(found))
    assert [n.code for n in notes] == ["hand-eye-noise-at-zero"] * said
    assert said == bool(np.isinf(found.relative[1:]).any())


def robot_of(poses, form, certain=False):
    """The table that a robot would write."""
    from scipy.spatial.transform import Rotation

    r = Rotation.from_matrix(poses.rotation)
    numbers = {
        "vector": lambda: r.as_rotvec(),
        "vector-deg": lambda: r.as_rotvec(degrees=True),
        "quaternion-xyzw": lambda: r.as_quat(),
        "quaternion-wxyz": lambda: np.roll(r.as_quat(), 1, axis=1),
        "quaternion-zyxw": lambda: r.as_quat()[:, [2, 1, 0, 3]],
        "quaternion-wyzx": lambda: r.as_quat()[:, [3, 1, 2, 0]],
        "fixed-xyz-deg": lambda: r.as_euler("xyz", degrees=True),
    }
    made = (
        numbers[form]
        if form in numbers
        else lambda: r.as_euler(form[:3].upper(), degrees=form.endswith("deg"))
    )
    named = FORMS["vector" if FORMS[form].count == 3 else "quaternion-wxyz"]
    names = tuple(f"v{i:02d}" for i in range(len(poses)))
    return RobotPoses(
        "poses.csv", names, None, poses.translation, made(), FORMS[form] if certain else named, certain
    )


@pytest.mark.parametrize(
    "form",
    [
        "vector",
        "vector-deg",
        "zyx-deg",
        "zyx-rad",
        "xyz-deg",
        "fixed-xyz-deg",
        "zyz-deg",
        "quaternion-xyzw",
        "quaternion-wxyz",
        "quaternion-zyxw",  # an odd permutation of wxyz, and an even one
        "quaternion-wyzx",
    ],
)
@pytest.mark.parametrize("setup", SETUPS)
def test_set_up_and_form_are_recognised(setup, form):
    h = hand(setup, 2)
    robot = robot_of(h.robot, form)
    np.testing.assert_allclose(robot.poses(FORMS[form]).rotation, h.robot.rotation, atol=1e-9)
    found = recognise.choose(recognise.readings(robot, h.pictures.poses, SETUPS, False), robot, None, 15)
    assert found.setup == setup
    # the same numbers in another form are that form
    np.testing.assert_allclose(robot.poses(found.form).rotation, h.robot.rotation, atol=1e-9)


def test_a_wrong_form_that_was_asked_for_is_said():
    h = hand("in-hand", 2)
    robot = robot_of(h.robot, "vector", certain=True)
    found = recognise.readings(robot, h.pictures.poses, SETUPS, False)
    taken = recognise.choose(found, robot, "in-hand", 15)
    assert recognise.better_reading(found, taken, 15) is None
    small = Reading("in-hand", FORMS["zyx-deg"], 0.05, 0.05)
    assert recognise.better_reading([small, taken], small, 15) is taken


def test_poses_of_other_views_are_refused():
    h = hand("in-hand", 2)
    robot = robot_of(Poses(h.robot.rotation[::-1], h.robot.translation), "vector")
    with pytest.raises(EstimationError, match="do not match"):
        recognise.choose(recognise.readings(robot, h.pictures.poses, SETUPS, False), robot, None, 15)


def reading(setup, misfit):
    return Reading(setup, FORMS["vector"], misfit)


@pytest.mark.parametrize("factor, said", [(1.19, False), (1.20, True)])
def test_a_set_up_needs_odds_of_a_thousand(factor, said):
    """15 views: 39 degrees of freedom, 39 ln 1.194 = ln 1000."""
    found = [reading("in-hand", 0.01), reading("to-hand", 0.01 * factor)]
    robot = robot_of(hand("in-hand", 2).robot, "vector")
    if said:
        assert recognise.choose(found, robot, None, 15).setup == "in-hand"
        return
    with pytest.raises(UsageError, match="fit a camera in the hand"):
        recognise.choose(found, robot, None, 15)


@pytest.mark.parametrize("degrees, refused", [(9.9, False), (10.1, True)])
def test_residual_turns_of_no_robot(degrees, refused):
    robot = robot_of(hand("in-hand", 2).robot, "vector")
    found = [reading("in-hand", np.radians(degrees)), reading("to-hand", 1.0)]
    if not refused:
        assert recognise.choose(found, robot, "in-hand", 15).setup == "in-hand"
        return
    with pytest.raises(EstimationError, match="do not match"):
        recognise.choose(found, robot, "in-hand", 15)


@pytest.mark.parametrize("setup", SETUPS)
def test_scale_of_the_robots_motions(setup):
    h = hand(setup, 3)
    longer = Poses(h.robot.rotation, h.robot.translation * 1.02)
    factor, sigma = scale(views_of(setup, longer, h.pictures.poses))
    assert abs(factor - 1.02) < 4 * sigma < 0.05


@pytest.mark.parametrize(
    "factor, unit, hint",
    [
        (0.001, "mm", "poses-unit m"),
        (10.0, "cm", "poses-unit mm"),
        (1000.0, "m", "mm"),
        (7.0, "mm", "square"),
    ],
)
def test_other_units_are_refused(factor, unit, hint):
    with pytest.raises(DataError, match="in another unit") as caught:
        require_same_unit(factor, unit)
    assert hint in caught.value.hint


def test_lengths_that_a_wrong_set_up_makes_wrong_are_no_other_unit():
    better = Reading("to-hand", FORMS["zyx-deg"], 0.001)
    with pytest.raises(DataError, match="fit far better as to-hand, rotations as zyx-deg") as error:
        require_same_unit(0.6, "mm", better)
    assert error.value.hint == "Try: --setup to-hand --rotation zyx-deg"
    require_same_unit(1.2, "mm", better)


@pytest.mark.parametrize("factor", [1.0, SAME_UNIT - 0.01, 1 / SAME_UNIT + 0.01, float("nan")])
def test_the_same_unit(factor):
    require_same_unit(factor, "mm")


def test_probability_of_an_outlying_pose():
    """A pose with the average misfit is likely; one with ten times that is not."""
    usual = np.full(12, (72 - 12) / 12)
    assert outlying(usual, 12).min() > 0.3
    usual[3] = 40
    assert outlying(usual, 12)[3] < 1e-5 and (outlying(np.full(3, 2.0), 12) == 1).all()
