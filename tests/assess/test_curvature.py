"""Sigmas that the linearisation makes too small are found, and honest ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks import check
from camcal.assess.covariance import covariance
from camcal.assess.curvature import _inside, accuracy, beyond_linear
from camcal.assess.uncertainty import projection_uncertainty, worst_sigma
from camcal.data.points import read_points
from camcal.model.camera import Camera
from camcal.model.lenses import make
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
def test_coefficients_that_lie_on_a_curve_get_the_interval_of_their_profile(seed):
    s = needless(seed)
    linear = covariance(s)
    c = beyond_linear(s, linear)
    # the lens has neither k4 nor k5 nor k6: its own coefficients are among those that fit
    truth = camera_of("opencv4").params
    for i, name in enumerate(("k1", "k2"), 4):
        error = abs(s.camera.params[i] - truth[i])
        assert error <= 2 * c.sigmas[name]
        assert c.sigmas[name] > 2 * linear.sigmas[name]
    assert c.sigmas["cx"] == linear.sigmas["cx"]
    # what lies within is not touched, projections least of all
    assert np.array_equal(c.free, linear.free)


def test_no_end_of_the_interval_is_undetermined_and_said():
    s = needless(2)
    parameters = document(s)["camera"]["parameters"]
    assert parameters["k1"]["sigma"] == np.inf and np.isfinite(parameters["cy"]["sigma"])
    said = next(w for w in check(s) if w.code == "undetermined-parameters")
    assert "k1" in said.message and "cx" not in said.message


@needs_data
@pytest.mark.parametrize("name", ["so_cube_1600x1200.csv", "dlt8_v1.csv"])
def test_growth_faster_than_quadratic_leaves_the_sigma(name):
    # fx: linear 532 and 452, parametric bootstrap 512 and 529
    s = calibrate(read_points(DATA / "cases" / name), model="pinhole", checks=False)
    c = covariance(s)
    assert np.array_equal(accuracy(s).matrix, c.matrix) and not accuracy(s).undetermined


def test_the_accuracy_of_a_fit_is_found_once():
    s = solved(views=4)
    assert accuracy(s) is accuracy(replace(s, stages=())) is not accuracy(solved(views=4, noise=1.0))


@pytest.mark.parametrize("options", [{}, {"noise": 1.0, "views": 4}, {"fix": {"aspect": None}}])
def test_regular_models_keep_their_sigmas(options):
    s = solved(**options)
    c = covariance(s)
    assert np.array_equal(beyond_linear(s, c).matrix, c.matrix)


@needs_data
def test_poses_that_follow_far_are_no_curvature():
    # principal point, decentering and poses move together: held to a straight line the sum of squares grows 65 times
    # as much as it should, with poses that follow by .9
    s = calibrate(
        read_points(DATA / "opencv_calib1/points.csv", image_size=(640, 480)), model="opencv4", checks=False
    )
    c = covariance(s)
    assert c.condition > 1e5 and np.array_equal(beyond_linear(s, c).matrix, c.matrix)


def test_a_camera_that_is_known_or_without_redundancy_is_left_alone():
    s = solved(views=4, fix=dict.fromkeys(camera_of().lens.names))
    c = covariance(s)
    assert beyond_linear(s, c) is c
    t = solved(views=4)
    d = replace(covariance(t), sigma_0=float("nan"))
    assert beyond_linear(t, d) is d


PLACES = np.array([[0.0, 0], [639, 0], [0, 479], [639, 479], [320, 240]])


@pytest.mark.parametrize("seed", [1, 3])
def test_projections_take_the_ends_of_curved_intervals_into_account(seed):
    s = needless(seed)
    linear, whole = (
        worst_sigma(projection_uncertainty(s, c).at_pixels(PLACES)) for c in (covariance(s), accuracy(s))
    )
    assert (whole >= linear * (1 - 1e-9)).all() and (whole[:4] > linear[:4]).all()
    # in the centre, where there are points, all cameras along the curve project alike
    assert whole[4] < 1.1 * linear[4]


def test_projections_of_a_regular_model_stay():
    s = solved(views=8)
    spread = [projection_uncertainty(s, c).at_pixels(PLACES) for c in (covariance(s), accuracy(s))]
    assert np.array_equal(*spread)


def test_intervals_reach_to_a_model_inside_that_fits_as_well():
    """Lenses without a denominator: what opencv8 says of its coefficients holds them, or is infinite."""
    truth = camera_of("opencv4")
    for seed in range(1, 5):
        s = needless(seed)
        c = accuracy(s)
        for i, name in enumerate(s.camera.lens.names):
            value = truth.params[truth.lens.index(name)] if name in truth.lens.names else 0.0
            assert abs(s.camera.params[i] - value) <= 3.5 * c.sigmas[name], (seed, name)


def test_a_denominator_that_is_needed_keeps_its_sigmas():
    """A lens of 120 degrees, whose coefficients are those of a real one with a strong denominator."""
    rng = np.random.default_rng(3)
    values = {"fx": 220.0, "fy": 220.0, "cx": 322.0, "cy": 238.0}
    values |= {"k1": 0.479, "k2": 0.0267, "k3": 9e-5, "k4": 0.767, "k5": 0.0963, "k6": 0.0014}
    lens = make("opencv8")
    truth = Camera(lens, lens.from_values(values), (640, 480))
    poses = tilted_poses(grid(), 20, rng, distance=(5.0, 7.0))
    s = calibrate(observe(truth, poses, grid(), 0.1, rng), model="opencv8", checks=False)
    assert _inside(s, covariance(s)) is None


def test_parameters_that_are_tied_are_left_alone():
    s = solved(model="opencv8", fix={"aspect": None})
    assert _inside(s, covariance(s)) is None
