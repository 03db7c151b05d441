"""Standard deviations of relative poses and baselines."""

from dataclasses import replace

import numpy as np
import pytest

from camcal import calibrate_rig
from camcal.assess.checks import ALSO, CHECKS, KNOWN, RIG, checks_of, facts, fit, noise, views
from camcal.assess.covariance import covariance
from camcal.assess.rig import baseline_sigma, relative_sigmas
from camcal.assess.rig_checks import check
from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from tests.rigs import LENS, observed, truth


def solved(seed=0, names="abc", **more):
    data, _ = observed(truth(names), seed)
    return calibrate_rig(data, model=LENS, checks=False, **more)


def moved(rig, name, step):
    """The rig with one camera's pose perturbed on the left."""
    pose = rig.cam_from_rig[name]
    poses = dict(rig.cam_from_rig)
    poses[name] = Pose(rotations.exp(step[:3]) @ pose.rotation, pose.translation + step[3:])
    return Rig(rig.cameras, poses, rig.reference)


@pytest.mark.parametrize(("a", "b"), [("a", "b"), ("b", "c")])
def test_a_baseline_moves_as_its_sigma_says(a, b):
    """The linear propagation is that of numerical differences of the distance itself."""
    solution = solved()
    accuracy = covariance(solution)
    row = np.zeros(solution.free.shape[1])
    for name, at in solution.extrinsics.items():
        for k in range(6):
            step = np.zeros(6)
            step[k] = 1e-5
            up, down = (moved(solution.rig, name, s).baseline(a, b) for s in (step, -step))
            row[at.start + k] = (up - down) / 2e-5
    known = np.sqrt(row @ accuracy.free @ row)
    assert baseline_sigma(solution, accuracy, a, b) == pytest.approx(known, rel=1e-5)


def test_sigmas_are_those_of_the_scatter():
    """25 rigs: the mean sigma is the scatter to three standard errors of a scatter of 25 draws (3 / sqrt(50))."""
    found = [solved(seed, "ab") for seed in range(25)]
    shift = np.array([s.rig.cam_from_rig["b"].translation for s in found])
    sigmas = np.array([relative_sigmas(s, covariance(s), "b")[3:] for s in found])
    ratio = np.sqrt(np.square(sigmas).mean(0)) / shift.std(0, ddof=1)
    assert (np.abs(ratio - 1) < 3 / np.sqrt(50)).all()


def test_the_reference_does_not_change_what_is_known():
    """Gauge: the baseline and its sigma are the same in every camera's frame."""
    found = [solved(reference=name) for name in "abc"]
    values = [s.rig.baseline("b", "c") for s in found]
    sigmas = [baseline_sigma(s, covariance(s), "b", "c") for s in found]
    np.testing.assert_allclose(values, values[0], rtol=1e-7)
    np.testing.assert_allclose(sigmas, sigmas[0], rtol=1e-4)


def test_the_size_of_a_free_board_is_that_of_the_design():
    """A board whose points are all free: its size is that of the ideal board, so that a baseline stays known."""
    flat, free = solved(), solved(board_shape="free")
    assert free.board is not None
    value = free.rig.baseline("a", "b")
    sigma = baseline_sigma(free, covariance(free), "a", "b")
    assert abs(value - truth().baseline("a", "b")) < 4 * sigma
    assert sigma < 2 * baseline_sigma(flat, covariance(flat), "a", "b")


def test_checks_of_a_rig_take_no_profiles_of_its_cameras(monkeypatch):
    """Their warnings are on what a camera's own views determine; of a rig out of step they took most of the time."""

    def profile(solution):
        raise AssertionError("a profile of the sum of squares")

    solution = solved()
    monkeypatch.setattr(facts, "accuracy", profile)
    assert check(solution, {"c": 1})[0].code == "cameras-out-of-step"
    rounded = replace(
        solution, observations=replace(solution.observations, uv=solution.observations.uv.round())
    )
    said = [w.message for w in check(rounded, {}) if w.code == "rounded-coordinates"]
    assert [m.partition(":")[0] for m in said] == ["camera a", "camera b", "camera c"]


@pytest.mark.parametrize(("use", "other"), [(RIG, views.mirrored), (KNOWN, noise.tails)])
def test_checks_that_apply_elsewhere_are_some_of_those_of_one_camera(use, other):
    assert set(ALSO) < set(CHECKS) and len(set(CHECKS)) == len(CHECKS)
    assert other in ALSO and other not in checks_of(use)
    assert fit.outliers in checks_of(use) and views.few_views not in checks_of(use)
