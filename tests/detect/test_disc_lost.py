"""A fit of a disc that ran away to huge numbers is a rejected disc, not an error."""

import numpy as np

from camcal.detect.disc_fit import _judged
from camcal.detect.disc_model import BLUR, COUNT, L11, L22, STEP, Band
from camcal.detect.discs import Discs


def test_a_fit_that_ran_away_is_rejected():
    x, y = np.meshgrid(np.arange(-6.0, 7), np.arange(-6.0, 7))
    value = 200.0 - 150 / (1 + np.exp(2 * (np.hypot(x, y) - 4)))
    both = np.repeat([x.ravel()], 2, 0), np.repeat([y.ravel()], 2, 0), np.repeat([value.ravel()], 2, 0)
    band = Band(*both, np.ones((2, x.size), bool), np.ones(2), 255.0)
    discs = Discs(np.full((2, 2), 20.0), np.repeat([4 * np.eye(2)], 2, 0))
    params = np.zeros((2, COUNT))
    params[:, [L11, L22]], params[:, BLUR], params[:, STEP] = 0.25, 0.9, 150.0
    params[1, L11] = 1e200
    fitted = _judged(band, discs, params, 255.0)
    assert fitted.reasons[1] == "does not look like a disc"
    assert np.isfinite(fitted.covariance[0]).all()
