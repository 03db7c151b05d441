"""The change tests: thresholds by theory, checked by simulation; false alarms at the stated rate."""

import numpy as np
import pytest
from scipy.stats import chi2, f, norm

from camcal.track.detection import ChangeTest, cusum_threshold, mean_time_to_alarm, normal_deviate

from .helpers import follow, made_for, sequence


def test_the_deviate_has_the_probability_of_the_statistic():
    for value in (0.5, 11.0, 30.0, 200.0):
        assert norm.sf(normal_deviate(value, 11, np.inf)) == pytest.approx(chi2.sf(value, 11), rel=1e-9)
        tail = f.sf(value / 11, 11, 89)
        assert norm.sf(normal_deviate(value, 11, 89)) == pytest.approx(tail, rel=1e-9)
    assert np.isfinite(normal_deviate(1e9, 11, np.inf))


def simulated_time(threshold, shift, runs, rng):
    """Mean frames to the alarm of many sums run side by side."""
    total, sums = np.zeros(runs), np.zeros(runs)
    alive = np.ones(runs, bool)
    while alive.any():
        total[alive] += 1
        sums[alive] = np.maximum(0, sums[alive] + rng.normal(shift, 1, alive.sum()) - 0.5)
        alive &= sums <= threshold
    return total


@pytest.mark.parametrize(("threshold", "shift"), [(3.0, 0.0), (4.0, 0.0), (5.0, 1.0), (10.0, 2.0)])
def test_mean_time_to_alarm_is_that_of_a_simulation(threshold, shift):
    times = simulated_time(threshold, shift, 4000, np.random.default_rng(0))
    expected = mean_time_to_alarm(threshold, shift)
    assert abs(times.mean() - expected) < 4.5 * times.std() / np.sqrt(len(times))


def test_known_value():
    assert mean_time_to_alarm(5.0) == pytest.approx(930.9, abs=0.5)  # Brook & Evans 1972, table 2: 930


@pytest.mark.parametrize("rate", [1e-2, 1e-4, 1e-6, 1e-8])
def test_threshold_has_the_stated_rate(rate):
    assert mean_time_to_alarm(cusum_threshold(rate)) == pytest.approx(1 / rate, rel=1e-4)


def test_both_tests_together_have_the_stated_rate():
    rate, count = 0.01, 200_000
    test = ChangeTest(rate)
    alarms = 0
    for frame, score in enumerate(np.random.default_rng(1).normal(size=count)):
        if test.step(frame, score):
            alarms += 1
            test.reset()
    # the two tests share some alarms: the sum of their rates is an upper bound; 4.5 sigmas of counting
    expected = rate * count
    assert 0.7 * expected < alarms < expected + 4.5 * np.sqrt(expected)


def test_the_sum_says_where_the_change_began():
    test = ChangeTest(1e-6)
    scores = [-1.0] * 20 + [2.0] * 20
    alarm = None
    for frame, score in enumerate(scores):
        since = test.since
        if test.step(frame, score):
            alarm = frame, since
            break
    assert alarm is not None and alarm[1] == 20 and 25 < alarm[0] < 32  # (2 - 1/2) a frame to 12.7


@pytest.mark.parametrize("method", ["rls", "kalman", "iekf"])
def test_filters_give_false_alarms_at_the_stated_rate(method):
    rate = 0.02
    alarms = frames = 0
    for seed in range(6):
        stream, _ = sequence("static", 250, seed=seed, points=20)
        states = follow(made_for(method, "static", false_alarm=rate), stream)
        alarms += sum(s.changed for s in states)
        frames += len(states)
    expected = rate * frames  # 30
    assert expected / 3 < alarms < expected + 4.5 * np.sqrt(expected)


@pytest.mark.parametrize(("angle", "delay"), [(0.3, 0), (0.03, 1), (0.01, 15)])
def test_a_knock_is_seen_within_the_delay(angle, delay):
    """0.3, 0.03 and 0.01 degrees are 4.7, 0.5 and 0.16 px; one point is good to 0.3 px."""
    for seed in range(5):
        frames, _ = sequence("knock", 160, seed=seed, knock=100, angle=angle)
        states = follow(made_for("kalman", "knock"), frames)
        changed = [s.frame for s in states if s.changed]
        assert changed and 100 <= changed[0] <= 100 + delay, (seed, changed)
