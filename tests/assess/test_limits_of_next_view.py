"""The search for the next view: more work finds nothing better, and too little of it something worse."""

from functools import cache

import numpy as np
import pytest

from camcal.assess import next_view
from tests.solved import solved


@cache
def searches():
    good = solved(views=5)
    return [next_view.NextView(good, candidates=80, seed=seed) for seed in (1, 2)]


def worst():
    """The mean of the worst uncertainty after the next view over two seeds, px."""
    return np.mean([search.best()[0].worst for search in searches()])


@pytest.mark.parametrize(("name", "few"), [("ROUNDS", 3), ("BEST", 1), ("COPIES", 1)])
def test_how_far_poses_are_moved_about(monkeypatch, name, few):
    found = []
    for value in (few, getattr(next_view, name), 2 * getattr(next_view, name)):
        monkeypatch.setattr(next_view, name, value)
        found.append(worst())
    # one seed differs from another by 8 %
    assert found[2] > 0.95 * found[1] and found[0] > 1.2 * found[1]


def test_moves_that_become_small_too_soon(monkeypatch):
    usual = worst()
    monkeypatch.setattr(next_view, "DECAY", 0.3)
    assert worst() > 1.2 * usual
