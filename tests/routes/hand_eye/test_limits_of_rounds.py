"""Rounds of the joint estimate and halvings of its variances, from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.routes.hand_eye import estimate, variance
from tests.sides import LESS, MORE


@pytest.mark.parametrize(("share", "rounds"), [(LESS, 1), (MORE, 30)])
def test_rounds_of_variances_and_unknowns(monkeypatch, share, rounds):
    """They end where no standard deviation changes by more than a thousandth, and after thirty."""

    class EndedError(Exception):
        pass

    def ended():
        raise EndedError
        yield

    solved = []
    linear = SimpleNamespace(image=np.zeros(1))
    begin = SimpleNamespace(image=None, noise=np.ones(3), problem=None)
    monkeypatch.setattr(estimate, "start", lambda *_: begin)
    monkeypatch.setattr(estimate, "Joint", lambda *_: SimpleNamespace(linear=lambda _: linear))
    monkeypatch.setattr(estimate, "solve", lambda *_: solved.append(1))
    change = np.exp(share * estimate.SETTLED)
    monkeypatch.setattr(
        estimate.variance,
        "estimate",
        lambda _, noise, __: SimpleNamespace(noise=noise * np.array([1, change, 1])),
    )
    pictures = SimpleNamespace(shifts=None, freedom=1, views=ended())
    with pytest.raises(EndedError):
        estimate._estimate("in-hand", pictures, None, None)
    assert len(solved) == rounds and rounds in (1, estimate.MOST_ROUNDS)


@pytest.mark.parametrize(("end", "found"), [(MORE, True), (LESS, False)])
def test_steps_of_variances_that_are_halved(end, found):
    """The last of thirty lengths is 2⁻²⁹ of a step: the likelihood rises up to there, or not as far."""
    end = end * 0.5 ** (variance.HALVINGS - 1)
    cast = SimpleNamespace(at=lambda trial: SimpleNamespace(likelihood=float(trial[0] < end)))
    here = SimpleNamespace(likelihood=0.5)
    logs = np.zeros(1)
    trial, there, moved = variance._Model.uphill(cast, logs, here, np.ones(1), np.full(1, -9.0))
    assert (moved > 0) == found and (there is here) != found and (trial is logs) != found
