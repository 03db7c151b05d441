"""Numbers that decide something in the plan, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.plan import better, lens, minima, outlying, second_pass, selection
from camcal.solve.refine import How
from tests.sides import LESS, MORE
from tests.solved import solved


@pytest.fixture(scope="module")
def good():
    return solved(views=4)


def with_cost(fit, cost, converged=True):
    return replace(fit, fit=replace(fit.fit, cost=cost, converged=converged))


# ------------------------------------------------------------------------------------ lens models
def test_degrees_of_freedom_of_a_default_model():
    for freedom, said in ((5 * 9, ""), (5 * 9 - 1, "44 degrees of freedom are too few for 9 parameters")):
        assert lens.LEAST_FREEDOM * 9 == 45
        assert lens._too_few(freedom, 9) == said


def test_a_smaller_model_that_is_as_good():
    def candidate(name, parameters, rms):
        return SimpleNamespace(model=name, parameters=parameters, holdout_rms=rms, reasons=(), solution=1)

    for share, chosen in ((0.999, "small"), (1.001, "large")):
        other = candidate("small", 5, share * (1 + selection.WORTH))
        found, _ = selection._choose([candidate("large", 9, 1.0), other])
        assert found.model == chosen


# ------------------------------------------------------------------------------------ minima
def test_small_problems_are_searched(good):
    few = np.arange(len(good.used)) < minima.SEARCHED
    more = np.arange(len(good.used)) <= minima.SEARCHED
    data = good.observations
    for used, searched in ((few, True), (more, False)):
        assert minima._searchable(replace(good, observations=data.with_used(used))) == searched
    for count, searched in ((minima.MOST_PARAMETERS, True), (minima.MOST_PARAMETERS + 1, False)):
        fit = SimpleNamespace(used=few, free=np.eye(count))
        assert minima._searchable(fit) == searched


def test_starts_that_reach_one_minimum(good, monkeypatch):
    """The lowest of those that differ are followed to their ends, at most three of them."""
    calls = []

    def fits(begins, fit, how):
        calls.append((len(begins), how.stopping and how.stopping.max_iterations))
        return [with_cost(good, cost) for cost in costs]

    monkeypatch.setattr(minima, "_fits", fits)
    for costs, followed in (
        ([1.0, 1.0 + 0.5 * minima.SAME], 1),
        ([1.0, 1.0 + 2 * minima.SAME], 2),
        ([1.0, 2.0, 3.0, 4.0], minima.FOLLOWED),
    ):
        calls.clear()
        minima._lowest_of([None] * len(costs), good, How())
        assert calls == [(len(costs), minima.SCREENED), (followed, None)]


def test_a_search_goes_on_a_few_times(good, monkeypatch):
    made = []
    for needed, converged in ((minima.CONTINUED, True), (minima.CONTINUED + 1, False)):
        made.clear()

        def refine(*_, last=needed):
            made.append(1)
            return with_cost(good, 1.0, len(made) == last)

        monkeypatch.setattr(minima, "refine", refine)
        assert minima.to_its_end(with_cost(good, 1.0, False), How()).fit.converged == converged
        assert len(made) == minima.CONTINUED


# ------------------------------------------------------------------------------------ outliers, windows
def test_many_rejected_points(good, monkeypatch):
    progress = SimpleNamespace(restarts=0, options=SimpleNamespace(robust="huber"), plain=good)
    for share, again in ((LESS, False), (MORE, True)):
        rejected = share * outlying.START_AGAIN * good.observations.point_count
        monkeypatch.setattr(outlying.outliers, "test", lambda _, n=rejected: SimpleNamespace(rejected=n))
        assert outlying.wants_restart(progress) == again


def test_views_that_a_start_is_tried_with():
    for count, taken in (
        (2 * outlying.LEAST_VIEWS, outlying.LEAST_VIEWS),
        (2 * outlying.LEAST_VIEWS + 2, 4),
        (4, 3),
    ):
        chosen = []
        data = SimpleNamespace(of_views=lambda rows, c=chosen: c.extend(rows))
        agreed = [SimpleNamespace(sigma=float(i)) for i in range(count)]
        outlying._half_agreeing(SimpleNamespace(notes={"agreed": agreed}, data=data))
        assert chosen == list(range(taken))


def test_views_on_which_windows_are_chosen(good, monkeypatch):
    tried = []

    def again(points, found, fit, windows):
        tried.append(len(fit.poses))
        return [None] * len(windows)

    monkeypatch.setattr(second_pass, "_again", again)
    monkeypatch.setattr(second_pass, "_refitted", lambda fit, *_: fit)
    monkeypatch.setattr(second_pass, "hold_out", lambda *_: None)
    monkeypatch.setattr(second_pass, "better", lambda *_: (False, ""))
    monkeypatch.setattr(second_pass, "refine", lambda camera, poses, *_: SimpleNamespace(poses=poses))
    for count, chosen in (
        (2 * second_pass.TRIED_ON - 1, None),
        (2 * second_pass.TRIED_ON, second_pass.TRIED_ON),
    ):
        tried.clear()
        whole = SimpleNamespace(
            poses=np.arange(count), camera=None, observations=SimpleNamespace(of_views=lambda rows: rows)
        )
        second_pass._in_best_windows(SimpleNamespace(fit=whole, given=None, how=None))
        assert tried == ([count] if chosen is None else [chosen, count])


# ------------------------------------------------------------------------------------ better
def test_equal_costs(good):
    one, unfinished = with_cost(good, 1.0), with_cost(good, 1.0, False)
    assert better._lower_cost(with_cost(good, 1 - 2 * better.EQUAL), one)[0]
    assert not better._lower_cost(with_cost(good, 1 - 0.5 * better.EQUAL), one)[0]
    assert better._lower_cost(with_cost(good, 1 + 0.5 * better.EQUAL), unfinished)[0]
    assert not better._lower_cost(with_cost(good, 1 + 2 * better.EQUAL), unfinished)[0]
