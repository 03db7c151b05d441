"""A group of neighbouring points that is off as a whole, in a small set: found, named, and not seen in noise."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks import fit
from camcal.assess.checks import group as module
from camcal.assess.checks.facts import Facts
from camcal.assess.checks.group import MOST_PART, MOST_POINTS, groups, shifted, shifted_group
from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.plan.calibrate import calibrate
from tests.solved import camera_of, observe, solved

#: five poles of five points
POLES = np.array([[-4.0, 0.0], [-2.0, 3.0], [0.0, -2.0], [2.0, 4.0], [4.0, 1.0]])
POINTS = np.concatenate([np.c_[np.full(5, x), np.linspace(-2.4, 2.4, 5), np.full(5, z)] for x, z in POLES])


def poles(seed, pole=None, off=(12.0, 3.0), noise=0.5):
    """One view of all poles, one of them displaced by so many px."""
    rng = np.random.default_rng(seed)
    turn = rotations.exp(np.r_[rng.uniform(-0.3, 0.3, 2), 0.1])
    pose = Poses(turn[None], np.array([[0.2, 0.1, 12.0]]))
    data = observe(camera_of("opencv4"), pose, POINTS, noise, rng)
    if pole is not None:
        uv = data.uv.copy()
        uv[5 * pole : 5 * pole + 5] += off
        data = replace(data, uv=uv)
    return calibrate(data, "opencv4", checks=False, crosscheck=False, robust="none")


@pytest.mark.parametrize("pole", range(5))
def test_a_pole_is_named_with_its_shift(pole):
    found = shifted(Facts(poles(0, pole)))
    assert found.p_value < module.BY_CHANCE
    # the pole, or most of it
    assert set(found.rows.tolist()) <= set(range(5 * pole, 5 * pole + 5)) and len(found.rows) >= 3
    assert (
        12 / 1.5 < found.shift[0] < 12 * 1.5
    )  # all of it, but for what the lens made up for with few points
    (said,) = shifted_group(Facts(poles(0, pole)))
    assert said.code == "shifted-group" and str(5 * pole + 2) in said.message


def test_chance_finds_no_group():
    """p-values of noise are no smaller than they say: of 40, 4 below .1 are expected at most, 9 once in a hundred."""
    chances = [shifted(Facts(poles(seed))).p_value for seed in range(40)]
    assert min(chances) > module.BY_CHANCE and np.sum(np.array(chances) < 0.1) < 9


def test_the_shift_is_that_of_a_fit_with_it():
    """Equation (1) against fits: with the points moved back by the shift the cost is lowest."""
    s = poles(1, 2, off=(1.5, 0.0), noise=0.1)
    found = shifted(Facts(s))

    def cost(shift):
        uv = s.observations.uv.copy()
        uv[found.rows] -= shift
        return calibrate(replace(s.observations, uv=uv), "opencv4", checks=False, robust="none").fit.cost

    best = cost(found.shift)
    assert best < s.fit.cost
    assert all(cost(found.shift + step) > best for step in ([0.3, 0], [-0.3, 0], [0, 0.3], [0, -0.3]))


def test_groups_are_neighbours_and_at_most_a_third():
    made = groups(POINTS)
    assert max(map(len, made)) <= MOST_PART * len(POINTS)
    assert len({tuple(g) for g in made}) == len(made)
    assert any(g.tolist() == [5, 6, 7, 8, 9] for g in made)
    assert groups(POINTS[:8]) == []


@pytest.mark.parametrize(
    ("chance", "moved", "severity"), [(9e-4, 1.1, "doubtful"), (9e-4, 0.9, "note"), (1.1e-3, 9, None)]
)
def test_the_severity_follows_how_far_the_camera_moves(monkeypatch, chance, moved, severity):
    s = poles(0, 1)
    monkeypatch.setattr(module, "shifted", lambda _: module.Group(0, np.arange(3), np.ones(2), chance))
    monkeypatch.setattr(fit, "moved_without", lambda *_: (moved, 0.1))
    assert [w.severity for w in shifted_group(Facts(s))] == [severity] * (severity is not None)


@pytest.mark.parametrize(("views", "looked"), [(3, True), (4, False)])
def test_large_sets_are_left_to_the_test_of_single_points(views, looked):
    s = solved(views=views)
    assert (54 * views <= MOST_POINTS) == looked and (shifted(Facts(s)) is not None) == looked
