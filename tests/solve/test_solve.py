"""From a start to a solution."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.observations import Correspondences
from camcal.errors import DataError, EstimationError, UsageError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.solve.refine import How, refine, residuals
from tests import solved
from tests.solve.problems import rig_views, views_of


def data_of(camera, **more):
    views, poses = views_of(camera, **more)
    return Correspondences.from_views(views, camera.image_size), poses


def start_of(camera):
    params = camera.lens.pinhole(540.0, 540.0, 318.0, 242.0)
    return Camera(camera.lens, params, camera.image_size)


def test_exact_data_give_the_truth():
    camera = solved.camera_of()
    data, poses = data_of(camera, noise=0.0, count=8)
    found = refine(start_of(camera), poses, data)
    assert found.fit.converged
    # rounding of the pixels, 1e-13, times the condition number and a margin
    np.testing.assert_allclose(found.camera.params, camera.params, rtol=1e-8, atol=1e-8)
    assert rotations.angle_between(found.poses.rotations, poses.rotations).max() < 1e-9
    assert found.rms_point < 1e-10


def test_the_solution_is_complete():
    camera = solved.camera_of()
    data, poses = data_of(camera, ragged=True)
    told = []
    found = refine(start_of(camera), poses, data, on_step=lambda i, c: told.append((i, c)))
    assert found.residuals.shape == data.uv.shape
    assert found.free.shape == (9, 9) and found.free_count == 9 + 6 * len(data)
    assert found.normal.poses.shape == (len(data), 6, 6)
    fit = found.fit
    assert fit.optimizer == "lm" and fit.evaluations >= fit.iterations >= 1
    assert fit.samples[0][1] > fit.samples[-1][1] == fit.cost
    assert [(s[0], s[1]) for s in fit.samples[1:]] == told
    assert fit.cost == pytest.approx(0.5 * sum((r**2).sum() for r in [found.residuals]), rel=1e-12)
    np.testing.assert_array_equal(found.start.params, start_of(camera).params)


def test_residuals_are_predicted_minus_observed():
    camera = solved.camera_of()
    data, poses = data_of(camera, noise=0.5)
    found = residuals(camera, poses, data)
    for r, view, pose in zip(data.split(found), data.views, poses, strict=True):
        np.testing.assert_allclose(r, camera.project(pose.apply(view.xyz)) - view.uv, atol=1e-10)
    assert residuals(camera, poses[:0], Correspondences.from_views(())).shape == (0, 2)


def test_fixed_parameters_stay_to_the_last_bit():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    found = refine(start_of(camera), poses, data, How({"cx": 320.25, "p1": None, "k3": 0.125}))
    values = found.camera.values
    assert (values["cx"], values["p1"], values["k3"]) == (320.25, 0.0, 0.125)
    assert found.free.shape == (9, 6)


def test_tied_parameters_keep_their_ratio():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    values = refine(start_of(camera), poses, data, How({"aspect": 1.002})).camera.values
    assert values["fy"] / values["fx"] == pytest.approx(1.002, rel=1e-14)


def test_points_left_out_do_not_count_but_get_residuals():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    views = list(data.views)
    uv = views[2].uv.copy()
    uv[:10] += 50.0
    views[2] = replace(views[2], uv=uv)
    spoilt = data.with_views(tuple(views))
    rows = np.arange(data.point_count)[data.slices[2]][:10]
    found = refine(start_of(camera), poses, spoilt.with_used(~np.isin(np.arange(data.point_count), rows)))
    assert found.rms_point < 0.5
    assert np.linalg.norm(found.residuals[rows], axis=1).min() > 40


def test_weights_replace_sigmas():
    camera = solved.camera_of()
    data, poses = data_of(camera, sigma=True)
    by_sigma = refine(start_of(camera), poses, data)
    by_weight = refine(start_of(camera), poses, replace(data, sigma=None, weight=data.sigma**-2.0))
    np.testing.assert_allclose(by_weight.camera.params, by_sigma.camera.params, rtol=1e-9, atol=1e-9)


def test_points_in_space():
    camera = solved.camera_of("opencv4", solved.TRUTH)
    views, poses = rig_views(camera)
    found = refine(start_of(camera), poses, Correspondences.from_views(views, solved.SIZE))
    assert found.fit.converged and found.rms_point < 0.2


def test_the_same_without_normalisation():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    usual = refine(start_of(camera), poses, data)
    raw = refine(start_of(camera), poses, data, How(normalise=False))
    assert raw.fit.cost == pytest.approx(usual.fit.cost, rel=1e-9)
    # the blocks are about the centroids again
    np.testing.assert_allclose(
        raw.normal.poses, usual.normal.poses, rtol=1e-2, atol=1e-2 * usual.normal.poses.max()
    )


@pytest.mark.parametrize("optimizer", ["lm:qr", "dogleg", "lbfgs:scaled"])
def test_other_optimizers_by_name(optimizer):
    camera = solved.camera_of()
    data, poses = data_of(camera)
    usual, other = (
        refine(start_of(camera), poses, data),
        refine(start_of(camera), poses, data, How(optimizer=optimizer)),
    )
    assert other.fit.optimizer == optimizer and other.fit.converged
    assert other.fit.cost == pytest.approx(usual.fit.cost, rel=1e-6)


@pytest.mark.parametrize("optimizer", ["lmm", "lm:fast", "lbfgs:m=3"])
def test_unknown_optimizers(optimizer):
    camera = solved.camera_of()
    data, poses = data_of(camera)
    with pytest.raises(UsageError, match="optimizer") as caught:
        refine(start_of(camera), poses, data, How(optimizer=optimizer))
    assert caught.value.hint


def test_a_bowed_board_is_found():
    camera = solved.camera_of()
    flat = solved.grid()
    unit = np.linspace(-1, 1, 9)[None, :].repeat(6, 0).ravel()
    bowed = flat + np.c_[np.zeros((54, 2)), 0.08 * (1 - unit**2)]
    views, poses = views_of(camera, count=12, noise=0.05, xyz=bowed)
    told = Correspondences.from_views(tuple(replace(v, xyz=flat) for v in views), solved.SIZE)
    as_flat = refine(start_of(camera), poses, told)
    found = refine(start_of(camera), poses, told, How(board="bowl"))
    assert found.rms_point < 0.08 < as_flat.rms_point
    points = found.board.points
    # as deep as it is, within the 0.05 px that 12 views see it with
    assert np.ptp(points[:, 2]) == pytest.approx(0.08, rel=0.1)
    assert found.free_count == 9 + 2 + 6 * 12


def test_too_few_observations():
    camera = solved.camera_of()
    data, poses = data_of(camera, count=1)
    few = data.with_views(tuple(v.take(slice(0, 6)) for v in data.views))
    with pytest.raises(EstimationError, match="12 coordinates for 15 unknowns"):
        refine(start_of(camera), poses, few)


def test_a_view_without_points():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    with pytest.raises(DataError, match="no points left"):
        refine(start_of(camera), poses, data.with_used(data.view > 0))


def test_a_start_that_does_not_project():
    camera = solved.camera_of()
    data, poses = data_of(camera)
    behind = replace(poses, translation=poses.translations * [1, 1, -1])
    with pytest.raises(EstimationError, match="does not project"):
        refine(start_of(camera), behind, data)
