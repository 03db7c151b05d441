"""Rounds of turned boards and steps to a readout time, each from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model.pose import Poses
from camcal.plan import boards, rig_turns
from tests.sides import LESS, MORE


def test_rounds_of_turns_and_poses(monkeypatch):
    """The solution of the best sample, and three of all instants, the last of which counts."""
    nearest = []

    def found(*_):
        nearest.append(1)
        return float(len(nearest)), *[Poses(np.eye(3)[None], np.full((1, 3), len(nearest)))] * 2

    monkeypatch.setattr(rig_turns, "_samples", lambda _: iter([[0, 1, 2]]))
    monkeypatch.setattr(rig_turns, "_ways", lambda *_: [[(0, 1)] * 3])
    monkeypatch.setattr(rig_turns, "_nearest", found)
    two = Poses(np.tile(np.eye(3), (4, 2, 1, 1)), np.zeros((4, 2, 3)))
    last, _ = rig_turns.agreed_both(two, two, lambda *_: None)
    assert len(nearest) == 4 and last.translations[0, 0] == 4


@pytest.mark.parametrize(("share", "fits"), [(LESS, 1), (MORE, 4)])
def test_steps_to_a_readout_time(monkeypatch, share, fits):
    """They end where what is left is below its sigma, of .01 frames, and after four; all steps but the last count."""
    monkeypatch.setattr(boards, "refit", lambda *_: None)
    monkeypatch.setattr(boards.rolling, "corrected", lambda *_: None)
    left = SimpleNamespace(time=share * 0.01, sigma=0.01)
    asked = []
    monkeypatch.setattr(boards.rolling, "readout", lambda _: asked.append(1) or left)
    time, _ = boards._corrected_fit(SimpleNamespace(observations=None), 0.5, None)
    assert len(asked) == fits and time == pytest.approx(0.5 + (fits - 1) * left.time)
