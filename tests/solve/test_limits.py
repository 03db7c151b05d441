"""Further limits of the optimisers and of what calls them, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.solve import ransac, refine, robust, square_root, stack
from camcal.solve.optimizers import lm, scipy_
from camcal.solve.optimizers.base import Options, Sample
from tests.sides import LESS, MORE
from tests.solve.problems import problem_of
from tests.solved import solved


# ------------------------------------------------------------------------------------ LM and scipy
def test_a_converged_run_that_is_a_little_higher():
    problem, state = problem_of("pinhole", count=3)
    stopped = replace(lm.minimise(problem, state, Options(max_iterations=2)), converged=False)
    for share, taken in ((LESS, True), (MORE, False)):
        cost = stopped.blocks.cost * (1 + share * lm._NEARLY)
        other = replace(stopped, blocks=replace(stopped.blocks, cost=cost), converged=True)
        other = replace(other, samples=(Sample(0, cost, 1, 0.0),))
        assert lm._joined(stopped, other).converged == taken


def test_signs_of_the_distortion_that_are_tried():
    problem, state = problem_of("opencv5", count=3)
    starts = list(lm._elsewhere(problem, state))
    np.testing.assert_allclose([s.params[4:] / state.params[4:] for s in starts], [[-1] * 5, [-0.5] * 5])
    assert all((s.params[:4] == state.params[:4]).all() for s in starts)


def test_a_valley_that_is_flat(monkeypatch):
    """The decrease of the cost is of chi² over its expectation, the coordinates."""
    problem, state = problem_of("pinhole", count=3)
    asked = []

    def minimise(_, __, options):
        asked.append(options.still)
        raise StopIteration

    monkeypatch.setattr(lm.least_squares, "minimise", minimise)
    with pytest.raises(StopIteration):
        lm.minimise(problem, state)
    assert asked == [lm.STILL_CHI2 / (2 * 54 * 3)]


def test_jacobians_that_are_dense(monkeypatch):
    problem, state = problem_of("pinhole", count=3)
    columns = problem.variables + 6 * problem.instants
    for count, sparse in ((scipy_._DENSE // columns, False), (scipy_._DENSE // columns + 1, True)):
        monkeypatch.setattr(scipy_.rows, "count", lambda _, n=count: n)
        assert scipy_._Function(problem, state, None).sparse == sparse


def test_tolerances_of_scipy(monkeypatch):
    problem, state = problem_of("pinhole", count=3)
    asked = []

    def solve(_, x, __, **how):
        asked.append((how["ftol"], how["xtol"]))
        return SimpleNamespace(x=x, message="", status=1)

    monkeypatch.setattr(scipy_, "least_squares", solve)
    low, high = scipy_._ROUNDING, scipy_._COARSEST
    for tolerance, passed in (
        (LESS * low, low),
        (MORE * low, MORE * low),
        (LESS * high, LESS * high),
        (2 * high, high),
    ):
        scipy_.minimise(problem, state, Options(tolerance=tolerance))
        assert asked.pop() == (pytest.approx(passed, rel=1e-9), 4e-16)


@pytest.mark.parametrize(("tolerance", "limit"), [(1e-15, "least"), (1e-12, "of tolerance")])
def test_what_scipy_may_leave(monkeypatch, tolerance, limit):
    problem, state = problem_of("pinhole", count=3)
    monkeypatch.setattr(
        scipy_, "least_squares", lambda _, x, __, **how: SimpleNamespace(x=x, message="", status=1)
    )
    part = scipy_._LEAST_LEFT if limit == "least" else scipy_._LEFT * tolerance
    for share, converged in ((LESS, True), (MORE, False)):

        def left(blocks, share=share):
            return share * (part * blocks.cost + problem.rounding)

        monkeypatch.setattr(scipy_, "remaining", left)
        assert scipy_.minimise(problem, state, Options(tolerance=tolerance)).converged == converged


# ------------------------------------------------------------------------------------ rounds
def test_rounds_of_reweighting(monkeypatch):
    """They end where no weight changes by more."""
    good = solved(views=4)
    for change, fits in ((LESS * robust.SETTLED, 1), (MORE * robust.SETTLED, 2)):
        weights = iter([np.zeros(216), np.r_[change, np.zeros(215)], np.r_[change, np.zeros(215)]])
        loss = SimpleNamespace(weights=lambda *_, w=weights: next(w), name="huber")
        made = []
        monkeypatch.setattr(robust, "refit", lambda fit, *_, m=made: m.append(1) or fit)
        robust.reweight(good, None, loss)
        assert len(made) == fits


def test_rounds_of_rejection(monkeypatch):
    """Each round rejects another point."""
    good = solved(views=4)
    for changing in (robust.ROUNDS, robust.ROUNDS + 1):
        made = []

        def verdict(_, m=made, n=changing):
            used = np.ones(216, bool)
            used[: min(len(m), n)] = False
            return SimpleNamespace(used=used, bad_views=())

        monkeypatch.setattr(robust.outliers, "test", verdict)
        weighted = replace(good, observations=replace(good.observations, weight=np.ones(216)))
        monkeypatch.setattr(robust, "as_designed", lambda _: good.observations)
        monkeypatch.setattr(robust, "refit", lambda *_, m=made, w=weighted: m.append(1) or w)
        robust.reject(weighted, None)
        assert len(made) == 20


def test_rounds_of_boards_that_turn(monkeypatch):
    """They end where no board turned by more in the last one."""
    board = SimpleNamespace(placed=6, part=1, points=None)
    monkeypatch.setattr(refine, "BoardProblem", SimpleNamespace)
    problem = SimpleNamespace(board=board, poses=lambda _: None, state=lambda *_: None)
    monkeypatch.setattr(refine, "moved", lambda *_: None)
    monkeypatch.setattr(refine, "motions_of", lambda *_: None)
    monkeypatch.setattr(refine, "make_problem", lambda *_: problem)
    monkeypatch.setattr(refine, "replace", lambda result, **_: result)
    for share, rounds in ((LESS, 1), (MORE, refine.ROUNDS)):
        made = []
        shape = np.r_[-share * refine.SMALL_TURN, np.zeros(5)]
        result = SimpleNamespace(
            state=SimpleNamespace(shape=shape, params=None, rig=None), iterations=1, evaluations=1
        )
        monkeypatch.setattr(
            refine.optimizers, "make", lambda _, m=made, r=result: lambda *_: m.append(1) or r
        )
        refine._placed(problem, result, None, None, None, refine.How())
        assert len(made) == rounds


# ------------------------------------------------------------------------------------ hypotheses and pivots
class Scored:
    """Hypotheses whose points are all off by given lengths."""

    sample = 4

    def __init__(self, offs):
        self.offs, self.fitted, self.batches = list(offs), [], []

    def __len__(self):
        return 60

    def hypotheses(self, picks):
        self.batches.append(len(picks))
        some = np.array([self.offs.pop(0) if self.offs else 1e3 for _ in picks])
        return some[:, None, None] * np.ones((1, 3, 3)), np.repeat(some[:, None], 60, 1)

    def fit(self, rows, start):
        self.fitted.append(float(start[0, 0]))
        return start, np.full(60, start[0, 0])


@pytest.mark.parametrize(("share", "fitted"), [(LESS, {1.0, 1.1, "near"}), (MORE, {1.0, 1.1})])
def test_hypotheses_that_are_refitted(share, fitted):
    """The three best of a batch, but none whose score is by half more than the lowest."""
    near = share * ransac._NEAR
    model = Scored([near, 1.1, 1.0])
    ransac.agreeing(model, np.random.default_rng(0))
    assert {"near" if off == near else off for off in model.fitted} == fitted
    model = Scored([1.4, 1.2, 1.1, 1.0])
    ransac.agreeing(model, np.random.default_rng(0))
    assert set(model.fitted) == {1.0, 1.1, 1.2}


def test_hypotheses_that_are_scored_at_a_time():
    model = Scored([])
    model.sample = 6
    ransac.agreeing(model, np.random.default_rng(0))
    wanted = ransac.samples_needed(6)
    assert model.batches == [128] * (wanted // 128) + [wanted % 128]
    assert ransac._BATCH == 128


def test_entries_of_a_triangle_that_are_zero():
    problem, state = problem_of("pinhole", count=3)
    blocks = problem.linearise(state)
    root = square_root.SquareRoot.of(problem, state)
    length = np.sqrt(square_root.tangent.diagonal(blocks)[problem.variables + 5])
    for share, solvable in ((LESS, False), (MORE, True)):
        views = root.views.copy()
        views[0, 5, 5] = share * square_root._ZERO * length
        assert (square_root.SquareRoot(views, root.prior).step(blocks, 0.0) is not None) == solvable


def test_rows_of_a_portion(monkeypatch):
    """Groups of views are taken together up to so many numbers."""
    monkeypatch.setattr(stack, "_portion", lambda some: [len(g.members) for _, g in some])
    rows, length = 20, 54
    most = stack.PORTION // (2 * rows * length)
    for first, portions in ((most - 1, [[most - 1, 1]]), (most, [[most], [1]])):
        groups = [
            SimpleNamespace(uv=np.zeros((1, 2, length)), weights=None, members=np.arange(n))
            for n in (first, 1)
        ]
        assert stack.portions([SimpleNamespace(groups=groups)], rows) == portions
