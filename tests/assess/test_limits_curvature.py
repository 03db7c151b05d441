"""Numbers that decide about curved intervals, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import curvature, uncertainty
from camcal.assess.covariance import End, covariance
from camcal.least_squares.distributions import chi2_quantile
from tests.sides import LESS, MORE
from tests.solved import solved


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


def test_directions_that_are_looked_at(good, monkeypatch):
    class Looked(Exception):
        pass

    def look(*_):
        raise Looked

    monkeypatch.setattr(curvature, "_Valley", look)
    known = covariance(good)
    size = good.free.shape[1]
    for share, looked in ((LESS, True), (MORE, False)):
        matrix, scale = np.eye(size), np.sqrt(np.diag(good.normal.intrinsics)[:size])
        matrix[0, 1] = matrix[1, 0] = 1 - share * curvature.WEAK
        matrix *= np.outer(scale, scale)
        monkeypatch.setattr(curvature, "reduce", lambda *_, m=matrix: m)
        if looked:
            with pytest.raises(Looked):
                list(curvature._curved(good, known))
        else:
            assert list(curvature._curved(good, known)) == []


def test_parameters_that_change_with_an_endless_direction(good, monkeypatch):
    """Those with so much of their variance along it."""
    known = covariance(good)
    size = good.free.shape[1]
    share = np.zeros(size)
    share[:2] = MORE * curvature.SHARE, LESS * curvature.SHARE
    end = End(0, good.camera.params, good.poses, 1.0, True)
    monkeypatch.setattr(curvature, "_inside", lambda *_: None)
    monkeypatch.setattr(curvature, "_curved", lambda *_: iter([(share, np.zeros(size), [end])]))
    assert curvature.beyond_linear(good, known).undetermined == good.camera.lens.names[:1]


def followed(monkeypatch, growth, domain=np.inf, wanted=1.0, asked=None):
    """Where a valley is followed to along one parameter, whose root of the growth is a function of the way.

    `asked` collects the criteria at which the steps of the profile end.
    """
    looked = []

    def problem(*_):
        return SimpleNamespace(linearise=lambda at: None if looked.append(at) or at > domain else 1)

    def optimizer(_):
        def run(held, at, stopping):
            if asked is not None:
                asked.append(stopping)
            return SimpleNamespace(state=at, blocks=SimpleNamespace(cost=1 + wanted * growth(at) ** 2))

        return run

    monkeypatch.setattr(curvature, "Problem", problem)
    monkeypatch.setattr(curvature.optimizers, "make", optimizer)
    design = SimpleNamespace(
        state=0.0, transform=np.eye(1), views=None, problem=SimpleNamespace(lens=None, weights=None)
    )
    valley = SimpleNamespace(
        begin=SimpleNamespace(cost=1.0),
        design=design,
        wanted=wanted,
        _moved=lambda step, state: state + step[0],
    )
    state, grown = curvature._Valley._followed(valley, np.ones(1))
    return state, grown, looked


def test_steps_along_a_valley(monkeypatch):
    first, over = curvature.FIRST, curvature.OVERSHOT
    state, grown, _ = followed(monkeypatch, lambda at: LESS * over * at / first)
    assert (state, grown) == (first, pytest.approx(LESS * over))
    state, grown, looked = followed(monkeypatch, lambda at: MORE * over * at / first)
    assert state < first and 1 <= grown < over and looked[:2] == [first, first / 2]


def test_steps_of_a_profile(monkeypatch):
    """They end where a hundredth of the wanted growth is left to gain, a part of the cost of 1, or after thirty."""
    asked = []
    followed(monkeypatch, lambda _: 1.2, wanted=0.2, asked=asked)
    (stopping,) = asked
    assert stopping.tolerance == pytest.approx(0.002) and stopping.max_iterations == 30


def test_where_a_valley_without_an_end_is_given_up(monkeypatch):
    state, grown, looked = followed(monkeypatch, lambda _: 0.0)
    assert grown == 0 and looked == [curvature.FIRST * curvature.STRIDE**k for k in range(len(looked))]
    assert state / curvature.STRIDE < curvature.FARTHEST <= state


def test_the_shortest_step_into_a_domain(monkeypatch):
    _, grown, looked = followed(monkeypatch, lambda _: 0.0, domain=0.0)
    shortest = curvature.SHORTEST * curvature.FIRST
    assert grown == 1 and looked[-1] < shortest <= looked[-2]


def test_a_model_inside_that_fits_as_well(good, monkeypatch):
    known = covariance(good)
    inner = solved(views=8, model="opencv4")
    ratio = float(chi2_quantile(1 - curvature.REJECTED, 1))
    monkeypatch.setattr(curvature.starts, "regressed", lambda *_: None)
    monkeypatch.setattr(curvature, "contained", lambda _: ["opencv4"])
    for share, taken in ((LESS, True), (MORE, False)):
        cost = good.fit.cost + share * ratio * known.sigma_0**2 / 2
        fit = replace(inner, fit=replace(inner.fit, cost=cost))
        monkeypatch.setattr(curvature, "refine", lambda *_, f=fit: f)
        monkeypatch.setattr(curvature, "covariance", lambda _: known)
        assert (curvature._inside(good, known) is not None) == taken


def test_projections_that_an_undetermined_direction_moves():
    by_params = np.zeros((1, 2, 2))
    by_params[0, :, 0] = 1.0
    for share, undetermined in ((LESS, False), (MORE, True)):
        known = uncertainty.ProjectionUncertainty(
            None,
            np.eye(2),
            np.eye(2),
            np.array([[share * uncertainty._MOVED], [1.0]]),
            np.zeros((6, 2)),
            np.zeros((6, 6)),
        )
        found = known.of_points(np.ones((1, 3)), jacobians=(by_params, np.zeros((1, 2, 6))))
        assert np.isinf(found).any() == undetermined
