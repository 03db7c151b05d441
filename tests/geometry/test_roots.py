"""Roots that are real up to rounding."""

import numpy as np

from camcal.geometry import roots
from camcal.least_squares import scales


def test_both_sides_of_rounding():
    for size in (0.0, 3.0, -1e6):
        limit = roots.ROUNDING * (1 + abs(size))
        values = np.array([size + 0.999j * limit, size - 0.999j * limit, size + 1.001j * limit])
        assert roots.are_real(values).tolist() == [True, True, False]
    assert not roots.are_real(np.array([np.inf + 0j, complex(np.nan, 0)])).any()


def test_a_double_root():
    assert roots.are_real(np.roots(np.poly([1.0, 1.0, 2.0]))).all()
    assert not roots.are_real(np.roots([1.0, 0.0, 1.0])).any()


def test_scales_of_the_normal_distribution():
    x = np.abs(np.random.default_rng(0).normal(size=200_000))
    # the median of so many has a standard deviation of .002
    assert abs(np.median(x) - scales.NORMAL_MEDIAN) < 0.01
    assert scales.MAD * scales.NORMAL_MEDIAN == 1
    assert scales.of_small_sample(12, 7) == 2 and scales.of_small_sample(5, 7) == 6
