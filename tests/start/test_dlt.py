"""The direct linear transformation and Barranco & Medel's estimator, where they differ from each other."""

import numpy as np
import pytest

from camcal.data.observations import Correspondences
from camcal.errors import EstimationError
from camcal.geometry import dlt as resection
from camcal.start import central, dlt
from tests.start import scenes

TURN = [[0.3, -0.4, 0.2]]


def moved(scene, depth):
    """The same view, with the world's origin at `depth` in front of the camera."""
    view, pose = scene.observations.views[0], scene.poses[0]
    cam = pose.apply(view.xyz)
    return Correspondences.from_views([((cam - [0.1, 0.2, depth]) @ pose.rotation, view.uv)])


def test_central_s_rows_are_the_projection_equations():
    scene = scenes.scene(scenes.rig(), TURN)
    view, pose = scene.observations.views[0], scene.poses[0]
    m = scenes.K @ np.c_[pose.rotation, pose.translation]
    m /= m[2, 3]
    c = central.Central(view.xyz, view.uv)
    assert c.shape == (60, 11)
    np.testing.assert_allclose(
        c @ central.Column(m, "rows")[:11], central.Column(view.uv, "rows"), rtol=1e-11
    )


def test_column_runs_by_rows_or_down_columns():
    m = np.arange(12).reshape(3, 4)
    assert central.Column(m).tolist() == list(range(12))
    assert central.Column(m, order="columns").tolist() == [0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11]
    # the paper's Y has the points as columns: running down them pairs u and v as rows of points do
    y = np.random.default_rng(0).normal(size=(5, 2))
    np.testing.assert_array_equal(central.Column(y.T, "columns"), central.Column(y, "rows"))
    with pytest.raises(ValueError, match="neither"):
        central.Column(m, order="C")


def test_central_is_the_least_squares_solution_with_a_squared_condition_number():
    scene = scenes.scene(scenes.rig(), TURN, noise=0.5)
    view = scene.observations.views[0]
    m, condition = central.projection_matrix(view.xyz, view.uv)
    c = central.Central(view.xyz, view.uv)
    normal = c.T @ c
    by_normal_equations = np.linalg.solve(normal, c.T @ view.uv.ravel())
    # the normal equations lose the digits of their condition number, about 1e9 here
    np.testing.assert_allclose(m.ravel()[:11], by_normal_equations, rtol=1e-4)
    info = central.estimate(scene.observations).info
    assert info["condition"] == pytest.approx(condition)
    assert info["condition_normal_equations"] == pytest.approx(np.linalg.cond(normal), rel=1e-3)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_central_says_so_where_m34_is_near_0(noise):
    scene = scenes.scene(scenes.rig(), TURN, noise=noise)
    with pytest.raises(EstimationError, match="m34 is near 0"):
        central.estimate(moved(scene, 0.0))
    central.estimate(moved(scene, 0.3))


def test_dlt_needs_no_m34():
    scene = scenes.scene(scenes.rig(), TURN)
    found = dlt.estimate(moved(scene, 0.0))
    np.testing.assert_allclose(found.matrix, scenes.K, atol=1e-6)
    assert np.linalg.norm(found.projection_matrix) == pytest.approx(1)


def test_dlt_of_a_single_array():
    scene = scenes.scene(scenes.rig(), TURN)
    view = scene.observations.views[0]
    m = resection.dlt(view.xyz, view.uv)
    x = np.c_[view.xyz, np.ones(30)] @ m.T
    assert (x[:, 2] > 0).all() and np.linalg.norm(m) == pytest.approx(1)
    np.testing.assert_allclose(x[:, :2] / x[:, 2:], view.uv, atol=1e-10)


def test_six_points_are_enough():
    scene = scenes.scene(scenes.rig(6), TURN)
    np.testing.assert_allclose(dlt.estimate(scene.observations).matrix, scenes.K, atol=1e-5)


def test_a_repeated_point_leaves_six_open():
    view = scenes.scene(scenes.rig(6), TURN).observations.views[0].take([0, 1, 2, 3, 4, 4])
    with pytest.raises(EstimationError, match="do not determine"):
        dlt.estimate(Correspondences.from_views((view,)))


@pytest.mark.parametrize("estimate", [central.estimate, dlt.estimate])
def test_a_left_handed_world_is_reported(estimate):
    view = scenes.scene(scenes.rig(), TURN).observations.views[0]
    found = estimate(Correspondences.from_views([(view.xyz * [1, 1, -1], view.uv)]))
    assert found.info["mirrored"] is True
    np.testing.assert_allclose(found.matrix, scenes.K, atol=1e-5)


def test_many_views_take_the_median():
    scene = scenes.scene(scenes.rig(), scenes.tilts(7), noise=0.1)
    views = list(scene.observations.views)
    random = np.random.default_rng(5)
    wild = views[2].uv + 15 * random.normal(size=views[2].uv.shape)
    views[2] = type(views[2])("wild", views[2].xyz, wild)
    found = dlt.estimate(Correspondences.from_views(tuple(views)))
    # noise of 0.1 px on 30 points moves one view's focal length by about 0.3 %
    np.testing.assert_allclose(found.matrix[[0, 1], [0, 1]], [1000, 1010], rtol=0.01)
    assert found.projection_matrix is None and len(found.poses) == 7


def test_boards_beside_a_rig_get_their_poses():
    rig = scenes.scene(scenes.rig(), TURN)
    boards = scenes.scene(scenes.board(), scenes.tilts(3))
    both = Correspondences.from_views(rig.observations.views + boards.observations.views)
    found = dlt.estimate(both)
    np.testing.assert_allclose(found.matrix, scenes.K, atol=1e-6)
    assert scenes.pose_error(found.poses[1:], boards.poses)[0] < 1e-8


def test_points_on_both_sides_of_the_camera():
    random = np.random.default_rng(0)
    cam = random.uniform(-1, 1, (20, 3))  # a third of the cube lies behind
    uv = (cam @ scenes.K.T)[:, :2] / cam[:, 2:]
    with pytest.raises(EstimationError, match="behind the camera"):
        dlt.estimate(Correspondences.from_views([(cam, uv)]))
