"""Problems of several cameras against residuals by composite poses and dense numeric Jacobians."""

from dataclasses import fields, replace

import numpy as np
import pytest

from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.solve import optimizers, rows, tangent
from camcal.solve.optimizers.base import Options
from camcal.solve.points_first import PointsFirst
from camcal.solve.poses import solve_poses
from camcal.solve.problem import Problem, Seen
from camcal.solve.schur import Reduced
from camcal.solve.square_root import SquareRoot
from camcal.solve.state import Step
from tests.solve.problems import problem_of
from tests.solve.rigs import residuals_of, rig_of, units_of

RIGS = {
    "two": {"cameras": 2},
    "three, views missing": {"missing": [(0, 1), (1, 2), (2, 0), (1, 4), (2, 4)]},
    "an instant without the reference": {"cameras": 2, "missing": [(0, 3), (1, 0)]},
    "sigmas": {"cameras": 2, "sigma": True},
    "not normalised": {"cameras": 2, "normalise": False},
    "bowl": {"cameras": 2, "board": "bowl", "missing": [(1, 0)]},
    "free board": {"cameras": 2, "board": "free"},
    "a spline": {"cameras": 2, "models": ("opencv5", "spline:6x5"), "missing": [(1, 2)]},
}


@pytest.fixture(params=RIGS, ids=list(RIGS), scope="module")
def rig(request):
    return rig_of(**RIGS[request.param])


def dense(problem, state):
    """Numeric Jacobian (M, F + 6 V) by central differences, residuals in the order of `residuals_of`."""
    units, columns = units_of(problem) * 1e-2, []
    for k in range(len(units)):
        ends = []
        for sign in (1.0, -1.0):
            vector = np.zeros(len(units))
            vector[k] = sign * units[k]
            moved = problem.retract(state, tangent.unflat(vector, problem.variables))
            ends.append(np.concatenate([r.ravel() for r in residuals_of(problem, moved)]))
        columns.append((ends[0] - ends[1]) / (2 * units[k]))
    return np.array(columns).T


def of_prior(problem, state):
    """Half the square of the lenses' own residuals."""
    found = problem.prior(state)
    return 0.0 if found is None else 0.5 * float(found[0] @ found[0])


def test_the_cost_is_that_of_the_residuals(rig):
    expected = [0.5 * (r**2).sum() for r in residuals_of(rig.problem, rig.near)]
    blocks = rig.problem.linearise(rig.near)
    np.testing.assert_allclose(blocks.view_costs, expected, rtol=1e-11)
    assert blocks.cost == pytest.approx(sum(expected) + of_prior(rig.problem, rig.near), rel=1e-12)


def test_normal_equations_are_those_of_a_dense_numeric_jacobian(rig):
    problem, state = rig.problem, rig.near
    j, r = dense(problem, state), np.concatenate([r.ravel() for r in residuals_of(problem, state)])
    if problem.prior(state) is not None:
        own = problem.prior(state)
        r = np.r_[r, own[0]]
        j = np.r_[j, np.c_[own[1], np.zeros((len(own[0]), 6 * problem.instants))]]
    blocks = problem.linearise(state)
    scale = tangent.inverse_lengths(tangent.diagonal(blocks))
    free, instants = problem.variables, problem.instants
    whole = np.zeros((len(scale), len(scale)))
    whole[:free, :free] = blocks.intrinsics
    for v in range(instants):
        at = slice(free + 6 * v, free + 6 * v + 6)
        whole[:free, at], whole[at, :free] = blocks.coupling[v], blocks.coupling[v].T
        whole[at, at] = blocks.poses[v]
    # columns of unit length; central differences over 0.01 px are good to (0.01 px)² of a pixel's curvature
    np.testing.assert_allclose(whole * scale * scale[:, None], j.T @ j * scale * scale[:, None], atol=1e-6)
    gradient = tangent.gradient(blocks)
    np.testing.assert_allclose(gradient * scale, (j.T @ r) * scale, atol=1e-6 * np.linalg.norm(r))


def test_rows_are_the_factors_of_the_normal_equations(rig):
    problem, state = rig.problem, rig.near
    j, r, blocks = rows.jacobian(problem, state), rows.residuals(problem, state), problem.linearise(state)
    np.testing.assert_allclose(rows.jacobian(problem, state, sparse=True).toarray(), j)
    vector = np.random.default_rng(0).normal(size=j.shape[1]) * units_of(problem)
    scale = tangent.inverse_lengths(tangent.diagonal(blocks))
    np.testing.assert_allclose(
        (j.T @ (j @ vector)) * scale, tangent.multiply(blocks, vector) * scale, rtol=1e-8
    )
    np.testing.assert_allclose(
        (j.T @ r) * scale, tangent.gradient(blocks) * scale, atol=1e-9 * np.linalg.norm(r)
    )
    assert blocks.cost == pytest.approx(0.5 * float(r @ r), rel=1e-12)
    if problem.normalise:
        ours, theirs = Reduced(blocks, 1e-3).step(), SquareRoot.of(problem, state).step(blocks, 1e-3)
        moved = tangent.flat(ours[0])
        assert ours[1] == pytest.approx(theirs[1], rel=1e-8)
        np.testing.assert_allclose(tangent.flat(theirs[0]) / scale, moved / scale, rtol=1e-5, atol=1e-6)


def test_points_of_a_free_board_first():
    rig = rig_of(**RIGS["free board"])
    blocks = rig.problem.linearise(rig.near)
    poses_first = Reduced(blocks, 1e-2).step()
    points_first = PointsFirst(blocks, 1e-2, rig.problem.point_coordinates).step()
    assert points_first[1] == pytest.approx(poses_first[1], rel=1e-9)
    a, b = tangent.flat(poses_first[0]), tangent.flat(points_first[0])
    np.testing.assert_allclose(b / units_of(rig.problem), a / units_of(rig.problem), atol=1e-6)


def test_instants_that_a_camera_did_not_see_are_not_coupled_with_it():
    problem = rig_of(**RIGS["three, views missing"]).problem
    blocks = problem.linearise(rig_of(**RIGS["three, views missing"]).near)
    for camera in problem.cameras:
        saw = np.zeros(problem.instants, bool)
        saw[camera.instants] = True
        for where in (camera.columns, camera.extrinsics):
            part = blocks.coupling[:, where]
            assert not part[~saw].any()
            if part.shape[1]:  # the reference camera has no extrinsics
                assert part[saw].any((1, 2)).all()
    assert [c.extrinsics for c in problem.cameras] == [slice(o, e) for o, e in extrinsics(problem)]


def extrinsics(problem):
    own = problem.free.shape[1]
    return [(own, own), (own, own + 6), (own + 6, own + 12)]


@pytest.mark.parametrize("spec", ["lm", "lm:qr", "dogleg", "scipy"])
def test_every_kind_of_optimiser_finds_the_rig(spec):
    rig = rig_of(cameras=2, instants=6, noise=0.05, missing=[(0, 1), (1, 2)])
    best = optimizers.make("lm")(rig.problem, rig.near)
    found = optimizers.make(spec)(rig.problem, rig.near, Options())
    assert found.converged and found.blocks.cost == pytest.approx(best.blocks.cost, rel=1e-6)
    covariance = 0.05**2 * np.linalg.inv(Reduced(best.blocks).matrix)
    found_rig, truth = found.state.rig, rig.truth.rig
    off = np.c_[
        rotations.log(found_rig.rotations @ truth.rotations.transpose(0, 2, 1)),
        found_rig.translations - truth.translations,
    ]
    for camera in rig.problem.cameras[1:]:
        sigma = np.sqrt(np.diag(covariance)[camera.extrinsics])
        assert (np.abs(off[camera.index]) < 4 * sigma).all()  # 6 numbers: by chance once in 2000
        assert sigma[:3].max() < 5e-3  # and that says something
    np.testing.assert_array_equal(found_rig.rotations[0], np.eye(3))
    np.testing.assert_array_equal(found.state.rig.translations[0], 0.0)


def test_poses_of_instants_alone(rig):
    found = solve_poses(rig.problem, rig.near)
    assert found.converged.all() and len(found.costs) == rig.problem.instants
    blocks = rig.problem.linearise(found.state)
    assert found.costs.sum() + of_prior(rig.problem, rig.near) == pytest.approx(blocks.cost, rel=1e-12)
    left = np.linalg.solve(blocks.poses, blocks.pose_gradients[..., None])[..., 0]
    assert 0.5 * (left * blocks.pose_gradients).sum() < 1e-11 * blocks.cost
    np.testing.assert_array_equal(found.state.rig.translations, rig.near.rig.translations)


def test_an_instant_outside_one_camera_s_domain():
    rig = rig_of(cameras=2)
    behind = replace(rig.truth, centres=rig.truth.centres * np.where(np.arange(5) == 2, -1, 1)[:, None])
    assert rig.problem.linearise(behind) is None
    lost = np.isnan(rig.problem.pose_normals(behind, np.arange(5))).any((1, 2))
    assert list(lost) == [False, False, True, False, False]


@pytest.mark.parametrize("given", [{}, {"ragged": True, "sigma": True}, {"board": "bowl"}, {"model": "kb4"}])
def test_a_rig_of_one_is_the_camera_alone(given):
    """The same bits, which are those of the kernel's own sums."""
    problem, state = problem_of(**given)
    one = Seen(np.zeros(len(problem.views), int), np.arange(len(problem.views)))
    more = {"board": problem.board} if "board" in given else {}
    same = type(problem)([problem.lens], problem.views, [problem.free], seen=one, **more)
    a, b = problem.linearise(state), same.linearise(state)
    for field in fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))
    assert same.rigid == problem.free.shape[1] and same.instants == len(problem.views)
    normal, p = problem.view_normals(state), problem.lens.size
    if "board" not in given:
        np.testing.assert_array_equal(a.poses, normal[:, p : p + 6, p : p + 6])
        np.testing.assert_array_equal(a.coupling, problem.free.T @ normal[:, :p, p : p + 6])
        np.testing.assert_array_equal(a.intrinsics, problem.free.T @ normal[:, :p, :p].sum(0) @ problem.free)


def test_which_camera_is_the_reference_changes_no_minimum():
    rig = rig_of(cameras=2, missing=[(1, 3)])
    problem = rig.problem
    lenses, frees = [c.lens for c in problem.cameras], [c.free for c in problem.cameras]
    seen = Seen(1 - problem.seen.camera, problem.seen.instant)
    other = Problem(lenses[::-1], problem.views, frees[::-1], seen=seen)
    first, second = problem.params(rig.near)
    own = rig.near.rig
    turn, shift = own.rotations[1], own.translations[1]
    poses = problem.poses(rig.near)
    moved = Poses(turn @ poses.rotations, poses.translations @ turn.T + shift)
    back = Poses(np.stack([np.eye(3), turn.T]), np.stack([np.zeros(3), -turn.T @ shift]))
    start = other.state(np.r_[second, first], moved, back)
    assert other.linearise(start).cost == pytest.approx(problem.linearise(rig.near).cost, rel=1e-11)
    a, b = (optimizers.make("lm")(p, s) for p, s in ((problem, rig.near), (other, start)))
    assert a.converged and b.converged and a.blocks.cost == pytest.approx(b.blocks.cost, rel=1e-11)
    np.testing.assert_allclose(b.state.rig.rotations[1], a.state.rig.rotations[1].T, atol=1e-7)


def test_one_lens_is_asked_for_of_a_rig():
    problem = rig_of(cameras=2).problem
    with pytest.raises(ValueError, match="unpack"):
        _ = problem.lens


def test_a_step_of_nothing_stays():
    rig = rig_of(cameras=2)
    step = Step(np.zeros(rig.problem.variables), np.zeros((rig.problem.instants, 6)))
    same = rig.problem.retract(rig.truth, step)
    np.testing.assert_array_equal(same.rig.rotations, rig.truth.rig.rotations)
    np.testing.assert_array_equal(same.params, rig.truth.params)
