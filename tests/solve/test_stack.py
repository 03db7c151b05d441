"""Many cameras as one batch: each is what it is alone, to the last bit."""

import numpy as np
import pytest

from camcal.data.observations import Correspondences
from camcal.errors import EstimationError
from camcal.least_squares import minimise
from camcal.solve import stack, together
from camcal.solve.calibration import Calibration
from camcal.solve.optimizers import lm
from camcal.solve.refine import How, posed, refine
from camcal.solve.schur import Reduced
from camcal.solve.stack import Stack, alike, stackable
from camcal.solve.together import Task, refine_all
from tests import solved
from tests.solve.test_schur import nearly_singular

MODELS = ("pinhole", "opencv5", "opencv12", "kb4", "brown:radial=2,decentering=1", "division")


def task(seed, model="opencv5", views=6, counts=None, how=None, skew=False):
    """A refinement from near the truth; `counts` are the points of the views, all of them by default."""
    rng = np.random.default_rng(seed)
    camera = solved.camera_of(model, skew=skew)
    poses = solved.tilted_poses(solved.grid(), views, rng)
    data = solved.observe(camera, poses, solved.grid(), 0.1, rng)
    if counts is not None:
        data = Correspondences.from_views(
            [(v.xyz[:n], v.uv[:n]) for v, n in zip(data.views, counts, strict=True)]
        )
    start = camera.lens.from_matrix(camera.matrix * [[1.02], [1.02], [1]])
    return Task(type(camera)(camera.lens, start, camera.image_size), poses, data, how or How())


def same(a, b):
    """Whether two fits agree to the last bit."""
    pairs = [
        (a.camera.params, b.camera.params), (a.poses.rotations, b.poses.rotations),
        (a.poses.translations, b.poses.translations), (a.residuals, b.residuals),
        (a.normal.intrinsics, b.normal.intrinsics), (a.normal.coupling, b.normal.coupling),
        (a.normal.poses, b.normal.poses),
    ]  # fmt: skip
    figures = [
        (f.fit.iterations, f.fit.evaluations, f.fit.stop_reason, [s[1] for s in f.fit.samples])
        for f in (a, b)
    ]
    return all(np.array_equal(x, y) for x, y in pairs) and figures[0] == figures[1]


@pytest.fixture
def stacked(monkeypatch):
    """The numbers of members that were batches, and of fits that were made one by one."""
    seen = {"stacks": [], "alone": 0}
    made, own = Stack.__init__, together.refine

    def counted(self, problems):
        seen["stacks"].append(len(problems))
        made(self, problems)

    def alone(*args):
        seen["alone"] += 1
        return own(*args)

    monkeypatch.setattr(Stack, "__init__", counted)
    monkeypatch.setattr(together, "refine", alone)
    return seen


@pytest.mark.parametrize("model", MODELS)
def test_a_member_is_the_fit_of_its_own(model):
    tasks = [task(seed, model) for seed in range(4)]
    found = refine_all(tasks)
    assert all(same(f, refine(*t)) for f, t in zip(found, tasks, strict=True))
    assert same(refine_all(tasks[2:3])[0], found[2]) and same(refine_all(tasks[::-1])[1], found[2])


@pytest.mark.parametrize("views", [1, 2, 3, 5, 9, 16])
@pytest.mark.parametrize("model", ["opencv5", "opencv12"])
def test_a_step_is_that_of_its_own_equations(views, model):
    """Every number, whatever its arrays' place in memory: with few views BLAS adds in another order for another one."""
    made = [posed(*task(seed, model, views)) for seed in range(3)]
    three = Stack([p.problem for p in made])
    states = three.state([p.state for p in made])
    equations = three.linearise(states, np.arange(3))
    for damping in (1e-4, 3.0):
        steps, predicted = three.solve(states, equations, np.full(3, damping))
        for i, one in enumerate(made):
            blocks = one.problem.linearise(one.state)
            step, decrease = Reduced(blocks, damping).step()
            assert np.array_equal(blocks.coupling, equations.coupling[i])
            assert np.array_equal(step.intrinsics, steps.own[i]) or three.alone[i]
            assert np.array_equal(step.poses, steps.poses[i]) or three.alone[i]
            assert decrease == predicted[i] or three.alone[i]


def test_views_of_unequal_sizes(stacked):
    """Views of 20 to 54 points, padded as in the problem of each camera."""
    rng = np.random.default_rng(3)
    tasks = [task(seed, counts=rng.integers(20, 55, 6)) for seed in range(4)]
    assert all(same(f, refine(*t)) for f, t in zip(refine_all(tasks), tasks, strict=True))
    assert stacked == {"stacks": [4], "alone": 0}


def test_cameras_that_differ_are_in_batches_of_their_own(stacked):
    held = How(fix={"k3": 0.0})
    tasks = [task(0), task(1, views=7), task(2, "pinhole"), task(3), task(4, how=held), task(5, how=held)]
    found = refine_all(tasks)
    assert stacked == {"stacks": [2, 1, 1, 2], "alone": 0}
    assert all(same(f, refine(*t)) for f, t in zip(found, tasks, strict=True))
    assert found[4].camera.params[-1] == 0.0


def test_what_ends_in_another_way_is_done_alone(stacked, monkeypatch):
    """A camera whose start does not project fails, one that converges late goes on; the others do not notice."""
    good, late = task(0), task(1)
    behind = late._replace(poses=type(late.poses)(late.poses.rotations, -late.poses.translations))
    far = late.start.params * np.r_[1.6, 1.6, np.ones(len(late.start.params) - 2)]
    late = late._replace(start=type(late.start)(late.start.lens, far, late.start.image_size))
    monkeypatch.setattr(lm, "_LEARN_FROM", refine(*good).fit.iterations)
    found = refine_all([good, behind, late])
    assert stacked == {"stacks": [3], "alone": 2}
    assert same(found[0], refine(*good)) and isinstance(found[1], EstimationError)
    assert found[2].fit.iterations > lm._LEARN_FROM and same(found[2], refine(*late))


def test_few_points_are_an_error_in_place(stacked):
    few = task(0, views=1, counts=[4])
    found = refine_all([few, task(1), task(2)])
    assert isinstance(found[0], EstimationError) and all(isinstance(f, Calibration) for f in found[1:])


@pytest.mark.parametrize("how", [
    How(optimizer="dogleg"), How(board="free"), How(stopping=lm.Options(max_iterations=3)), How(normalise=False),
])  # fmt: skip
def test_other_searches_are_done_alone(how, stacked):
    refine_all([task(0, how=how), task(1, how=how)])
    assert stacked == {"stacks": [], "alone": 2}


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_weak_equations_are_left_to_orthogonal_factors(factor, monkeypatch):
    """The weakest pivot of the first step on both sides of the bound."""
    _, _, problem, state = posed(*task(0))
    one = Stack([problem])
    states = one.state([state])
    equations = one.linearise(states, np.arange(1))
    weakest = stack._solved(equations, np.array([1e-4]))[2][0]
    monkeypatch.setattr(stack, "WEAK", factor * weakest)
    predicted = one.solve(states, equations, np.array([1e-4]))[1]
    assert one.alone[0] == np.isnan(predicted[0]) == (factor > 1)


def test_a_system_that_is_not_positive_definite_fails_alone():
    good = np.array([[2.0, 0.5], [0.5, 1.0]])
    matrices = np.array([good, [[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]], good])
    with np.errstate(all="ignore"):
        found, pivots = stack._solved_scaled(matrices, np.ones((4, 2)))
    np.testing.assert_allclose(
        found[[0, 3]], np.linalg.solve(good, np.ones(2))[None].repeat(2, 0), rtol=1e-14
    )
    assert np.isfinite(pivots[[0, 3]]).all() and np.isnan(pivots[1:3]).all()
    found, _ = stack._solved_scaled(np.stack([np.eye(4), nearly_singular(), np.eye(4)]), np.ones((3, 4)))
    np.testing.assert_array_equal(found[[0, 2]], np.ones((2, 4)))


def test_what_can_be_a_member():
    assert stackable(posed(*task(0)).problem)
    assert not stackable(posed(*task(0, how=How(board="free"))).problem)
    assert not stackable(posed(*task(0, how=How(normalise=False))).problem)
    assert not stackable(posed(*task(0, "spline:8x6")).problem)
    problems = [posed(*task(0, views=v)).problem for v in (5, 5, 6)]
    assert alike(problems[0]) == alike(problems[1]) != alike(problems[2])


def test_portions_hold_so_many_rows_as_fit_into_the_cache(monkeypatch):
    problems = [posed(*task(s)).problem for s in range(5)]
    rows = problems[0].lens.size + 7
    monkeypatch.setattr(stack, "PORTION", 2 * rows * 54 * 12)  # two cameras of six views
    found = stack.portions(problems, rows)
    assert [p.owner.tolist() for p in found] == [[0] * 6 + [1] * 6, [2] * 6 + [3] * 6, [4] * 6]
    monkeypatch.setattr(stack, "PORTION", 2 * rows * 54 * 12 - 1)
    assert len(stack.portions(problems, rows)) == 5


def test_the_search_of_a_member_is_recorded():
    problems, states = zip(*((p.problem, p.state) for p in (posed(*task(s)) for s in (0, 1))), strict=True)
    both = Stack(problems)
    found = minimise(both, both.state(states))
    for i in range(2):
        trace = both.result(found, i).trace
        assert len(trace) == both.result(found, i).iterations and (np.diff(trace) <= 0).all()
        assert trace[-1] == found.equations.cost[i]
