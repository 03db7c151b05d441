"""Numbers that decide something in the solver, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from camcal.data.observations import Observations, View
from camcal.model.pose import Pose
from camcal.solve import (
    board_points,
    common_points,
    groups,
    linear,
    noise,
    outliers,
    p3p,
    ransac,
    rig_lags,
    rig_start,
    robust,
    schur,
    several_boards,
    starts,
    turns,
)
from camcal.solve.optimizers import scipy_
from tests.sides import LESS, MORE
from tests.solve.problems import problem_of
from tests.solved import grid, solved


@pytest.fixture(scope="module")
def good():
    return solved(views=6)


# ------------------------------------------------------------------------------------ starts and ends
def test_a_start_too_far_from_the_data(good):
    half = np.hypot(640, 480) / 2
    for share, poor in ((LESS, False), (MORE, True)):
        assert starts.poor(share * starts.POOR_START * half, good.observations) == poor
    assert starts.poor(np.nan, good.observations)


def test_an_end_that_may_be_another_minimum(good):
    """The median of the errors counts: half of them are at the bound, the others are small."""
    bound = starts.POOR_END * np.hypot(640, 480) / 2
    for share, doubtful in ((LESS, False), (MORE, True)):
        residuals = np.zeros_like(good.residuals)
        residuals[: len(residuals) // 2 + 1, 0] = share * bound
        assert starts.doubtful(replace(good, residuals=residuals)) == doubtful


# ------------------------------------------------------------------------------------ points of a board
def test_the_rounding_of_a_board_s_points():
    xyz = grid()
    largest = np.abs(xyz).max()
    for share, one in ((LESS, True), (MORE, False)):
        other = xyz.copy()
        other[5, 2] = share * common_points.SAME_NUMBER * largest
        ids = np.arange(len(xyz))
        views = [View("a", xyz, xyz[:, :2], None, ids), View("b", other, xyz[:, :2], None, ids)]
        assert (common_points.common_points(views) is not None) == one


def test_a_point_that_is_one_of_the_board_s():
    xyz = grid()
    for share, moved in ((LESS, True), (MORE, False)):
        other = xyz.copy()
        other[5, 0] += share * board_points._SAME_POINT * xyz.max()
        data = Observations.from_views([View("a", other, xyz[:, :2])], (640, 480))
        found = board_points.on_board(data, xyz, xyz + 1.0)
        assert (found.xyz[5, 1] == xyz[5, 1] + 1.0) == moved


def test_points_that_turn_onto_themselves():
    xyz = grid(4, 4)
    for share, symmetric in ((0.9, True), (1.1, False)):
        other = xyz.copy()
        other[5, 0] += share * turns.SAME_POINT * 3  # its image under a turn is as far off
        assert (len(turns.turns_of(other)) > 1) == symmetric
    for count, several in ((turns.LEAST_POINTS, True), (turns.LEAST_POINTS - 1, False)):
        around = 2 * np.pi * np.arange(count) / count
        ring = np.c_[np.cos(around), np.sin(around), 0 * around] if count % 2 == 0 else grid(count, 1)
        assert (len(turns.turns_of(ring)) > 1) == several


def test_points_that_determine_the_shapes_of_boards():
    views, points = several_boards.LEAST_VIEWS, several_boards.LEAST_POINTS
    label = np.zeros(points, int)
    counts = np.full(points, views)
    assert several_boards.determined(label, counts, 1).all()
    assert not several_boards.determined(label[1:], counts[1:], 1).any()
    counts[0] = views - 1
    assert not several_boards.determined(label, counts, 1).any()


# ------------------------------------------------------------------------------------ outliers
def test_the_residuals_of_rounded_coordinates(good):
    largest = np.abs(good.observations.uv).max()
    largest *= outliers.cut(len(good.residuals), good.free_count)  # that many deviations are no outlier
    for share, clean in ((LESS, True), (MORE, False)):
        residuals = np.zeros_like(good.residuals)
        residuals[3, 0] = share * outliers._ROUNDING * largest
        assert (outliers.test(replace(good, residuals=residuals)).rejected == 0) == clean


def test_the_cut_has_the_tail_of_the_median_s_freedom():
    """Of many points the quantile of χ² with two degrees of freedom, -2 ln p; of few, no fewer than two for s."""
    # the variance of sigma from the median of many lengths, beside that from their rms
    lengths = np.random.default_rng(0).rayleigh(size=(4000, 201))
    medians, rms = np.median(lengths, 1) / np.sqrt(2 * np.log(2)), np.sqrt(np.square(lengths).mean(1) / 2)
    share = outliers._MEDIAN_EFFICIENCY
    assert rms.var() / medians.var() == pytest.approx(share, rel=0.05)
    # P(F > x) = (1 + 2 x / nu)^(-nu / 2) for 2 and nu degrees of freedom
    for points, freedom in ((40, share * (80 - 9)), (7, share * (14 - 9)), (5, 2.0)):
        x = outliers.cut(points, 9) ** 2 / 2
        assert (1 + 2 * x / freedom) ** (-freedom / 2) == pytest.approx(outliers.ALPHA / points)
    assert outliers.cut(10**7, 9) == pytest.approx(np.sqrt(-2 * np.log(outliers.ALPHA / 10**7)), rel=1e-4)


def test_samples_of_agreement():
    """One sample of `wanted` is free of outliers with the confidence that was asked for, and not of one fewer."""
    for good, size in ((ransac.LEAST_GOOD, 4), (ransac.LEAST_GOOD_KNOWN, 4), (ransac.LEAST_GOOD, 6)):
        wanted = ransac.samples_needed(size, good=good)
        for count, enough in ((wanted, True), (wanted - 1, False)):
            assert (1 - (1 - good**size) ** count >= ransac.CONFIDENCE) == enough


def test_points_that_agree_with_a_map():
    """The least share of good points that is found without knowing the noise, and the one at which it is not."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(-1, 1, (60, 2))
    exact = 400 * xy / (1 + 0.2 * xy[:, :1]) + (640, 480)
    for share, found in ((ransac.LEAST_GOOD, True), (0.4, False)):
        uv, bad = exact + 0.2 * rng.normal(size=xy.shape), np.arange(60) >= round(60 * share)
        uv[bad] = rng.uniform((0, 0), (1280, 960), (int(bad.sum()), 2))
        mask = ransac.of_maps([View("a", np.c_[xy, np.zeros(60)], uv)], [True])[0].mask
        assert (mask[~bad].mean() > 0.9 and not mask[bad].any()) == found


@pytest.mark.parametrize(("gain", "kept"), [(0.97 * robust.GAIN, False), (1.03 * robust.GAIN, True)])
def test_another_pose_explains_more_points(good, monkeypatch, gain, kept):
    """View 2 kept 30 of 54 points, and RANSAC finds a pose that agrees with `gain` times as many."""
    data = good.observations
    used = np.ones(len(data.uv), bool)
    used[data.slices[2].start : data.slices[2].start + 24] = False
    fit = replace(good, observations=data.with_used(used))
    mask = np.arange(54) < round(gain * 30)
    agreed = ransac.Agreement(mask, 0.2, np.c_[np.eye(3), [0, 0, 9.0]])
    asked = []
    monkeypatch.setattr(robust.ransac, "of_poses", lambda views, *_: asked.append(views[0].id) or [agreed])
    monkeypatch.setattr(robust, "with_poses", lambda *_: "another")
    found = robust.find_better_poses(fit, data, None, 0)
    assert asked == ["view2"] and (found == "another") == kept


# ------------------------------------------------------------------------------------ equations
def test_views_of_a_group():
    count, rows = 50, 12
    most = groups.ROW_BUDGET // (count * 2 * rows)
    views = [View(str(i), np.zeros((count, 3)), np.zeros((count, 2))) for i in range(most + 1)]

    def made(n):
        return groups.make_groups(0, np.arange(n), rows, views[:n], np.zeros((n, 3)), None)

    assert [len(made(n)) for n in (most, most + 1)] == [1, 2]


def test_a_weak_pivot_is_solved_by_orthogonal_factors(monkeypatch):
    problem, state = problem_of("pinhole", count=3)
    blocks = problem.linearise(state)
    for share, solved_again in ((MORE, False), (LESS, True)):
        equations = linear.Linear(problem)
        reduced = SimpleNamespace(step=lambda _: "schur", weakest=share * linear.WEAK)
        monkeypatch.setattr(equations, "_reduced", lambda *_, r=reduced: r)
        monkeypatch.setattr(equations, "_factors", lambda _: SimpleNamespace(step=lambda *_: "qr"))
        assert (equations.step(state, blocks, 0.0) == "qr") == solved_again


def test_either_solver_of_small_equations(monkeypatch):
    """The number of parameters above which scipy is used decides about time only."""
    rows = np.random.default_rng(0).normal(size=(9, 6))
    found = []
    for many in (0, schur.MANY):
        monkeypatch.setattr(schur, "MANY", many)
        found.append(schur._positive_definite(rows.T @ rows, np.arange(6.0)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_a_sparse_jacobian(monkeypatch):
    problem, state = problem_of("pinhole", count=3)
    monkeypatch.setattr(scipy_.rows, "count", lambda _: 1000)
    columns = problem.variables + 6 * problem.instants
    for entries, sparse in ((1000 * columns, False), (1000 * columns - 1, True)):
        monkeypatch.setattr(scipy_, "_DENSE", entries)
        assert scipy_._Function(problem, state, None).sparse == sparse


def test_a_double_root_with_rounding():
    """(x - 2)² + e² has the roots 2 ± ie."""
    for share, real in ((LESS, True), (MORE, False)):
        e = share * p3p._REAL * 2
        c = np.polymul([1, -4, 4 + e * e], [1, 5, 6])
        found = p3p._roots(*(np.array([v]) for v in c))[0]
        assert np.isfinite(found).sum() == (4 if real else 2)


# ------------------------------------------------------------------------------------ rigs
def test_a_turned_board_is_much_nearer():
    for share, turned in ((LESS, 1), (MORE, 0)):
        assert rig_start._nearest(np.array([[1.0], [share * rig_start.NEARER]]))[0] == turned


def test_instants_from_which_a_link_begins(monkeypatch):
    seen = []

    def distances(a, b, candidates, *_):
        seen.append(len(candidates))
        return np.ones((len(candidates), 1, len(a)))

    monkeypatch.setattr(rig_start, "_distances", distances)
    monkeypatch.setattr(rig_start, "_averaged", lambda *_: None)
    for count in (rig_start.TRIED, rig_start.TRIED + 1):
        poses = rig_start.Poses.stack([Pose(np.eye(3), np.array([0.0, 0, 5]))] * count)
        rig_start.link(poses, poses, np.ones(count), [Pose.identity()], grid())
        assert seen[-1] == rig_start.TRIED


# ------------------------------------------------------------------------------------ outliers and noise
def test_a_view_whose_scale_is_not_noise(good):
    """The residuals of one view are larger than the limit times the usual ones, or than a little less."""
    lengths = np.linalg.norm(good.residuals, axis=1)
    rows = good.observations.slices[2]
    for share, bad in ((0.96, ()), (1.04, (2,))):
        residuals = good.residuals.copy()

        def ratio(factor, r=residuals):
            r[rows] = factor * good.residuals[rows]
            test = outliers.test(replace(good, residuals=r))
            every = good.observations.split(np.linalg.norm(r, axis=1))
            own = np.array(
                [outliers.robust_sigma(v, good.free_count * len(v) // len(lengths)) for v in every]
            )
            return own[2] / max(float(np.median(own)), test.sigma), test.bad_views

        factor = 1.0
        for _ in range(30):
            factor *= share * outliers.FAR / ratio(factor)[0]
        assert ratio(factor)[1] == bad


def test_the_evidence_for_another_variance(monkeypatch):
    """Twice the gain of the logarithm of the likelihood; its bound is exceeded by chance once in a thousand sets."""
    assert pytest.approx(stats.norm.isf(0.001) ** 2, rel=1e-6) == noise.EVIDENCE
    residuals = np.random.default_rng(0).normal(size=(200, 2))
    fit = SimpleNamespace(used=np.ones(200, bool), used_residuals=residuals, free_count=0)
    squares = np.square(residuals).sum(1)
    believed = 200 * np.log(np.mean(squares / 2)) + 200
    for share, added in ((LESS, False), (MORE, True)):
        best = believed - share * noise.EVIDENCE / 2
        monkeypatch.setattr(noise, "_likeliest", lambda *_, b=best: (b, np.zeros(2)))
        assert (noise.noise_model(fit, np.ones(200)).floor > 0) == added


def test_given_sigmas_beside_a_large_additional_variance(monkeypatch):
    """Where they are a small part of it, they are left out."""
    fit = SimpleNamespace(
        used=np.ones(50, bool), used_residuals=np.random.default_rng(0).normal(size=(50, 2)), free_count=0
    )
    for share, scale in ((LESS, 0.0), (MORE, MORE * noise._NOTHING * 2.0)):
        logs = np.log([share * noise._NOTHING * 2.0, 2.0])
        monkeypatch.setattr(noise, "_likeliest", lambda *_, v=logs: (-1e9, v))
        made = noise.noise_model(fit, np.ones(50))
        assert (made.scale, made.floor) == pytest.approx((scale, 2.0))


def test_residuals_that_say_nothing_of_the_noise():
    """Beyond so many sigmas, both in px and in given sigmas, a point has no part in it."""
    rng = np.random.default_rng(0)
    residuals = rng.normal(size=(400, 2))
    usual = robust.robust_sigma(np.linalg.norm(residuals, axis=1))
    found = []
    for far in (0.97, 1.03, 30.0):
        residuals[0] = (far * noise._REACH * np.sqrt(2) * usual, 0)
        fit = SimpleNamespace(used=np.ones(400, bool), used_residuals=residuals, free_count=0)
        found.append(noise.noise_model(fit, np.ones(400)).scale)
    assert found[0] > 1.01 * found[1] and found[1] == pytest.approx(found[2], rel=1e-9)


def test_a_point_that_agrees_with_a_hypothesis():
    """Up to so many sigmas errors count by their squares, beyond all alike; 1 % of Gaussian ones are beyond."""
    assert stats.rayleigh.sf(ransac._REACH) == pytest.approx(0.01, rel=0.03)
    limit = ransac._REACH * 0.5
    scores = ransac._scores(np.array([[LESS * limit], [limit], [MORE * limit], [9 * limit]]), 0.5)
    assert scores[0] < scores[1] == scores[2] == scores[3] == pytest.approx(limit**2)
    # exact data: an error of a millionth of a pixel is rounding
    for share, agrees in ((LESS, True), (MORE, False)):
        model = SimpleNamespace(sample=4, fit=lambda rows, m: (m, np.ones(20)))
        model = type("Exact", (SimpleNamespace,), {"__len__": lambda _: 20})(**vars(model))
        error = np.r_[np.zeros(19), share * ransac._REACH * ransac._FLOOR]
        assert ransac._optimise(model, np.eye(3), error, None)[0].mask[-1] == agrees


@pytest.mark.parametrize(("more", "asked"), [(0.01, True), (-0.01, False)])
def test_a_view_that_lost_many_points(good, monkeypatch, more, asked):
    """Its pose is looked for again where it lost so many more of its points than the others."""
    data = good.observations
    used = np.ones(len(data.uv), bool)
    lost = round(54 * (robust.MUCH + more) + (0.5 if more > 0 else -0.5))
    used[data.slices[2].start : data.slices[2].start + lost] = False
    assert (lost / 54 > robust.MUCH) == asked
    views = []
    nothing = ransac.Agreement(used[:54], 0.2, None)
    monkeypatch.setattr(robust.ransac, "of_poses", lambda some, *_: views.append(some[0].id) or [nothing])
    robust.find_better_poses(replace(good, observations=data.with_used(used)), data, None, 0)
    assert views == ["view2"] * asked


# ------------------------------------------------------------------------------------ rigs: lags
def lag_of(monkeypatch, scatter, pairs=20):
    """The lag that is found where boards at a lag of 2 frames are `scatter` apart, beside 1 without a lag."""
    tried = []

    def shared(_, __, ___, lag):
        tried.append(lag)
        return np.full(pairs, lag), np.full(pairs, lag)

    monkeypatch.setattr(rig_lags, "shared", shared)
    monkeypatch.setattr(
        rig_lags, "link", lambda lag, *_: SimpleNamespace(scatter=scatter if lag == 2 else 1.0)
    )
    poses = type("Lags", (), {"__getitem__": lambda _, i: int(i[0])})()
    pictures = SimpleNamespace(poses=poses, variance=np.ones(100))
    known = SimpleNamespace(scatter=1.0, expected=0.01)
    return rig_lags._lag(pictures, 0, 1, known, [], None), tried


def test_a_camera_that_lags(monkeypatch):
    for share, lag in ((LESS, 2), (MORE, 0)):
        found, tried = lag_of(monkeypatch, share * rig_lags.NEARER)
        assert found == lag and sorted(tried) == [k for k in range(-rig_lags.MOST, rig_lags.MOST + 1) if k]
    for pairs, lag in ((rig_lags.LEAST, 2), (rig_lags.LEAST - 1, 0)):
        assert lag_of(monkeypatch, 0.1, pairs)[0] == lag


def test_an_instant_far_from_the_pose_of_a_pair(monkeypatch):
    for share, counted in ((LESS, 9), (MORE, 8)):
        apart = np.r_[np.ones(8), share * rig_start.FAR]
        monkeypatch.setattr(rig_start, "_distances", lambda *_, d=apart: d[None, None])
        poses = rig_start.Poses.stack([Pose(np.eye(3), np.array([0.0, 0, 5]))] * 9)
        found = rig_start._averaged(poses, poses, np.ones(9), Pose.identity(), [Pose.identity()], grid())
        assert found.information == counted


# ------------------------------------------------------------------------------------ starts
def test_views_that_are_moved_into_the_domain_of_a_lens(good):
    """No point is farther from the axis than the angle, and those nearer stay."""
    data, poses = good.observations, good.poses
    for degrees in (5.0, 80.0):
        moved = starts._pushed(poses, data, np.radians(degrees))
        for view, r, t, before in zip(
            data.views, moved.rotations, moved.translations, poses.translations, strict=True
        ):
            x, y, z = (view.xyz @ r.T + t).T
            largest = np.degrees(np.arctan2(np.hypot(x, y), z)).max()
            assert largest <= degrees + 1e-6
            assert (largest == pytest.approx(degrees)) == (degrees < 20)
            assert (t == before).all() == (degrees > 20)
    (part, first), (other, second) = starts.CONES
    assert 1 > part > other > 0.8 and np.pi / 2 > first > second  # the farther ones first, then with a margin


def test_principal_points_from_which_is_started_again(good, monkeypatch):
    """Half-way and at the end of the joint interval of the principal point, in eight directions."""
    monkeypatch.setattr(starts, "start_poses", lambda camera, _: camera)
    centre = good.camera.matrix[:2, 2]
    sigmas = {"cx": 3.0, "cy": 2.0}
    tried = starts.about(good, sigmas, {})
    off = (np.array([c.matrix[:2, 2] for c, _ in tried]) - centre) / (3, 2)
    assert len(tried) == 1 + 8 * len(starts.REACHES)
    assert sorted({round(float(v), 6) for v in np.abs(off).max(1)}) == [0.0, *starts.REACHES]
