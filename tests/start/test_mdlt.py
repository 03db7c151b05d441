"""The modified DLT: orthogonal pixel axes, the constrained least squares, leave-one-out."""

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.routes.pose_fit import refine_pose
from camcal.start import mdlt
from tests.start.scenes import K_NO_SKEW, board, rig, scene


def matrix_rms(m, view):
    q = np.c_[view.xyz, np.ones(len(view))] @ m.T
    return np.sqrt(np.square(q[:, :2] / q[:, 2:] - view.uv).sum(1).mean())


def test_exact_points_give_the_camera():
    made = scene(rig(), [[0.3, -0.2, 0.1]], K_NO_SKEW)
    found = mdlt.estimate(made.observations)
    np.testing.assert_allclose(found.matrix, K_NO_SKEW, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(found.poses.rotations, made.poses.rotations, atol=1e-9)


def test_it_is_the_least_squares_camera_without_skew():
    made = scene(rig(), [[0.3, -0.2, 0.1]], K_NO_SKEW, noise=0.5)
    found, view = mdlt.estimate(made.observations), made.observations.views[0]
    assert found.matrix[0, 1] == 0
    best = matrix_rms(found.projection_matrix, view)
    lens = lenses.make("pinhole")
    for index in range(4):  # no change of the intrinsics, pose refitted, brings the error down
        for sign in (-1, 1):
            params = lens.from_matrix(found.matrix)
            params[index] += sign * 0.5
            fit = refine_pose(Camera(lens, params), view.xyz, view.uv, np.ones(len(view)), found.poses[0])
            assert np.sqrt(2 * fit.normal.cost / len(view)) > best


def test_leave_one_out_is_what_leaving_one_out_gives():
    made = scene(rig(12), [[0.3, -0.2, 0.1]], K_NO_SKEW, noise=0.5)
    view, squares = made.observations.views[0], []
    for i in range(len(view)):
        others = np.arange(len(view)) != i
        m = mdlt.constrained(view.take(others))[0]
        q = np.append(view.xyz[i], 1) @ m.T
        squares.append(np.square(q[:2] / q[2] - view.uv[i]).sum())
    said = mdlt.estimate(made.observations).info["leave_one_out"]
    assert abs(said / np.sqrt(np.mean(squares)) - 1) < 0.05  # first order in the residuals


@pytest.mark.parametrize("points, turns", [(board(), [[0.3, 0, 0]]), (rig(), [[0.3, 0, 0], [0, 0.3, 0]])])
def test_planes_and_several_views_are_refused(points, turns):
    with pytest.raises(EstimationError, match="one view of points in space"):
        mdlt.estimate(scene(points, turns).observations)


def test_sigmas_weigh_the_points():
    made = scene(rig(), [[0.3, -0.2, 0.1]], K_NO_SKEW)
    view = made.observations.views[0]
    uv, sigma = view.uv.copy(), np.ones(len(view))
    uv[0] += 30
    sigma[0] = 1e4
    found = mdlt.estimate(Observations.from_views([View("v", view.xyz, uv, sigma)]))
    np.testing.assert_allclose(found.matrix, K_NO_SKEW, atol=1e-3)
