"""Numbers of the least-squares loop over blocks, of the damping and of the distributions, each from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.least_squares import blocks, distributions
from camcal.least_squares.problem import STUCK
from tests.least_squares.test_loop import Scripted, run
from tests.sides import LESS, MORE, same_with_finer_and_not_with_coarser


# ------------------------------------------------------------------------------------ blocks
@pytest.mark.parametrize("share", [LESS, MORE])
def test_the_least_damping_of_blocks(share):
    asked = []
    equations = SimpleNamespace(normal=SimpleNamespace(step=asked.append))
    blocks._One(None, None).solve(None, equations, np.array([share * 1e-8]))
    assert asked == [max(share, 1) * 1e-8]


def ends_at_once(cost, promised):
    """Whether the first of two residuals, which no step changes, is so large that lowering the second is worthless."""
    jacobian = np.array([[0.0], [1.0]])

    def linearise(state):
        return blocks.BlockNormal.dense(np.array([np.sqrt(2 * cost), state]), jacobian)

    found = blocks.minimise(linearise, lambda state, step, _: state + step[0], np.sqrt(2 * promised), 1)
    assert found is not None
    return found.converged


@pytest.mark.parametrize(("share", "ended"), [(LESS, True), (MORE, False)])
def test_what_a_step_has_to_promise(share, ended):
    """A part of the cost, or what rounding makes of residuals in px."""
    assert ends_at_once(1.0, share * 1e-12) == ended
    assert ends_at_once(0.0, share * 1e-18) == ended


# ------------------------------------------------------------------------------------ damping
@pytest.mark.parametrize(("share", "steps"), [(LESS, 2), (MORE, 1)])
def test_the_largest_damping(share, steps):
    """No step helps: the damping grows by 10 and then by 20, until a step moves nothing."""
    reason, found = run(Scripted((1.0, 1.0)), damping=share * 1e11)
    assert reason == STUCK and found.stats.iterations[0] == steps


# ------------------------------------------------------------------------------------ distributions
def tails():
    """Logarithms of probabilities of F, of some and of very many degrees of freedom."""
    some = [distributions.f_exceeded(x, 2, n) for x in (0.5, 3.0, 12.0) for n in (5, 80, 3000)]
    return np.log([*some, distributions.f_exceeded(1.0005, 1e7, 1e7)])


@pytest.mark.parametrize(
    ("name", "coarse", "fine", "example"),
    [
        ("_ACCURACY", 1e-9, 1e-16, tails),
        ("_TERMS", 100, 200_000, tails),
        ("_LAST", 1e-2, 1e-12, lambda: np.log([distributions.t_bound(p, n) for p in (1e-9, 0.1) for n in (1, 9)])),
        ("_NEWTON", 5, 200, lambda: np.log([distributions.t_bound(p, n) for p in (1e-9, 0.1) for n in (1, 9)])),
    ],
)  # fmt: skip
def test_digits_of_probabilities(monkeypatch, name, coarse, fine, example):
    same_with_finer_and_not_with_coarser(monkeypatch, distributions, name, coarse, fine, 1e-11, example)
