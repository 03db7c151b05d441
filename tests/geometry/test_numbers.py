"""Statistics without numpy's slow imports, against numpy's own."""

import subprocess
import sys

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry.numbers import distinct, distinct_rows, median, percentiles

VALUES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


@given(VALUES, st.lists(st.floats(0, 100), min_size=1, max_size=4))
def test_percentiles_are_those_of_numpy(values, wanted):
    found = percentiles(np.array(values), wanted)
    np.testing.assert_allclose(found, np.percentile(values, wanted), rtol=1e-13, atol=1e-9)


def test_percentiles_of_nothing_and_of_nan():
    assert np.isnan(percentiles(np.zeros(0), [50])).all()
    assert np.isnan(percentiles(np.array([1.0, np.nan]), [0, 50])).all()


@given(VALUES)
def test_the_median_is_that_of_numpy(values):
    assert median(np.array(values)) == np.median(values)
    rows = np.array([values, values[::-1]])
    np.testing.assert_array_equal(median(rows, 1), np.median(rows, axis=1))
    np.testing.assert_array_equal(median(rows, 0), np.median(rows, axis=0))


def test_the_median_of_nothing_and_of_nan():
    assert np.isnan(median(np.zeros(0)))
    np.testing.assert_array_equal(median(np.array([[1.0, np.nan], [2.0, 3.0]]), 1), [np.nan, 2.5])


def test_the_median_of_grey_values_does_not_overflow():
    grey = np.array([[200, 250], [255, 255]], np.uint8)
    assert median(grey) == np.median(grey) == 252.5
    np.testing.assert_array_equal(median(grey, 1), [225, 255])


def test_distinct_values_and_rows():
    rows = np.random.default_rng(0).integers(0, 3, (50, 2))
    np.testing.assert_array_equal(distinct(rows[:, 0]), np.unique(rows[:, 0]))
    np.testing.assert_array_equal(distinct(rows, axis=0), np.unique(rows, axis=0))


def test_neither_imports_masked_arrays():
    code = (
        "import sys, numpy as np; from camcal.geometry.numbers import distinct, distinct_rows, median, percentiles;"
        "distinct(np.arange(9)); distinct(np.eye(3), axis=0); percentiles(np.arange(9), (5, 50)); median(np.arange(9));"
        "sys.exit('numpy.ma' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@given(
    st.lists(st.tuples(st.integers(-2, 2), st.integers(-2, 2), st.integers(-1, 1)), min_size=1, max_size=40)
)
def test_distinct_rows_are_those_of_numpy(rows):
    values = np.array(rows, float)
    points, first, number = np.unique(values, axis=0, return_index=True, return_inverse=True)
    found, of = distinct_rows(values)
    np.testing.assert_array_equal(found, first)
    np.testing.assert_array_equal(of, number.reshape(-1))
    np.testing.assert_array_equal(distinct(values, axis=0), points)
