"""Every closed form: exact on exact motions, and the same whatever frames and units are chosen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.geometry import rotations as so3
from camcal.model.pose import Pose, Poses
from camcal.registry import load
from camcal.routes.hand_eye import CLOSED_FORM_SUMMARIES, CLOSED_FORMS
from camcal.routes.hand_eye.closed_forms import solve_all
from camcal.routes.hand_eye.views import MOST_MOTIONS, Views, views_of
from tests.routes.hand_eye.hands import hand, off

SEEDS = st.integers(0, 10**6)


def exact(seed, count=6):
    """Views without noise, with X and Z; lengths near 1, turns of up to 1.5 rad."""
    rng = np.random.default_rng(seed)
    x, z = (Pose.from_vector(rng.uniform(-1, 1, 3), rng.normal(0, 1, 3)) for _ in range(2))
    robot = Poses(so3.exp(rng.uniform(-0.85, 0.85, (count, 3))), rng.normal(0, 1, (count, 3)))
    return Views(robot, x.inverse() @ robot @ z), x, z


def test_every_form_has_a_summary():
    assert list(CLOSED_FORMS) == list(CLOSED_FORM_SUMMARIES)


@pytest.mark.parametrize("name", CLOSED_FORMS)
@given(seed=SEEDS)
@settings(max_examples=25, deadline=None)
def test_exact_on_exact_motions(name, seed):
    views, x, z = exact(seed)
    found = load(CLOSED_FORMS[name])(views)
    # six random poses are conditioned to about 1e4, and systems are solved to 1e-16 of that
    assert max(np.abs(off(f, t)).max() for f, t in zip(found, (x, z), strict=True)) < 1e-8


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_three_views_are_enough(name):
    views, x, _ = exact(7, 3)
    if name == "li":
        pytest.skip("24 unknowns in one linear system: three views leave its rank below 24")
    assert np.abs(off(load(CLOSED_FORMS[name])(views)[0], x)).max() < 1e-8


@pytest.mark.parametrize("setup", ["in-hand", "to-hand"])
def test_frames_of_the_robot_are_a_convention(setup):
    """A base or a hand with another frame changes X and Z by that frame alone."""
    h = hand(setup, 3)
    base, tool = (
        Pose.from_vector((0.3, -0.4, 2), (100, 50, -20)),
        Pose.from_vector((1, 0.2, -0.3), (5, 9, -70)),
    )
    plain = solve_all(views_of(setup, h.robot, h.pictures.poses), setup)
    moved = solve_all(views_of(setup, base @ h.robot @ tool, h.pictures.poses), setup)
    # Tsai's unknown is tan(θ/2) of X itself, the others solve for the translation along with the rotation
    for name in ("park", "horaud", "shah"):
        a, b = (next(m for m in methods if m.name == name) for methods in (plain, moved))
        frame = tool.inverse() if setup == "in-hand" else base
        turned = frame @ a.x
        assert so3.angle_between(b.x.rotation, turned.rotation) < 1e-9, name


@pytest.mark.parametrize("setup", ["in-hand", "to-hand"])
def test_units_of_length_do_not_matter(setup):
    h = hand(setup, 4)
    views = views_of(setup, h.robot, h.pictures.poses)
    metres = Views(*(Poses(p.rotation, p.translation / 1000) for p in (views.robot, views.camera)))
    for mm, m in zip(solve_all(views, setup), solve_all(metres, setup), strict=True):
        assert np.abs(off(mm.x, Pose(m.x.rotation, m.x.translation * 1000))).max() < 1e-6, mm.name


def test_many_views_take_the_pairs_that_lie_farthest_apart():
    rng = np.random.default_rng(0)
    robot = Poses(so3.exp(rng.normal(0, 1, (80, 3))), rng.normal(0, 1, (80, 3)))
    i, j = Views(robot, robot).pairs
    assert len(i) == MOST_MOTIONS and (i > j).all()
    assert (i - j).max() == 79 and len(set(i) | set(j)) == 80


def test_a_form_that_fails_is_left_out():
    still = Poses(np.broadcast_to(np.eye(3), (4, 3, 3)), np.zeros((4, 3)))
    found = {m.name: m.x for m in solve_all(Views(still, still), "to-hand")}
    assert set(found) == set(CLOSED_FORMS)
