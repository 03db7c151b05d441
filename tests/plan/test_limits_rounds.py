"""Rounds of the plan's searches and what rounding may do there: each number just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model.pose import Pose, Poses
from camcal.plan import boards, minima, outlying, rig_drift, rig_turns, single_view
from camcal.solve import outliers, robust
from camcal.solve.losses import LOSSES
from camcal.solve.refine import How, refine
from tests.plan import test_single_view as single
from tests.rigs import observed, truth
from tests.sides import LESS, MORE
from tests.solved import solved


# ------------------------------------------------------------------------------------ one camera
@pytest.mark.parametrize(
    ("left", "fits"), [(LESS, 1), (MORE, boards.READOUT_STEPS), (-LESS, 1), (-MORE, boards.READOUT_STEPS)]
)
def test_steps_to_a_readout_time(monkeypatch, left, fits):
    """They end where less than a standard deviation is left, and after so many: of each, half is left."""
    monkeypatch.setattr(boards, "refit", lambda *_: None)
    monkeypatch.setattr(boards.rolling, "corrected", lambda _, time: made.append(time))
    monkeypatch.setattr(boards.rolling, "readout", lambda _: SimpleNamespace(time=left, sigma=1.0))
    made = []
    time, _ = boards._corrected_fit(SimpleNamespace(observations=None), 0.5, How())
    assert len(made) == fits and time == made[-1] == pytest.approx(0.5 + (fits - 1) * left)


def test_a_readout_time_is_found_in_two_steps(monkeypatch):
    """Each step leaves a fortieth, of a time that is known to a hundredth: half of the steps are enough."""
    monkeypatch.setattr(boards, "refit", lambda _, time, __: time)
    monkeypatch.setattr(boards.rolling, "corrected", lambda _, time: time)
    for most in (boards.READOUT_STEPS, boards.READOUT_STEPS // 2):
        monkeypatch.setattr(boards, "READOUT_STEPS", most)

        def readout(corrected):
            return SimpleNamespace(time=(0.8 - corrected) * 39 / 40, sigma=0.01)

        monkeypatch.setattr(boards.rolling, "readout", readout)
        assert boards._corrected_fit(SimpleNamespace(observations=None), 0.78, How())[0] == pytest.approx(
            0.8, abs=0.01
        )


def test_a_lower_minimum_is_followed_to_its_end_and_searched_once(monkeypatch):
    fit = solved(views=4)
    lower = replace(fit, fit=replace(fit.fit, cost=0.5 * fit.fit.cost))
    searched = []
    monkeypatch.setattr(minima, "_lowest_of", lambda _, fit, __: searched.append(fit) or lower)
    monkeypatch.setattr(minima, "to_its_end", lambda fit, _: ("end", fit))
    assert minima.spread(fit, How()) == ("end", lower) and searched == [fit]


def with_outliers():
    good = solved("pinhole", views=4)
    rng = np.random.default_rng(1)
    uv = good.observations.uv.copy()
    bad = rng.random(len(uv)) < 0.3
    uv[bad] += rng.uniform(-8, 8, (int(bad.sum()), 2)) + [6.0, 0.0]
    return refine(good.camera, good.poses, replace(good.observations, uv=uv), How())


def test_reweightings_by_which_points_are_judged():
    """The same points are rejected after twice as many, and others after none of them."""
    fit = with_outliers()
    found = {}
    for rounds in (0, outlying.LOSS_ROUNDS, 2 * outlying.LOSS_ROUNDS):
        made = robust.reweight(fit, How(), LOSSES[outlying.LOSS], rounds=rounds)
        found[rounds] = outliers.test(made).used
    few, usual, more = found.values()
    np.testing.assert_array_equal(usual, more)
    assert not np.array_equal(few, usual)


@pytest.mark.parametrize(("share", "determined"), [(LESS, False), (MORE, True)])
def test_rounding_of_the_normal_equations_of_one_view(monkeypatch, share, determined):
    """Sigmas are those of a principal point that the distortion shows, until an eigenvalue is rounding."""
    data = single.view(single.GRID, -0.4, 0.05)
    camera = single.Camera(
        single.lenses.make("division:1"), np.array([1000.0, 1000, 645, 470, -0.4]), single.SIZE
    )
    eigen = single_view.unit_eigen

    def scaled(normal):
        values, vectors, units = eigen(normal)
        values = values.copy()
        values[0] = share * single_view.ROUNDING * values[-1]
        return values, vectors, units

    poses = Poses.stack([single.POSE])
    assert np.isfinite(single_view._sigmas(camera, poses, data, np.eye(5))).all()
    monkeypatch.setattr(single_view, "unit_eigen", scaled)
    assert np.isfinite(single_view._sigmas(camera, poses, data, np.eye(5))).all() == determined


# ------------------------------------------------------------------------------------ rigs
def test_samples_of_instants():
    """Of half outliers all samples hold one in one of two hundred problems; of one sample fewer in more."""
    bad = 1 - 0.5**3
    assert bad**rig_turns.SAMPLES <= 1 / 200 < bad ** (rig_turns.SAMPLES - 1)


@pytest.mark.parametrize(
    ("misfits", "kept"), [((3.0, 2.0, 1.0, 1.0), 2), ((3.0, 2.0, 2.5), 1), ((3.0, None), 0)]
)
def test_turns_are_chosen_again_while_more_instants_agree(monkeypatch, misfits, kept):
    """The choice with the smallest misfit is taken: it is not given up for a larger one, and 1 is not reached twice."""
    choices = iter([None if m is None else (m, i, i) for i, m in enumerate(misfits)])
    sample = np.arange(3)
    pair = Poses.stack([Poses.stack([Pose(np.eye(3), np.zeros(3))] * 2)] * 3)
    monkeypatch.setattr(rig_turns, "_samples", lambda _: iter([sample]))
    monkeypatch.setattr(rig_turns, "_ways", lambda *_: iter([((0, 0),) * 3]))
    monkeypatch.setattr(rig_turns, "_nearest", lambda *_: next(choices))
    assert rig_turns.agreed_both(pair, pair, lambda *_: None) == (kept, kept)
    assert next(choices, None) is None


@pytest.mark.parametrize("share", [LESS, MORE])
def test_the_variance_of_exact_points(monkeypatch, share):
    """Below it the variance of a picture's points is rounding."""
    rig = truth("ab")
    data, poses = observed(rig, instants=3)
    solve = rig_drift.solve_poses
    size = sum(c.lens.size for c in rig.cameras.values())
    least = rig_drift.LEAST_VARIANCE

    def solved_poses(problem, state):
        freedom = 2 * sum(map(len, problem.views)) - 6 * len(problem.views)
        costs = np.full(len(problem.views), 0.5 * share * least * freedom / len(problem.views))
        return SimpleNamespace(state=solve(problem, state).state, costs=costs)

    monkeypatch.setattr(rig_drift, "solve_poses", solved_poses)
    found = rig_drift._pictures(SimpleNamespace(rig=rig, free=np.eye(size)), data, Poses.stack(poses))
    variances = [picture.variance for pictures in found.values() for picture in pictures]
    assert variances == pytest.approx([max(share, 1.0) * least] * 6, rel=1e-9)


def test_exact_points_are_below_it_and_noise_is_not():
    rig = truth("ab")
    size = sum(c.lens.size for c in rig.cameras.values())
    for noise, exact in ((0.0, True), (1e-4, False)):
        data, poses = observed(rig, instants=3, noise=noise)
        found = rig_drift._pictures(SimpleNamespace(rig=rig, free=np.eye(size)), data, Poses.stack(poses))
        assert all((p.variance == rig_drift.LEAST_VARIANCE) == exact for own in found.values() for p in own)
