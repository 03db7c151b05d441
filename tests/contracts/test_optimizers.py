"""What every entry of OPTIMIZERS promises: a new one is tested by being listed, with its variants."""

import functools

import numpy as np
import pytest

from camcal.errors import EstimationError, UsageError
from camcal.registry import load
from camcal.solve.optimizers import OPTIMIZERS, SUMMARIES, make
from camcal.solve.optimizers.base import Options, remaining
from tests.solve.problems import problem_of

PROBLEMS = {
    "opencv5": {"ragged": True},
    "kb4": {"model": "kb4"},
    "brown": {"model": "brown:radial=2", "sigma": True},
    "fixed and tied": {"fix": {"aspect": None, "cx": 320.0, "k3": None}, "skew": True},
    "bowed board": {"board": "bowl"},
    "only poses": {"model": "pinhole", "fix": dict.fromkeys(["fx", "fy", "cx", "cy"])},
}


def specs():
    """Every optimiser by name, and each of its variants after the first, which is the default."""
    for name, path in OPTIMIZERS.items():
        yield name
        for variant in load(path.partition(":")[0] + ":VARIANTS")[1:]:
            yield f"{name}:{variant}"


#: so few iterations that the slow variants end before they have converged: they must say so
SHORT = {
    "leapfrog:scaled": 100,
    "leapfrog:plain": 100,
    "fletcher-reeves:scaled": 200,
    "fletcher-reeves:plain": 50,
    "polak-ribiere:scaled": 200,
    "polak-ribiere:plain": 50,
    "lbfgs:plain": 50,
}


@functools.cache
def run(spec, name):
    problem, state = problem_of(**PROBLEMS[name])
    return problem, state, make(spec)(problem, state, Options(max_iterations=SHORT.get(spec)))


def optimum(name):
    """The minimum by Levenberg-Marquardt."""
    found = run("lm", name)[2]
    assert found.converged
    return found


@pytest.fixture(params=list(specs()))
def spec(request):
    return request.param


@pytest.fixture(params=PROBLEMS, ids=list(PROBLEMS))
def case(request, spec):
    return request.param, *run(spec, request.param)


def test_entries_are_described():
    assert set(SUMMARIES) == set(OPTIMIZERS)


def test_reaches_the_optimum_or_says_that_it_did_not(spec, case):
    name, problem, state, result = case
    best = optimum(name).blocks.cost
    assert result.blocks.cost >= best * (1 - 1e-9)
    if result.converged:
        assert result.blocks.cost <= best * (1 + 1e-6)
        assert remaining(result.blocks) <= 1e-6 * best
    else:
        assert spec in SHORT and result.stop_reason
    # the blocks and the state that are handed back belong together
    assert problem.linearise(result.state).cost == pytest.approx(result.blocks.cost, rel=1e-13)
    assert result.blocks.cost < problem.linearise(state).cost


def test_frozen_parameters_stay_and_ties_hold(case):
    _, problem, state, result = case
    held = ~problem.free.any(1)
    np.testing.assert_array_equal(result.state.params[held], state.params[held])
    change = result.state.params - state.params
    along = np.linalg.lstsq(problem.free, change, rcond=None)[0]
    np.testing.assert_allclose(problem.free @ along, change, rtol=1e-9, atol=1e-12)
    if "board" in PROBLEMS[case[0]]:
        assert result.state.shape.shape == (2,) and result.state.shape.any()


def test_rotations_stay_rotations(case):
    *_, result = case
    r = result.state.rotations
    product = r @ r.transpose(0, 2, 1)
    # each step multiplies by a rotation: rounding of at most some thousand products
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-11)
    assert (np.linalg.det(r) > 0).all()


def test_statistics_are_complete_and_the_trace_falls(case):
    *_, result = case
    samples = result.samples
    costs = np.array(result.trace)
    assert samples[0].iteration == 0 and samples[0].seconds == 0.0
    # a step may change nothing but the rounding of the sum
    assert (np.diff(costs) <= 1e-11 * costs[:-1]).all()
    assert costs[-1] == pytest.approx(result.blocks.cost, rel=1e-11)
    for column in ("iteration", "evaluations", "seconds"):
        values = [getattr(s, column) for s in samples]
        assert values == sorted(values)
    assert samples[-1].iteration <= result.iterations
    assert 1 <= samples[-1].evaluations <= result.evaluations
    assert isinstance(result.stop_reason, str) and result.stop_reason
    assert isinstance(result.converged, bool)
    assert result.info["variables"]


def test_tells_of_each_step(spec):
    problem, state = problem_of(count=3)
    told = []
    result = make(spec)(problem, state, Options(max_iterations=20), lambda i, cost: told.append((i, cost)))
    assert [(s.iteration, s.cost) for s in result.samples[1:]] == told


def test_starts_at_the_minimum_and_stays(spec):
    problem, _ = problem_of(**PROBLEMS["opencv5"])
    best = optimum("opencv5")
    result = make(spec)(problem, best.state, Options(max_iterations=SHORT.get(spec)))
    assert result.converged
    assert result.blocks.cost == pytest.approx(best.blocks.cost, rel=1e-9)
    # scipy's methods halve their region down to the rounding of x, 52 times, where rounding hides every decrease
    assert result.evaluations <= 52 + 3


def test_few_iterations_are_not_convergence(spec):
    problem, state = problem_of()
    result = make(spec)(problem, state, Options(max_iterations=2))
    assert not result.converged and result.stop_reason
    assert result.blocks.cost <= problem.linearise(state).cost


def test_no_time_is_not_convergence(spec):
    problem, state = problem_of()
    result = make(spec)(problem, state, Options(max_seconds=0.0))
    assert not result.converged and result.stop_reason == "time"


def test_the_start_is_not_changed(spec):
    problem, state = problem_of(count=3)
    before = [getattr(state, n).copy() for n in ("params", "rotations", "centres")]
    make(spec)(problem, state, Options(max_iterations=5))
    for old, name in zip(before, ("params", "rotations", "centres"), strict=True):
        np.testing.assert_array_equal(old, getattr(state, name))


def test_a_start_that_does_not_project(spec):
    problem, state = problem_of(count=3)
    state.centres[:, 2] *= -1
    with pytest.raises(EstimationError, match="does not project"):
        make(spec)(problem, state)


def test_an_unknown_variant(spec):
    name = spec.partition(":")[0]
    with pytest.raises(UsageError, match=f"optimizer '{name}' has no variant 'nonsense'") as caught:
        make(f"{name}:nonsense")
    assert f"{name}:" in caught.value.hint
