"""Sigmas: those of the whole normal matrix, true to the scatter, and infinite where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess import figures
from camcal.assess.covariance import covariance
from camcal.model.pose import Poses
from camcal.solve.losses import LOSSES
from camcal.solve.refine import How, refine
from camcal.solve.robust import reweight
from tests.solved import camera_of, dense_covariance, grid, observe, rig, solved, tilted_poses


def test_it_is_that_of_the_whole_matrix():
    s = solved(views=6)
    c, whole = covariance(s), dense_covariance(s)
    p = s.camera.lens.size
    # the condition of the scaled matrix is about 1e5, so 1e-16 leaves 1e-11; a digit or two to spare
    assert np.allclose(c.matrix, whole[:p, :p], rtol=1e-8, atol=0)
    assert c.sigmas["fx"] == pytest.approx(np.sqrt(whole[0, 0]), rel=1e-8)
    blocks = np.array([whole[p + 6 * i :, p + 6 * i :][:6, :6] for i in range(6)])
    assert np.allclose(c.poses(), blocks, rtol=1e-7, atol=1e-9 * np.abs(blocks).max())


def test_tied_and_fixed_parameters():
    s = solved(views=6, fix={"aspect": None, "k3": None})
    c = covariance(s)
    assert c.sigmas["fx"] == pytest.approx(c.sigmas["fy"]) and c.sigmas["k3"] == 0
    assert c.undetermined == ()
    assert ("fx", "fy") not in [(a, b) for a, b, _ in c.strong_correlations()]
    # within one polynomial the coefficients always hang together
    assert ("k1", "k2") in [(a, b) for a, b, _ in covariance(solved(views=6)).strong_correlations(0.9)]


def test_the_scatter_of_many_calibrations_is_what_it_says():
    found = [solved(views=6, noise=0.2, seed=1)]
    truth, poses, xyz = camera_of(), found[0].poses, grid()
    rng = np.random.default_rng(3)
    values = []
    for _ in range(80):
        s = refine(truth, poses, observe(truth, poses, xyz, 0.2, rng))
        values.append(s.camera.params)
    said = np.sqrt(np.diag(covariance(s).matrix))
    # the standard deviation of 80 values is itself uncertain by 8 %; nine parameters, so 3.5 of those
    assert np.all(np.abs(np.std(values, axis=0) / said - 1) < 0.28)


def test_the_scale_of_given_sigmas_is_estimated():
    sigma = np.linspace(0.1, 0.4, 54)
    s = solved(views=5, sigma=sigma)
    tenfold = [replace(v, sigma=10 * v.sigma) for v in s.observations.views]
    t = refine(s.start, s.poses, s.observations.with_views(tenfold))
    assert figures.sigma_0(s) == pytest.approx(1.0, abs=0.1)
    assert figures.sigma_0(t) == pytest.approx(figures.sigma_0(s) / 10, rel=1e-6)
    assert covariance(t).sigmas["fx"] == pytest.approx(covariance(s).sigmas["fx"], rel=1e-5)


def frontal(noise=0.0):
    """Two views exactly parallel to the image, by a camera without distortion."""
    truth = camera_of("pinhole")
    poses = Poses(np.stack([np.eye(3)] * 2), np.array([[-4.0, -2.5, 12.0], [-3.0, -3.0, 14.0]]))
    data = observe(truth, poses, grid(), noise, np.random.default_rng(0))
    return refine(truth, poses, data)


def test_what_the_data_leave_open_is_infinite_and_never_small():
    c = covariance(frontal())
    # focal length against distance, principal point against translation
    assert c.undetermined == ("fx", "fy", "cx", "cy")
    assert all(np.isinf(s) for s in c.sigmas.values())
    assert np.isinf(np.diagonal(c.poses(), axis1=1, axis2=2)[:, 3:]).all()
    assert c.strong_correlations() == []


def test_a_determined_parameter_beside_an_open_one_keeps_its_sigma():
    # with fy tied to fx and the principal point held, only the scale is open
    truth, base = camera_of("pinhole"), frontal()
    s = refine(truth, base.poses, base.observations, How({"fx": None, "fy": None}))
    # still open: principal point against translation in views parallel to the image
    assert covariance(s).undetermined == ("cx", "cy")
    assert covariance(s).sigmas["fx"] == 0


def test_a_rig_determines_everything_in_one_view():
    s = solved("pinhole", views=1, xyz=rig(), shift=0.3)
    c = covariance(s)
    assert c.undetermined == () and 0 < c.sigmas["fx"] < 20


def test_without_redundancy_nothing_is_known():
    s = solved("pinhole", views=1, xyz=rig(count=5), shift=0.3)
    assert figures.redundancy(s) == 0 and np.isnan(figures.sigma_0(s))
    assert all(np.isinf(v) for v in covariance(s).sigmas.values())


def test_units_do_not_matter():
    near = solved(views=5)
    data = replace(
        near.observations,
        xyz=near.observations.xyz * 1e4,
    )
    far = refine(near.camera, Poses(near.poses.rotations, near.poses.translations * 1e4), data)
    assert covariance(far).sigmas["fx"] == pytest.approx(covariance(near).sigmas["fx"], rel=1e-6)
    assert covariance(far).condition == pytest.approx(covariance(near).condition, rel=1e-4)


@pytest.mark.parametrize("loss", ["huber", "soft-l1", "cauchy", "tukey", "geman-mcclure"])
def test_a_robust_loss_costs_its_efficiency_and_no_more(loss):
    plain = solved(views=40, seed=4)
    robust = reweight(plain, How(), LOSSES[loss])
    ratio = covariance(robust).sigmas["fx"] / covariance(plain).sigmas["fx"]
    # 95 % efficiency is 1.026 in sigma; 2,160 points leave 2 % of scatter in the estimated scale
    assert ratio == pytest.approx(1.026, abs=0.04)


def test_poses_reach_their_scatter():
    truth = camera_of()
    rng = np.random.default_rng(8)
    poses = tilted_poses(grid(), 4, rng)
    held = dict.fromkeys(truth.lens.names)
    centres = []
    for _ in range(60):
        s = refine(truth, poses, observe(truth, poses, grid(), 0.2, rng), How(held))
        centres.append([p.apply(grid().mean(0)) for p in s.poses])
    said = np.sqrt(np.diagonal(covariance(s).poses(), axis1=1, axis2=2))[:, 3:]
    # 60 values: 9 % each, twelve figures
    assert np.all(np.abs(np.std(centres, axis=0) / said - 1) < 0.35)
