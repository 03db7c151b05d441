"""All optimisers on one problem: starts and figures."""

import numpy as np
import pytest

from camcal.solve.optimizers.base import Options
from camcal.study import compare_optimizers
from camcal.study.compare_optimizers import judged, perturbed, run_all, thinned
from tests.solve.problems import problem_of


def test_perturbed_starts_project_repeat_and_keep_ties():
    problem, state = problem_of(fix={"aspect": None, "k3": None})
    starts = perturbed(problem, state, 4, 0.05, seed=1)
    assert len(starts) == 4
    for start, again in zip(starts, perturbed(problem, state, 4, 0.05, seed=1), strict=True):
        np.testing.assert_array_equal(start.params, again.params)
        assert problem.linearise(start) is not None
        assert start.params[0] != state.params[0]
        assert start.params[8] == state.params[8]
        assert start.params[1] / start.params[0] == pytest.approx(state.params[1] / state.params[0])


def test_rows_hold_what_the_runs_say():
    problem, state = problem_of()
    starts = [state, *perturbed(problem, state, 2, 0.01, seed=0)]
    runs = run_all(problem, starts, ["lm", "lbfgs"])
    rows = judged(problem, runs)
    assert [row["name"] for row in rows] == ["lm", "lbfgs"]
    for row in rows:
        own = [r for r in runs if r.name == row["name"]]
        assert row["cost"] == own[0].result.blocks.cost and row["converged"]
        assert 0 <= row["distance"] < 1e-6 and 0 <= row["distance_sigma"] < 0.1
        assert row["perturbed"]["starts"] == 2 and row["perturbed"]["reached"] == 2
        assert row["curve"][0][0] == 0 and row["curve"][-1][1] == row["cost"]


def test_thinned_keeps_both_ends():
    assert thinned(range(5)) == [0, 1, 2, 3, 4]
    few = thinned(range(10_000), 50)
    assert few[0] == 0 and few[-1] == 9999 and len(few) <= 50
    assert few == sorted(set(few))


def test_all_runs_share_the_time(monkeypatch):
    """What is left over the number of runs left, within the limit of one run; a run that takes more leaves less."""
    clock, limits = [0.0], []

    class Slow:
        def __call__(self, problem, state, options):
            limits.append(options.max_seconds)
            clock[0] += 3.0 if len(limits) == 1 else 0.0
            return None

    monkeypatch.setattr(compare_optimizers.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(compare_optimizers.optimizers, "make", lambda spec: Slow())
    problem, state = problem_of()
    options = Options(max_seconds=2.5)
    run_all(problem, [state, state], ["lm", "lbfgs"], options, total_seconds=8.0)
    assert limits == [2.0, pytest.approx(5 / 3), 2.5, 2.5]
    limits.clear()
    run_all(problem, [state], ["lm"] * 4, None, total_seconds=2.0)
    assert limits == [0.5, 0.0, 0.0, 0.0]  # nothing is left: each stops after its first step
