"""Factors just below and just above a number that decides something, and results on both sides of one of accuracy."""

import numpy as np

LESS, MORE = 0.999, 1.001


def same_with_finer_and_not_with_coarser(monkeypatch, owner, constant, coarse, fine, tolerance, example):
    """The result of an example with a number of accuracy is that with a finer one, and not that with a coarser one."""
    found = []
    for value in (getattr(owner, constant), fine, coarse):
        monkeypatch.setattr(owner, constant, value)
        found.append(np.nan_to_num(np.atleast_1d(np.asarray(example(), float))))
    usual, finer, coarser = found
    np.testing.assert_allclose(usual, finer, rtol=0, atol=tolerance)
    assert usual.shape != coarser.shape or np.abs(usual - coarser).max() > tolerance
