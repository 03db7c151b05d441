"""The DLT with 12, 14 and 16 coefficients: truth, its relation to the eleven, leave-one-out residuals."""

import numpy as np
import pytest

from camcal.data.observations import Observations
from camcal.errors import DataError, EstimationError
from camcal.plan.calibrate import calibrate
from camcal.start import dlt, dlt_distorted, mdlt
from camcal.start.base import scaled
from tests.shared_data import DATA, needs_data
from tests.start import scenes

FORMS = {12: dlt_distorted.estimate12, 14: dlt_distorted.estimate14, 16: dlt_distorted.estimate16}
TERMS = np.array([2e-8, -3e-14, 1e-20, 2e-6, -1e-6])  #: 8 px of 40 in the corners
POSE = scenes.Poses(scenes.rotations.exp(np.array([[0.3, -0.4, 0.2]])), np.array([[0.01, 0.02, 0.5]]))[0]


def bent(terms, xyz, noise=0.0, seed=0):
    """Images whose ideal point is u - Δu, by the equations of the module's docstring, solved for u."""
    ideal = scenes.seen(scenes.K_NO_SKEW, POSE, xyz)
    centre = scenes.K_NO_SKEW[:2, 2]
    uv = ideal.copy()
    for _ in range(60):
        xi, eta = (uv - centre).T
        r2 = xi**2 + eta**2
        radial = terms[0] * r2 + terms[1] * r2**2 + terms[2] * r2**3
        du = xi * radial + terms[3] * (r2 + 2 * xi**2) + terms[4] * xi * eta
        dv = eta * radial + terms[3] * xi * eta + terms[4] * (r2 + 2 * eta**2)
        uv = ideal + np.stack([du, dv], 1)
    return uv + np.random.default_rng(seed).normal(0, noise, uv.shape)


def data(terms, count=60, noise=0.0, seed=0):
    xyz = scenes.rig(count)
    return Observations.from_views([(xyz, bent(terms, xyz, noise, seed))], scenes.SIZE)


@pytest.mark.parametrize("count, kept", [(12, 1), (14, 3), (16, 5)])
def test_exact_points_give_all_coefficients(count, kept):
    terms = np.where(np.arange(5) < kept, TERMS, 0)
    found = FORMS[count](data(terms))
    np.testing.assert_allclose(found.matrix, scenes.K_NO_SKEW, atol=1e-4)
    projection = scaled(scenes.K_NO_SKEW @ np.c_[POSE.rotation, POSE.translation])
    np.testing.assert_allclose(found.info["coefficients"][:11], projection.ravel()[:11], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.info["coefficients"][11:], terms[:kept], rtol=1e-3)
    assert found.info["leave_one_out"] < 1e-6


def test_without_distortion_they_are_the_eleven():
    clean = data(np.zeros(5))
    eleven = dlt.estimate(clean).projection_matrix
    for form in FORMS.values():
        np.testing.assert_allclose(form(clean).projection_matrix, eleven, rtol=1e-6, atol=1e-6)


def test_leave_one_out_is_what_leaving_one_out_gives():
    """The formula holds R and the principal point, which hardly move with one point of forty."""
    whole = data(TERMS, 40, 0.5)
    view, squares = whole.views[0], []
    for i in range(40):
        rest = np.arange(40) != i
        found = dlt_distorted.estimate12(
            Observations.from_views([(view.xyz[rest], view.uv[rest])], scenes.SIZE)
        )
        l = np.array(found.info["coefficients"])  # noqa: E741 as in the literature
        m = found.projection_matrix
        c = m[:2, :3] @ m[2, :3] / (m[2, :3] @ m[2, :3])
        q = m @ np.r_[view.xyz[i], 1]
        off = view.uv[i] - c
        squares.append(((view.uv[i] - off * l[11] * (off @ off) - q[:2] / q[2]) ** 2).sum())
    said = dlt_distorted.estimate12(whole).info["leave_one_out"]
    assert said == pytest.approx(np.sqrt(np.mean(squares)), rel=0.05)


def test_noise_and_the_refinement_from_there():
    noisy = data(TERMS, 200, 0.3)
    found = dlt_distorted.estimate16(noisy)
    assert abs(found.matrix[0, 0] / 1000 - 1) < 0.02
    # residuals of 400 coordinates less 16 coefficients, predicted ones a little larger than the noise of a point
    assert 0.36 < found.info["leave_one_out"] < 0.52
    best = calibrate(noisy, model="opencv5", robust="none", checks=False)
    made = calibrate(noisy, model="opencv5", start="dlt16", robust="none", checks=False)
    assert made.rms_point == pytest.approx(best.rms_point, abs=1e-6)


@needs_data
def test_a_surveyed_field():
    """89 surveyed points: the surveyors' focal length is 6185.75 px."""
    from camcal.data.points import read_points

    view = read_points(DATA / "whu" / "9282.csv").views[0]
    whu = Observations.from_views([(view.xyz, view.uv)], (4272, 2848))
    eleven = mdlt.estimate(whu)
    twelve = dlt_distorted.estimate12(whu)
    assert abs(twelve.matrix[0, 0] / 6185.75 - 1) < 0.01
    assert twelve.info["leave_one_out"] < 0.6 * eleven.info["leave_one_out"]


def test_what_is_refused():
    with pytest.raises(DataError, match="8 points; 16 coefficients need 9"):
        dlt_distorted.estimate16(data(TERMS, 8))
    with pytest.raises(EstimationError, match="one view of points in space, not a plane"):
        dlt_distorted.estimate14(scenes.scene(scenes.board(), scenes.tilts(1)).observations)
