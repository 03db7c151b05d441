"""Projections by way of spheres at the bounds of their parameters."""

import itertools

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.lenses.spheres import LEAST_BETA, LEAST_XI

VALUES = {"alpha": (0.0, 1e-9, 0.5, 1.0), "beta": (LEAST_BETA, 1.0, 50.0), "xi": (LEAST_XI, 0.0, 1.0)}


@pytest.mark.parametrize("spec", ["ucm", "eucm", "ds"])
def test_the_domain_at_the_bounds(spec):
    """Nothing is divided by 0, and what is said to project is a number; the axis always does."""
    lens = lenses.make(spec)
    own = lens.names[4:]
    angle = np.linspace(0, np.pi, 181)
    xyz = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1)
    for values in itertools.product(*(VALUES[n] for n in own)):
        matrix = {"fx": 300.0, "fy": 300.0, "cx": 320.0, "cy": 240.0}
        params = lens.from_values(matrix | dict(zip(own, values, strict=True)))
        assert lens.within_bounds(params)
        limit = lens.limit_angle(params)
        assert 0 < limit < np.pi, values
        uv, valid = lens.project(params, xyz)
        np.testing.assert_array_equal(
            valid[np.abs(angle - limit) > 1e-9], (angle < limit)[np.abs(angle - limit) > 1e-9]
        )
        assert np.isfinite(uv[valid]).all() and valid[0] and not valid[-1]
        radius = uv[valid, 0]
        assert (np.diff(radius) > 0).all(), values


@pytest.mark.parametrize(
    "spec, name, beyond", [("ds", "xi", -1.0), ("eucm", "beta", 0.0), ("ucm", "alpha", 1.01)]
)
def test_beyond_the_bounds(spec, name, beyond):
    lens = lenses.make(spec)
    params = lens.examples()[0][0]
    params[lens.index(name)] = beyond
    assert not lens.within_bounds(params)
