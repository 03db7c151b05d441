"""Numbers of the closed forms with distortion, each from both sides."""

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.start import claus, dlt_distorted, five_points
from tests.sides import LESS, MORE

from . import scenes


def test_the_prior_of_quadratic_terms():
    """The smallest sum of squares, of two unit vectors: one of a quadratic term, and one that has none."""
    noise, quadratic = 1e-3, np.array([1.0, 0, 0])
    for share, chosen in ((LESS, 1), (MORE, 0)):
        rows = np.diag([np.sqrt(noise), np.sqrt(share * noise * (1 + claus.PRIOR)), 10.0])
        assert abs(claus._least(rows, quadratic)[chosen]) == pytest.approx(1)


def test_the_least_noise_of_equations():
    """Of exact data, beside which the prior counts."""
    floor = claus.LEAST_NOISE**2 * 3.0
    for share, chosen in ((LESS, 1), (MORE, 0)):
        rows = np.diag([0.0, np.sqrt(share * claus.PRIOR * floor), np.sqrt(3.0)])
        assert abs(claus._least(rows, np.array([1.0, 0, 0]))[chosen]) == pytest.approx(1)


@pytest.mark.parametrize(("share", "determined"), [(LESS, False), (MORE, True)])
def test_coefficients_that_are_undetermined(monkeypatch, share, determined):
    """By the smallest singular value of the equations."""
    solve = np.linalg.lstsq

    def solved(rows, right, rcond):
        found = solve(rows, right, rcond)
        singular = found[3].copy()
        singular[-1] = share * dlt_distorted.UNDETERMINED * singular[0]
        return *found[:3], singular

    monkeypatch.setattr(np.linalg, "lstsq", solved)
    made = scenes.scene(scenes.rig(), [[0.3, -0.4, 0.2]], scenes.K, 0.0).observations
    if determined:
        assert dlt_distorted.estimate12(made).matrix[0, 0] > 0
    else:
        with pytest.raises(EstimationError, match="undetermined"):
            dlt_distorted.estimate12(made)


def equations(wrong, seed=0, count=30):
    """A plane through a division model, of which so many points lie elsewhere."""
    rng = np.random.default_rng(seed)
    x = np.c_[rng.uniform(-1, 1, (count, 2)), np.ones(count)]
    h = np.array([[0.5, 0.02, 0.03], [-0.01, 0.45, 0.05], [0.05, -0.1, 1.0]])
    ideal = x @ h.T
    ideal = ideal[:, :2] / ideal[:, 2:]
    r2 = np.square(ideal).sum(1, keepdims=True)
    pixels = ideal * 2 / (1 + np.sqrt(1 + 4 * 0.3 * r2)) + 2e-4 * rng.normal(size=ideal.shape)
    pixels[:wrong] = rng.uniform(-0.8, 0.8, (wrong, 2))
    none = np.zeros_like(x)
    (u, v), rho = pixels.T[:, :, None], np.square(pixels).sum(1)[:, None]
    d1 = np.stack([np.c_[none, -x, v * x], np.c_[x, none, -u * x], np.c_[-v * x, u * x, none]], 1)
    d2 = np.stack([np.c_[none, -rho * x, none], np.c_[rho * x, none, none], np.c_[none, none, none]], 1)
    return five_points.Equations(x, pixels, d1, d2)


@pytest.mark.parametrize(("samples", "most"), [(five_points.SAMPLES, 0), (2, 20)])
def test_samples_of_five_points(monkeypatch, samples, most):
    """With three of ten points wrong: none of twenty views goes wrong, and with two samples many do."""
    monkeypatch.setattr(five_points, "SAMPLES", samples)
    wrong = [five_points.agreeing(equations(9, s), s) for s in range(20)]
    failed = sum(bool(a[:9].sum() > 2 or a[9:].sum() < 15) for a in wrong)
    assert failed <= most and (failed > 5) == (most > 0)


def test_fits_to_the_points_that_agree(monkeypatch):
    """Three lower the median of the squared distances as far as six do, and a sample alone is above."""
    near, last = five_points._near, []
    monkeypatch.setattr(
        five_points, "_near", lambda squares: last.append(np.median(squares)) or near(squares)
    )
    medians = {}
    for fits in (0, five_points.OPTIMISED, 2 * five_points.OPTIMISED):
        monkeypatch.setattr(five_points, "OPTIMISED", fits)
        ends = []
        for seed in range(8):
            five_points.agreeing(equations(6, seed), seed)
            ends.append(last[-1])
        medians[fits] = np.mean(ends)
    few, usual, more = medians.values()
    assert usual == pytest.approx(more, rel=0.05) and few > 1.5 * usual
