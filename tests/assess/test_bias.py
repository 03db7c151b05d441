"""Tests of the residuals: silent on noise, and each speaks of what it asks for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import bias
from camcal.assess.bias import ResidualTest, bias_ratio, cut, holm, residual_tests, standardise
from camcal.assess.design import Design
from camcal.data.observations import Correspondences
from camcal.solve.refine import How, refine
from tests.solved import TRUTH, camera_of, grid, observe, solved, tilted_poses

NAMES = ["radius", "angle", "board-position", "view", "noise-by-radius", "neighbours", "gaussian"]


def calibrated(disturb=None, views=12, noise=0.2, seed=0, model="opencv5", fix=None, truth=None, xyz=None):
    """A calibration of a flat grid whose observations are `disturb`ed: (view index, view, rng) -> uv."""
    rng = np.random.default_rng(seed)
    camera = camera_of("opencv5", truth or TRUTH)
    poses = tilted_poses(grid(), views, rng)
    data = observe(camera, poses, grid() if xyz is None else xyz, noise, rng)
    changed = [replace(v, xyz=grid()) for v in data.views]
    if disturb is not None:
        changed = [replace(v, uv=disturb(i, v, rng)) for i, v in enumerate(changed)]
    start = camera_of(model, truth or TRUTH)
    return refine(start, poses, Correspondences.from_views(tuple(changed), camera.image_size), How(fix or {}))


def asked(solution):
    return {t.name: t for t in residual_tests(standardise(Design(solution)))}


@pytest.fixture(scope="module")
def clean():
    return [calibrated(seed=s, views=8) for s in range(40)]


def test_p_values_of_noise_are_even(clean):
    found = [asked(s) for s in clean]
    assert list(found[0]) == NAMES
    for name in NAMES:
        p = np.array([f[name].p_value for f in found])
        # 40 even values have a mean of .5 +- .046; radius and angle lie higher, as the fit takes from them
        assert 0.32 < p.mean() < 0.85, name
    # all seven together: one run in twenty says something at 5 %
    assert sum(min(t.p_corrected for t in f.values()) < 0.05 for f in found) <= 6


def test_standardised_residuals_have_unit_variance(clean):
    z = np.concatenate([standardise(Design(s)).z for s in clean])
    # 34,560 numbers: 0.8 %
    assert np.mean(z**2) == pytest.approx(1, abs=0.025)
    pairs = np.concatenate([standardise(Design(s)).neighbours for s in clean])
    assert abs(pairs.mean() / 2) < 0.03


def test_the_bias_ratio_of_noise_is_nothing(clean):
    found = [bias_ratio(Design(s)) for s in clean]
    # a ratio scatters by .05; forty of them by .008
    assert abs(np.mean([f.ratio for f in found])) < 0.03
    assert np.mean([f.detector_sigma for f in found]) == pytest.approx(0.2, rel=0.02)
    assert 0.35 < np.mean([f.p_value for f in found]) < 0.65


def test_a_missing_radial_term():
    found = asked(calibrated(model="pinhole", truth=TRUTH | {"k1": -0.03, "k2": 0.0, "k3": 0.0}))
    assert found["radius"].p_corrected < 1e-6 and found["radius"].effect > 0.1


def test_a_board_that_is_not_what_it_is_taken_for():
    bent = grid() + np.c_[0 * grid()[:, :2], 0.02 * np.random.default_rng(5).normal(size=54)]
    bent[:, :2] += 0.01 * np.random.default_rng(6).normal(size=(54, 2))
    solution = calibrated(xyz=bent)
    found = asked(solution)
    assert found["board-position"].p_corrected < 1e-10
    assert found["board-position"].effect > max(found["radius"].effect, found["angle"].effect)
    # errors of single points look like noise to the bias ratio: its pieces are larger than a point
    assert bias_ratio(Design(solution)).ratio < 0.1


def test_a_bowed_board():
    x = grid()[:, 0] / 4 - 1
    solution = calibrated(xyz=grid() + np.c_[0 * x, 0 * x, 0.15 * (1 - x**2)])
    ratio = bias_ratio(Design(solution))
    assert ratio.p_value < 1e-10 and ratio.ratio > 0.2
    # the bow bends the pieces, too; rigid pieces leave .36
    assert ratio.detector_sigma == pytest.approx(0.2, rel=0.12)
    assert Design(solution).sigma_0 > 0.3


def test_a_noisy_view():
    found = asked(calibrated(lambda i, v, rng: v.uv + (i == 3) * rng.normal(0, 0.6, v.uv.shape)))
    assert found["view"].p_corrected < 1e-6
    assert found["view"].effect > 0.1


def test_noise_that_grows_to_the_border():
    def disturb(i, view, rng):
        r = np.linalg.norm(view.uv - [320, 240], axis=1)[:, None]
        return view.uv + rng.normal(size=view.uv.shape) * 0.6 * (r / 250) ** 2

    assert asked(calibrated(disturb))["noise-by-radius"].p_corrected < 1e-6


def test_noise_that_neighbours_share():
    def disturb(i, view, rng):
        gap = np.linalg.norm(view.xyz[:, None] - view.xyz[None], axis=2)
        root = np.linalg.cholesky(np.exp(-gap / 1.5) + 1e-9 * np.eye(len(gap)))
        return view.uv + 0.3 * root @ rng.normal(size=view.uv.shape)

    solution = calibrated(disturb)
    found = asked(solution)
    assert found["neighbours"].p_corrected < 1e-10 and found["neighbours"].effect > 0.2
    assert bias_ratio(Design(solution)).ratio > 0.2


def test_fat_tails():
    found = asked(calibrated(lambda i, v, rng: v.uv + 0.1 * rng.standard_t(2.5, v.uv.shape)))
    assert found["gaussian"].p_corrected < 1e-6 and found["gaussian"].effect > 1


def test_given_sigmas_are_what_is_standardised_by():
    sigma = np.where(np.arange(54) % 2, 0.1, 0.6)
    found = asked(solved(views=10, sigma=sigma))
    assert found["gaussian"].p_corrected > 0.01 and found["view"].p_corrected > 0.01


def test_holm():
    made = [ResidualTest(str(p), "", 0.0, p, 0.0) for p in (0.04, 0.01, 0.03, 0.9)]
    # .01 x 4, .03 x 3, then never less than the one before
    assert [t.p_corrected for t in holm(made)] == pytest.approx([0.09, 0.04, 0.09, 0.9])


def test_pieces_are_neighbours_and_every_point_is_in_one():
    pieces = list(cut(grid()))
    assert sorted(np.concatenate(pieces).tolist()) == list(range(54))
    assert all(6 <= len(p) < 12 for p in pieces)
    assert all(np.ptp(grid()[p], axis=0).max() <= 4 for p in pieces)


def test_too_few_points_say_nothing():
    s = solved("pinhole", views=3)
    few = replace(s, observations=s.observations.with_used(s.observations.point < 5))
    assert bias_ratio(Design(few)) is None


def test_neighbours_of_many_points_are_those_next_in_the_list(monkeypatch):
    monkeypatch.setattr(bias, "ALL_DISTANCES", 4)
    line = np.c_[[0.0, 2, 1, 3, 4], np.zeros((5, 2))]
    assert np.transpose(bias._pairs(line[:4])).tolist() == [[0, 2], [1, 2], [1, 3]]
    assert np.transpose(bias._pairs(line)).tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]


def test_residual_tests_need_a_number_of_values():
    rng = np.random.default_rng(0)
    for spare, tested in ((0, True), (-1, False)):
        values = rng.normal(size=bias.LEAST_VALUES + spare)
        assert np.isfinite(bias._gaussian(SimpleNamespace(z=values)).statistic) == tested
        products = rng.normal(size=bias.LEAST_PAIRS + spare)
        assert np.isfinite(bias._correlation(SimpleNamespace(neighbours=products)).statistic) == tested
