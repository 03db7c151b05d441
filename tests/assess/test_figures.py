"""The definitions of the error figures, on numbers that can be checked by hand."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess import figures
from tests.solved import solved

RESIDUALS = np.array([[3.0, 4.0], [0.0, 0.0], [0.0, 1.0], [2.0, 0.0]])


def test_definitions():
    f = figures.of(RESIDUALS)
    assert f.points == 4
    assert f.rms_point == pytest.approx(np.sqrt(30 / 4))
    assert f.rms_coord == pytest.approx(np.sqrt(30 / 8))
    assert f.median == pytest.approx(1.5) and f.max == 5.0
    assert figures.rms_point(RESIDUALS) == f.rms_point


def test_nothing_is_nan_and_not_zero():
    assert np.isnan(figures.of(np.zeros((0, 2))).rms_point)
    assert np.isnan(figures.rms_point(np.zeros((0, 2))))


def test_sigma_hat_counts_the_parameters():
    s = solved(views=4)
    r = s.used_residuals
    freedom = 2 * 4 * 54 - (9 + 6 * 4)
    assert figures.redundancy(s) == freedom
    assert figures.sigma_hat(s) == pytest.approx(np.sqrt((r**2).sum() / freedom))
    assert figures.sigma_0(s) == pytest.approx(figures.sigma_hat(s))


def test_rejected_points_do_not_count():
    s = solved(views=4)
    masks = s.observations.split(s.used.copy())
    masks[0][:10] = False
    fewer = replace(s, observations=s.observations.with_used(np.concatenate(masks)))
    assert figures.overall(fewer).points == 4 * 54 - 10
    assert [f.points for f in figures.per_view(fewer)] == [44, 54, 54, 54]
    assert figures.redundancy(fewer) == figures.redundancy(s) - 20
