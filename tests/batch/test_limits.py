"""The limit of the control charts: the quantile of its closed form, and never below Shewhart's."""

import pytest
from scipy.stats import t

from camcal.batch import fleet


@pytest.mark.parametrize("tests", [1, 20])
def test_false_alarms_of_a_fleet(tests):
    """1.57 is π / 2 and .37 is 1 / (2 x 1.36), of Huber & Ronchetti; one fleet of twenty has a false alarm."""
    cameras = 30
    wanted = t.isf(0.05 / 2 / tests, 0.37 * (cameras - 1)) * (1 + 1.57 / cameras) ** 0.5
    assert fleet.limit_for(tests, cameras) == pytest.approx(max(3.0, wanted), rel=1e-9)
    assert (wanted > 3.0) == (tests > 1)
