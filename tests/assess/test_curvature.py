"""Sigmas that the linearisation makes too small are found, and honest ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks import check
from camcal.assess.covariance import covariance
from camcal.assess.curvature import beyond_linear, curved_share
from camcal.data.points import read_points
from camcal.plan.calibrate import calibrate
from camcal.report.document import document
from tests.shared_data import DATA, needs_data
from tests.solved import camera_of, grid, observe, solved, tilted_poses


def needless(seed=1):
    """A rational model on a lens that needs two coefficients: the denominator cancels the numerator."""
    rng = np.random.default_rng(seed)
    poses = tilted_poses(grid(), 12, rng)
    data = observe(camera_of("opencv4"), poses, grid(), 0.2, rng)
    return calibrate(data, model="opencv8", checks=False)


@pytest.mark.parametrize("seed", [1, 2])
def test_coefficients_that_lie_on_a_curve_are_undetermined(seed):
    s = needless(seed)
    c = beyond_linear(s, covariance(s))
    assert {"k1", "k2", "k4", "k5"} <= set(c.undetermined)
    assert c.sigmas["k1"] == np.inf and 0 < c.sigmas["cx"] < np.inf
    # what lies within is not touched, projections least of all
    assert np.array_equal(c.free, covariance(s).free)


def test_the_report_and_the_warnings_say_so():
    s = needless()
    parameters = document(s)["camera"]["parameters"]
    assert parameters["k1"]["sigma"] == np.inf and np.isfinite(parameters["cy"]["sigma"])
    said = next(w for w in check(s) if w.code == "undetermined-parameters")
    assert "k1" in said.message and "cx" not in said.message


@pytest.mark.parametrize("options", [{}, {"noise": 1.0, "views": 4}, {"fix": {"aspect": None}}])
def test_regular_models_keep_their_sigmas(options):
    s = solved(**options)
    c = covariance(s)
    assert beyond_linear(s, c) is c and not curved_share(s, c).any()


@needs_data
def test_poses_that_follow_far_are_no_curvature():
    # principal point, decentering and poses move together: held to a straight line the sum of squares grows 65 times
    # as much as it should, with poses that follow by .9
    s = calibrate(
        read_points(DATA / "opencv_calib1/points.csv", image_size=(640, 480)), model="opencv4", checks=False
    )
    c = covariance(s)
    assert c.condition > 1e5 and not curved_share(s, c).any()


def test_a_camera_that_is_known_or_without_redundancy_is_left_alone():
    s = solved(views=4, fix=dict.fromkeys(camera_of().lens.names))
    c = covariance(s)
    assert beyond_linear(s, c) is c
    t = solved(views=4)
    d = replace(covariance(t), sigma_0=float("nan"))
    assert beyond_linear(t, d) is d
