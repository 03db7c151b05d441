"""Honest uncertainty: NEES and NIS inside their bounds when the camera moves as the filter was told."""

import numpy as np
import pytest
from scipy.stats import chi2

from camcal.track.simulate import SEQUENCES

from .helpers import follow, made_for, make, nees, sequence, true_estimate

RUNS, FRAMES = 10, 50


def run(method, kind, count=FRAMES, **options):
    values, states = [], []
    for seed in range(RUNS):
        frames, truths = sequence(kind, count, seed=seed, outliers=0.05)
        estimator = made_for(method, kind, **options)
        found = follow(estimator, frames)
        values.append([nees(estimator, s, t) for s, t in zip(found, truths, strict=True)])
        states += found
    return np.array(values), estimator.model.size, states


@pytest.mark.parametrize("kind", [k for k in SEQUENCES if k != "knock"])
@pytest.mark.parametrize("method", ["kalman", "iekf"])
def test_nees_is_within_its_bounds(method, kind):
    values, size, states = run(method, kind)
    low, high = chi2.ppf([0.025, 0.975], RUNS * size) / RUNS
    mean = values.mean(0)
    # 95 % of the frames are expected inside; those of one run are correlated, so that few are independent
    assert np.mean((mean >= low) & (mean <= high)) > 0.8
    # Four frames, far enough apart to be nearly independent, together: bounds of probability 1e-4.
    some = values[:, [0, 16, 32, 49]].sum()
    low, high = chi2.ppf([5e-5, 1 - 5e-5], RUNS * size * 4)
    assert low < some < high
    assert not any(s.changed for s in states)


@pytest.mark.parametrize("method", ["batch", "rls", "window", "smoother"])
def test_nees_of_the_others_on_a_standing_camera(method):
    values, size, _ = run(method, "static", count=25)
    low, high = chi2.ppf([5e-5, 1 - 5e-5], RUNS * size)
    assert low < values[:, -1].sum() < high


@pytest.mark.parametrize("gain", ["forgetting", "fixed", "mean", "adaptive", "kalman"])
def test_every_gain_states_its_own_uncertainty(gain):
    values, size, _ = run("kalman", "static", gain=gain)
    low, high = chi2.ppf([5e-5, 1 - 5e-5], RUNS * size)
    assert low < values[:, -1].sum() < high


@pytest.mark.parametrize("kind", ["thermal", "pan"])
def test_scores_are_standard_normal(kind):
    _, _, states = run("iekf", kind)
    scores = np.array([s.score for s in states if s.status == "updated"])
    # white under the right model: mean 0 within 4.5 / sqrt(n), spread 1 within 4.5 / sqrt(2 n)
    assert abs(scores.mean()) < 4.5 / np.sqrt(len(scores))
    assert abs(scores.std() - 1) < 4.5 / np.sqrt(2 * len(scores))


def test_central_as_it_stands_is_biased_and_the_filter_is_not():
    """Errors in variables: Central's rows hold the measured points, and their noise does not average out."""
    from camcal.start import central

    # strong noise: the bias grows with its variance, the uncertainty of the mean with its standard deviation
    frames, truths = sequence("static", 1500, noise=12.0, points=30, distance=3.0, image_size=None)
    estimator = make("kalman", motion="fixed")
    last = follow(estimator, frames)[-1]
    truth = true_estimate(estimator.model, truths[-1])
    filtered = estimator.model.local(truth, last.estimate)
    rows = [estimator.model.normalise(f, np.ones(len(f), bool)) for f in frames]
    stacked, _ = central.projection_matrix(*(np.concatenate(part) for part in zip(*rows, strict=True)))
    algebraic = stacked.ravel()[:11] - truth
    unbiased, biased = (np.linalg.solve(last.factor, error) for error in (filtered, algebraic))
    assert chi2.sf(unbiased @ unbiased, 11) > 1e-4
    assert chi2.sf(biased @ biased, 11) < 1e-4
