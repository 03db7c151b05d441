"""Numbers of the covariance, of half turns and of the causes of misfits, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import covariance, half_turns, next_view
from camcal.assess.causes import search
from camcal.model.pose import Pose, Poses
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import refine
from tests.sides import LESS, MORE
from tests.solved import solved


@pytest.mark.parametrize(("share", "coupled"), [(LESS, True), (MORE, False)])
def test_parameters_that_are_multiples_of_each_other(share, coupled):
    """By the squared sine of the angle between them, which rounding leaves to a few 1e-16."""
    sine = np.sqrt(share * covariance.COUPLED)
    rows = np.array([1.0, 0.0]), 3.0 * np.array([np.sqrt(1 - sine**2), sine])
    assert covariance._coupled(*rows) == coupled


def test_rounds_of_views_that_change_sides(monkeypatch):
    """Here a view changes sides in each round."""
    monkeypatch.setattr(half_turns, "half_turn", lambda *_: Pose(np.eye(3), np.zeros(3)))
    monkeypatch.setattr(half_turns, "renamed", lambda data, *_: data)
    monkeypatch.setattr(half_turns, "turned", lambda poses, *_: poses)
    asked = []

    def costs(*_):
        asked.append(1)
        return None, np.array([float(len(asked) % 2)])

    monkeypatch.setattr(half_turns, "refine_poses", costs)
    data = SimpleNamespace(
        view_ids=("a",),
        target={"shape": {"ideal": [[0, 0, 0]]}, "square": 1.0},
        kept=lambda: SimpleNamespace(views=()),
    )
    fit = SimpleNamespace(observations=data, poses=[None], camera=None, fit=SimpleNamespace(cost=1.0))
    monkeypatch.setattr(half_turns, "refit", lambda f, *_: f)
    assert half_turns.decided_by_known(fit, None) is None
    assert len(asked) == 2 * half_turns.ROUNDS


@pytest.mark.parametrize(
    ("gain", "left"), [(1 - MORE * search.LEAST_LEFT, "share"), (1 - LESS * search.LEAST_LEFT, "least")]
)
def test_what_a_predicted_step_may_leave(gain, left):
    cast = SimpleNamespace(linear=SimpleNamespace(cost=2.0))
    found = search.Search._left(cast, 2.0 * gain)
    least = 2.0 * search.LEAST_LEFT
    assert found == pytest.approx(MORE * least if left == "share" else least, rel=1e-9)


@pytest.mark.parametrize(("before", "moved"), [(next_view.MOVED - 1, True), (next_view.MOVED, False)])
def test_suggestions_that_are_moved_about(before, moved):
    asked = []
    poses = Poses(np.eye(3)[None], np.zeros((1, 3)))

    def around(*_):
        asked.append(1)
        return poses[:0]

    cast = SimpleNamespace(
        sigmas=lambda _: np.zeros((1, 2)),
        candidates=SimpleNamespace(around=around, unlike=lambda near, _: np.ones(len(near), bool)),
    )
    added = _Added()
    next_view.NextView._moved(cast, added, poses, added, [None] * before, np.random.default_rng(0))
    assert bool(asked) == moved


class _Added:
    """Information of one view, of which only the sum is asked."""

    def __add__(self, other):
        return self

    def __getitem__(self, _):
        return self


def test_steps_of_the_fit_of_a_cause(monkeypatch):
    """Half of the pictures are stored at half their size: twelve steps leave three times the cost."""
    good = solved("pinhole", views=8)
    data, after = good.observations, np.arange(8) >= 4
    uv = data.uv * np.where(after[data.view], 0.5, 1.0)[:, None]
    made = search.Search(refine(good.camera, good.poses, replace(data, uv=uv)))
    usual, costs = search._SHORT.max_iterations, []
    for steps in (12, usual, 2 * usual):
        monkeypatch.setattr(search, "_SHORT", Options(max_iterations=steps, tolerance=search.NEAR))
        costs.append(made.fit("resized", "split", made._parts("resized", after), after, 0.0).cost)
    assert costs[1] == pytest.approx(costs[2], rel=1e-5) and costs[0] > 2 * costs[1]
