"""Numbers of the closed forms with distortion, each from both sides."""

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.start import claus, dlt_distorted, fitzgibbon, five_points, leave_one_out, mdlt, shape, zhang
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


# ------------------------------------------------------------------------------------ further closed forms
@pytest.mark.parametrize(("share", "predicted"), [(LESS, False), (MORE, True)])
def test_points_that_a_fit_follows(share, predicted):
    """One unknown that is nearly a coordinate of the first point alone: I - H is 1 and what is left of it."""
    left = share * leave_one_out.FOLLOWED
    jacobian = np.array([[np.sqrt(1 - left)], [0.0], [np.sqrt(left)], [0.0]])
    assert np.isfinite(leave_one_out.rms_point(np.zeros(4), jacobian, np.ones(2))) == predicted


def test_steps_of_the_modified_dlt_that_are_halved(monkeypatch):
    """Nothing gets better: the last of ten lengths is 2⁻⁹ of a step."""
    asked = []

    def equations(n, *_):
        asked.append(n)
        return np.full(1, float(len(asked))), None

    monkeypatch.setattr(mdlt, "_equations", equations)
    monkeypatch.setattr(mdlt, "_condition", lambda _: (float(len(asked)), None))
    m, step = np.eye(3, 4), np.ones((3, 4))
    taken = mdlt._taken(m, step, None, None, None)
    wanted = m + step * 0.5 ** (mdlt.HALVINGS - 1)
    np.testing.assert_allclose(taken, wanted / np.linalg.norm(wanted), atol=1e-15)
    assert len(asked) == mdlt.HALVINGS + 1


@pytest.mark.parametrize(("views", "asked"), [(11, 11), (12, 12), (13, 7), (24, 12), (25, 9)])
def test_views_from_which_candidates_are_taken(monkeypatch, views, asked):
    """Spread over all of them, at most twelve."""
    made = []
    monkeypatch.setattr(fitzgibbon, "eig", lambda *_, **__: made.append(1) or np.zeros(0))
    monkeypatch.setattr(fitzgibbon, "are_real", lambda values: values == values)
    one = equations(0, count=8)
    fitzgibbon._candidate([one] * views)
    assert len(made) == asked <= fitzgibbon.CANDIDATE_VIEWS


def test_rounding_of_the_points_of_a_homography(monkeypatch):
    """The noise of exact points is that of the rounding of their largest coordinate, and no less."""
    data = scenes.scene(scenes.board(), scenes.tilts(2)).observations
    floor = (zhang.ROUNDING * np.abs(data.uv).max()) ** 2
    form = shape.check(data)
    sizes = []
    for variance in (0.0, LESS * floor, MORE * floor, 4 * floor):
        monkeypatch.setattr(zhang, "_variance", lambda *_, v=variance: v)
        (planes,) = zhang._planes([(data, form)])
        sizes.append(np.trace(planes.covariances[0]))
    assert np.array(sizes) / sizes[0] == pytest.approx([1, 1, MORE, 4], rel=1e-9)
