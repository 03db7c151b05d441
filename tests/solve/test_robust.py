"""Robust estimation: the losses' constants, the stated rates, breakdown, and whole views."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom

from camcal.errors import UsageError
from camcal.plan.calibrate import calibrate
from camcal.solve import outliers, ransac
from camcal.solve.losses import LOSSES, robust_sigma
from camcal.solve.robust import METHODS, check_method
from camcal.study.points import outlier_moves
from tests.solved import SIZE, camera_of, grid, observe, tilted_poses

BOARD = grid()
TRUTH = camera_of("opencv5")


def boards(seed, views=10, noise=0.2):
    rng = np.random.default_rng(seed)
    return observe(TRUTH, tilted_poses(BOARD, views, rng, shift=1.0), BOARD, noise, rng), rng


def spoilt(data, share, rng):
    views = tuple(replace(v, uv=v.uv + outlier_moves(len(v), share, rng)) for v in data.views)
    return data.with_views(views)


def focal_error(solution):
    return float(np.sqrt(np.square(solution.camera.params[:2] - TRUTH.params[:2]).mean()))


robust = partial(calibrate, robust="auto", checks=False)


# ---- losses
@pytest.mark.parametrize("name", [n for n in LOSSES if n != "linear"])
def test_each_constant_gives_an_efficiency_of_95_percent_in_two_coordinates(name):
    loss = LOSSES[name]

    def mean(function):  # over the Rayleigh distribution, piece by piece: Huber and Tukey have a corner at c
        parts = pairwise((0.0, loss.constant, 12.0))
        return sum(quad(lambda r: function(r) * r * np.exp(-r * r / 2), a, b)[0] for a, b in parts)

    def weight(r):
        return float(loss.weights(np.array([r]), 1.0)[0])

    def slope(r):
        return (weight(r + 1e-5) - weight(r - 1e-5)) / 2e-5

    gain = mean(lambda r: weight(r) + r * slope(r) / 2) ** 2
    noise = mean(lambda r: weight(r) ** 2 * r * r) / 2
    assert gain / noise == pytest.approx(0.95, abs=1e-3)  # the derivative is by differences


def test_redescending_losses_forget_what_is_far():
    lengths = np.array([2.0, 1000.0])
    influence = {name: loss.weights(lengths, 1.0) * lengths for name, loss in LOSSES.items()}
    redescending = {name for name, (near, far) in influence.items() if far < near}
    assert redescending == {"cauchy", "tukey", "geman-mcclure"}


def test_the_scale_stands_up_to_outliers():
    rng = np.random.default_rng(0)
    lengths = np.linalg.norm(rng.normal(0, 0.3, (4000, 2)), axis=1)
    assert robust_sigma(lengths) == pytest.approx(0.3, rel=0.05)  # 2.3 % from 4000 points, twice that
    lengths[:800] = 50.0
    assert robust_sigma(lengths) < 0.45


# ---- the stated rates
def test_no_false_alarm_beyond_the_stated_rate():
    """The test by itself, on residuals of Gaussian noise: 1 of 1000 runs rejects something."""
    data, rng = boards(0, views=8)
    fit = calibrate(data, robust="none", checks=False)
    fit = replace(fit, free=np.zeros((9, 0)), poses=fit.poses[:0])  # noise to which nothing was fitted
    runs = 2000
    alarms = sum(
        outliers.test(replace(fit, residuals=rng.normal(0, 0.2, data.uv.shape))).rejected > 0
        for _ in range(runs)
    )
    # a count that the stated rate exceeds once in a thousand
    assert alarms <= binom.isf(1e-3, runs, outliers.ALPHA)


def test_clean_data_get_the_least_squares_answer_itself():
    data, _ = boards(1)
    plain, found = calibrate(data, robust="none", checks=False), robust(data)
    np.testing.assert_array_equal(found.camera.params, plain.camera.params)
    assert "robust" not in found.fit.info


def test_samples_are_as_many_as_the_confidence_asks_for():
    n = ransac.samples_needed(4, 0.999, 0.55)
    assert (1 - 0.55**4) ** n <= 1 - 0.999 < (1 - 0.55**4) ** (n - 1)


# ---- breakdown
def test_the_error_at_20_percent_is_that_of_clean_data_within_a_half():
    clean, dirty = [], []
    for seed in range(6):
        data, rng = boards(seed)
        clean.append(focal_error(robust(data)))
        dirty.append(focal_error(robust(spoilt(data, 0.2, rng))))
    assert np.sqrt(np.mean(np.square(dirty))) < 1.5 * np.sqrt(np.mean(np.square(clean)))


def test_nearly_all_outliers_are_found_at_40_percent_and_no_good_point_is_lost():
    data, rng = boards(7)
    dirty = spoilt(data, 0.4, rng)
    bad = [np.abs(a.uv - b.uv).max(1) > 0 for a, b in zip(data.views, dirty.views, strict=True)]
    found = robust(dirty)
    rejected = [~m for m in found.observations.split(found.used)]
    assert all(r[b].all() for r, b in zip(rejected, bad, strict=True))  # all are 5 px or more off
    assert sum(int(r[~b].sum()) for r, b in zip(rejected, bad, strict=True)) <= 1


def test_how_it_was_done_is_said():
    data, rng = boards(2)
    said = robust(spoilt(data, 0.2, rng)).fit.info["robust"]
    assert said["begun_from"] == "the points on which RANSAC agrees"
    # the median of all points is the 0.5 / 0.8 quantile of the good ones, 1.19 times as large; 4 % from 540
    assert said["sigma"] == pytest.approx(1.19 * 0.2, rel=0.12)
    assert said["ransac_confidence"] == ransac.CONFIDENCE


def test_the_same_seed_gives_the_same_answer():
    data, rng = boards(3)
    dirty = spoilt(data, 0.3, rng)
    np.testing.assert_array_equal(robust(dirty, seed=5).camera.params, robust(dirty, seed=5).camera.params)


@pytest.mark.parametrize("method", [m for m in METHODS if m not in ("none", "auto")])
def test_each_loss_stands_up_to_a_tenth(method):
    data, rng = boards(4)
    found = calibrate(spoilt(data, 0.1, rng), model="opencv5", robust=method, checks=False)
    plain = calibrate(spoilt(data, 0.1, rng), model="opencv5", robust="none", checks=False)
    assert found.fit.loss == method
    assert focal_error(found) < 2.0 < focal_error(plain)


def test_a_method_that_is_none():
    with pytest.raises(UsageError, match="hubr"):
        check_method("hubr")


# ---- whole views
def test_a_view_that_does_not_belong_goes_as_a_whole():
    data, rng = boards(5)
    views = list(data.views)
    views[4] = replace(views[4], uv=rng.uniform(0, SIZE, (54, 2)))
    found = robust(data.with_views(tuple(views)))
    assert len(found.poses) == 9
    (entry,) = found.observations.skipped
    assert (entry.id, entry.status) == (views[4].id, "rejected")
    assert focal_error(found) < 2.0


def test_a_view_of_more_noise_keeps_its_points():
    data, rng = boards(6)
    views = list(data.views)
    views[4] = replace(views[4], uv=views[4].uv + rng.normal(0, 0.5, (54, 2)))
    found = robust(data.with_views(tuple(views)))
    assert len(found.poses) == 10
    assert found.used[found.observations.slices[4]].sum() >= 52


@pytest.mark.parametrize("stated", [True, False])
def test_a_view_that_is_stated_to_be_inexact_is_kept(stated):
    """A picture without anti-aliasing is ten times as inexact as the others and says so."""
    data, rng = boards(5, noise=0.02)
    noisy = data.views[3]
    moved = replace(noisy, uv=noisy.uv + rng.normal(0, 0.2, noisy.uv.shape))
    views = tuple(moved if v is noisy else v for v in data.views)
    sigmas = [0.2 if stated and v is moved else 0.02 for v in views]
    given = data.with_views(
        [replace(v, sigma=np.full(len(v), s)) for v, s in zip(views, sigmas, strict=True)]
    )
    solution = robust(given)
    lost = [s.reason for s in solution.observations.skipped]
    assert len(lost) == (0 if stated else 1)
    assert focal_error(solution) < 0.5  # px; 0.1 % of the focal length


def test_what_is_stated_allows_no_point_that_is_farther_off():
    data, _ = boards(6, noise=0.02)
    view = data.views[3]
    uv = view.uv + np.where(np.arange(len(view))[:, None] == 7, 3.0, 0.0)  # 3 px, of 0.2 px stated
    sigma = np.where(np.arange(len(view)) == 7, 0.2, 0.02)
    views = [
        replace(v, uv=uv, sigma=sigma) if v is view else replace(v, sigma=np.full(len(v), 0.02))
        for v in data.views
    ]
    solution = robust(data.with_views(views))
    assert [int(n) for n in np.flatnonzero(~solution.observations.used)] == [3 * len(view) + 7]


# ---- poses before a known camera
@pytest.mark.parametrize("share", [0.4, 0.6])
def test_a_pose_is_found_among_outliers(share):
    data, rng = boards(8, views=1)
    dirty = spoilt(data, share, rng)
    sigma = 0.2 if share > 0.5 else None  # beyond a half the noise has to be known
    (agreed,) = ransac.of_poses(dirty.views, TRUTH, sigma=sigma)
    good = np.abs(dirty.views[0].uv - data.views[0].uv).max(1) == 0
    assert (agreed.mask & ~good).sum() == 0
    assert (agreed.mask & good).sum() >= 0.9 * good.sum()
