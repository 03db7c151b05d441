"""The distortion of the plane: its fold, and the quick answer whether points lie before it."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from camcal.model.lenses.plane import PlaneDistortion

RADIAL = PlaneDistortion(("n1", "n2", "n3"))
RATIONAL = PlaneDistortion(("n1", "n2", "p1", "p2", "n3", "d1", "d2", "d3"))
coefficients = st.lists(st.floats(-0.5, 0.5), min_size=8, max_size=8)


def grows(plane, c, s):
    """By what `linearise` says of one point at radius sqrt(s)."""
    a = np.array([[np.sqrt(s)]])
    with np.errstate(all="ignore"):
        return plane.linearise(c, a, 0 * a, np.empty((1, len(c), 2, 1)), 1.0, 1.0)[1]


@pytest.mark.parametrize("plane", [RADIAL, RATIONAL])
@given(coefficients, st.floats(0.0, 4.0))
def test_grows_up_to_the_fold_and_not_beyond(plane, values, s):
    c = np.array(values)[: len(plane.terms)]
    fold = plane.fold(c)
    assume(abs(np.sqrt(s) - fold) >= 1e-6)  # a double root is known to the root of the rounding only
    assert grows(plane, c, s) == (s < fold**2)
    if np.isfinite(fold) and 1e-3 < fold < 1e3:
        assert grows(plane, c, (0.999 * fold) ** 2) and not grows(plane, c, (1.001 * fold) ** 2)


def test_no_number_is_outside():
    assert grows(RADIAL, np.zeros(3), 5.0)
    assert not grows(RADIAL, np.zeros(3), np.nan) and not grows(RADIAL, np.array([np.nan, 0, 0]), 0.1)


def test_the_radial_slope_is_zero_at_the_fold():
    c = np.array([-0.28, 0.1, 1e-3, 2e-3, -0.02, 0.02, 0.01, 1e-3])
    c[2:4] = 0.0
    fold = RATIONAL.fold(c)
    slope = RATIONAL.derivatives(c, np.array([fold]), np.zeros(1))[2]
    assert (
        abs(slope[0]) < 1e-12 and RATIONAL.derivatives(c, np.array([0.99 * fold]), np.zeros(1))[2][0] > 1e-3
    )
