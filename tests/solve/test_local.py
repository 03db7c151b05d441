"""The sparse normal equations of splines against the dense ones of the same problem."""

from dataclasses import fields, replace

import numpy as np
import pytest

from tests.solve.problems import problem_of


@pytest.mark.parametrize("skew", [False, True])
@pytest.mark.parametrize(
    "views", [{}, {"ragged": True}, {"sigma": True}], ids=lambda more: "".join(more) or "plain"
)
def test_the_same_as_dense(views, skew):
    fix = {} if skew else dict.fromkeys(("fx", "left"))  # with all columns free, and without some
    problem, state = problem_of("spline:6x5", fix, skew, **views)
    dense = problem.assembled(state, lambda group, block: None).blocks()
    sparse = problem.linearise(state)
    for field in fields(dense):
        want, got = getattr(dense, field.name), getattr(sparse, field.name)
        # sums of a hundred products in another order
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.abs(want).max(), err_msg=field.name)


def test_outside_the_domain_there_are_none():
    problem, state = problem_of("spline:6x5")
    assert problem.linearise(replace(state, centres=state.centres * [1, 1, -1])) is None
    params = state.params.copy()
    params[0] = 0.0
    assert problem.linearise(replace(state, params=params)) is None
