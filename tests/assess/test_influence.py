"""Leaving out views by block formulae is leaving out views."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.covariance import covariance
from camcal.assess.design import Design
from camcal.assess.influence import bootstrap, influence, jackknife
from camcal.solve.refine import refine
from tests.solved import camera_of, grid, observe, solved, tilted_poses


def without(solution, index):
    """The parameters after a new solution without a view."""
    keep = np.array([i for i in range(len(solution.poses)) if i != index])
    views = tuple(solution.observations.views[i] for i in keep)
    data = solution.observations.with_views(views)
    return refine(solution.camera, solution.poses[keep], data).camera.params


@pytest.mark.parametrize("model", ["pinhole", "opencv4"])
def test_leaving_out_a_view(model):
    s = solved(model, views=8, truth={"fx": 533, "fy": 534, "cx": 322, "cy": 238, "k1": -0.1})
    found = influence(Design(s))
    sigmas = np.array([covariance(s).sigmas[n] for n in s.camera.lens.names])
    for view in (0, 5):
        exact = without(s, view) - s.camera.params
        # first order: a few hundredths of a sigma, where the move itself is several tenths
        assert np.allclose(found.moves[view] / sigmas, exact / sigmas, atol=0.06)


def test_shares_add_up_and_a_large_board_holds_more():
    s = solved(views=8)
    design = Design(s)
    share = influence(design).share
    assert share.sum() == pytest.approx(1)
    assert (share > 0).all()


def test_p_values_of_noise_are_even_and_a_shifted_view_is_seen():
    rng, truth = np.random.default_rng(0), camera_of("opencv4")
    p = []
    for _ in range(12):
        poses = tilted_poses(grid(), 8, rng)
        p += influence(
            Design(refine(truth, poses, observe(truth, poses, grid(), 0.2, rng)))
        ).p_values.tolist()
    assert np.mean(p) == pytest.approx(0.5, abs=0.12)
    data = observe(truth, poses, grid(), 0.2, rng)
    squeezed = replace(data.views[2], uv=data.views[2].uv * [1.0, 1.01])
    odd = data.with_views((*data.views[:2], squeezed, *data.views[3:]))
    found = influence(Design(refine(truth, poses, odd)))
    assert found.p_values[2] < 1e-8
    assert found.p_values.argmin() == 2


def test_jackknife_and_bootstrap_agree_with_the_covariance_on_white_noise():
    ratios = []
    for seed in range(10):
        s = solved("opencv4", views=24, seed=seed)
        design = Design(s)
        sigmas = np.sqrt(np.diag(covariance(s).free))
        ratios.append(np.sqrt(np.diag(jackknife(influence(design)))) / sigmas)
        ratios.append(np.sqrt(np.diag(bootstrap(design, seed=seed))) / sigmas)
    # 24 views: a sigma by the jackknife is uncertain by 15 %; the ten runs' median by 6 %
    assert np.all(np.abs(np.median(ratios, axis=0) - 1) < 0.25)


def test_the_bootstrap_repeats_with_its_seed():
    design = Design(solved(views=8))
    assert np.array_equal(bootstrap(design, 50, 3), bootstrap(design, 50, 3))
    assert not np.array_equal(bootstrap(design, 50, 3), bootstrap(design, 50, 4))


def test_a_view_that_cannot_be_spared():
    s = solved("pinhole", views=1, fix={"cx": None, "cy": None})
    found = influence(Design(s))
    assert np.isnan(found.moves).all() and np.isnan(found.p_values).all()


def test_the_hat_matrix_is_a_projection():
    s = solved(views=5)
    design = Design(s)
    trace = sum(np.einsum("nii->", design.hat(rows)) for rows in design.rows())
    # its trace is the number of parameters: nine of the camera and six of each pose
    assert trace == pytest.approx(9 + 6 * 5, rel=1e-6)
