"""Other coordinates of rotations, for comparison."""

import numpy as np
import pytest

from camcal.geometry import rotations
from camcal.solve import coordinates, optimizers, tangent
from camcal.solve.coordinates import OtherRotations
from tests.solve.problems import problem_of, step_of

KINDS = ("vector", "quaternion", "euler")


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_against_differences(kind):
    r = rotations.exp(np.random.default_rng(0).normal(0, 0.8, (20, 3)))
    c, d = coordinates.coordinates(kind, r), coordinates.derivatives(kind, r)
    np.testing.assert_allclose(coordinates.to_rotations(kind, c), r, atol=1e-14)
    for i in range(c.shape[1]):
        step = np.zeros(c.shape[1])
        step[i] = 1e-6
        both = [coordinates.to_rotations(kind, c + s * step) @ r.transpose(0, 2, 1) for s in (1, -1)]
        slopes = (rotations.log(both[0]) - rotations.log(both[1])) / 2e-6
        # central differences of 1e-6: rounding 1e-10, curvature 1e-12
        np.testing.assert_allclose(d[:, :, i], slopes, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_and_optimum(kind):
    problem, state = problem_of(fix={"aspect": None})
    other = OtherRotations(problem, kind)
    blocks = other.linearise(state)
    rng = np.random.default_rng(1)
    width = blocks.poses.shape[1]
    vector = np.concatenate([step_of(problem, rng).intrinsics, 1e-3 * rng.normal(size=5 * width)])
    slope = [
        other.linearise(other.retract(state, tangent.unflat(f * vector, problem.variables, width))).cost
        for f in (1e-3, -1e-3)
    ]
    assert tangent.gradient(blocks) @ vector == pytest.approx((slope[0] - slope[1]) / 2e-3, rel=1e-4)
    usual = optimizers.make("lm:schur")(problem, state)
    found = optimizers.make("lm:schur")(other, state)
    assert found.converged and found.blocks.cost == pytest.approx(usual.blocks.cost, rel=1e-10)
