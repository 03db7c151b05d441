"""Hold-out of a solution as it was made, and the folds' cameras against what noise explains."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks import check
from camcal.assess.fold_difference import covered_pixels, difference_of_folds, seen_by_fold
from camcal.assess.holdout import k_fold
from camcal.assess.judgement import hold_out, refitter
from camcal.errors import UsageError
from camcal.plan.pipeline import calibrate
from camcal.solve.losses import LOSSES
from camcal.solve.robust import reweight
from camcal.solve.solve import refine
from tests.solved import camera_of, grid, observe, solved, tilted_poses


def shaped(bend=0.0, kind="flat", seed=2, views=12):
    rng, truth = np.random.default_rng(seed), camera_of()
    poses = tilted_poses(grid(), views, rng)
    x = grid()[:, 0] / 4 - 1
    data = observe(truth, poses, grid() + np.c_[0 * x, 0 * x, bend * (1 - x**2)], 0.1, rng)
    ideal = replace(data, views=tuple(replace(v, xyz=grid()) for v in data.views))
    return refine(truth, poses, ideal, board_shape=kind)


def test_noise_alone_gives_a_ratio_of_one():
    ratios = [hold_out(solved(views=12, seed=s), {})["difference"]["ratio"] for s in range(12)]
    # over hundreds of runs: median .95, 99 % below 1.5
    assert 0.7 < np.median(ratios) < 1.25 and max(ratios) < 1.9


def test_a_bent_board_shows_and_is_mended_by_its_shape():
    flat, bowl = shaped(0.08), shaped(0.08, "bowl")
    before, after = hold_out(flat, {}), hold_out(bowl, {})
    assert before["difference"]["ratio"] > 2 > after["difference"]["ratio"]
    assert after["rms_point"] < 0.6 * before["rms_point"]
    warned = replace(flat, holdout=before)
    assert "views-disagree" in {w.code for w in check(warned)}
    assert "views-disagree" not in {w.code for w in check(replace(bowl, holdout=after))}


def test_what_is_said():
    found = hold_out(solved(views=9), {}, 3)
    assert (found["views"], found["folds"], found["points"]) == (9, 3, 9 * 54)
    assert found["p95"] > found["rms_point"] > 0
    d = found["difference"]
    assert d["max_px"] > d["median_px"] > 0 and d["predicted_px"] > 0


def test_held_parameters_stay_held():
    s = solved(views=8, fix={"k3": None, "aspect": None})
    data, refit = refitter(s, {"k3": None, "aspect": None})
    again = refit(data, s.poses, s.inliers)
    assert again.camera.values["k3"] == s.camera.values["k3"]
    assert again.camera.params == pytest.approx(s.camera.params, rel=1e-6)


def test_robust_weights_stay():
    s = reweight(solved(views=8), refine, LOSSES["huber"])
    data, refit = refitter(s, {})
    assert refit(data, s.poses, s.inliers).camera.params == pytest.approx(s.camera.params, rel=1e-5)


@pytest.mark.parametrize(("views", "folds"), [(3, 2), (6, 7), (6, 1)])
def test_folds_that_cannot_be(views, folds):
    with pytest.raises(UsageError, match="folds"):
        hold_out(solved("pinhole", views=views), {}, folds)


def test_nothing_where_it_is_not_asked_for_or_cannot_be():
    assert hold_out(solved(views=8), {}, 0) is None
    assert hold_out(solved("pinhole", views=3), {}) is None
    assert hold_out(solved(views=8, fix=dict.fromkeys(camera_of().lens.names)), {}) is None


def test_the_pipeline_holds_out_by_itself():
    data = solved(views=8).correspondences
    assert calibrate(data, model="opencv5").holdout["folds"] == 4
    assert calibrate(data, model="opencv5", holdout=0).holdout is None
    assert calibrate(data, model="opencv5", holdout=8).holdout["folds"] == 8


def test_covered_pixels_lie_among_the_points():
    s = solved(views=6)
    pixels = covered_pixels(s)
    uv = np.concatenate([v.uv for v in s.correspondences.views])
    assert len(pixels) > 30
    assert (pixels >= uv.min(0)).all() and (pixels <= uv.max(0)).all()


def test_the_same_camera_sees_the_same():
    s = solved(views=6)
    pixels = covered_pixels(s)
    assert np.allclose(seen_by_fold(s, s, np.arange(6), pixels), pixels, atol=1e-8)


def test_the_map_of_the_folds_is_what_the_figures_are_made_of():
    s = solved(views=12)
    data, refit = refitter(s, {})
    held = k_fold(data, s.poses, s.inliers, refit)
    found = difference_of_folds(s, held)
    grid = found["map"]
    seen, said = np.array(grid["found_px"]), np.array(grid["predicted_px"])
    assert seen.shape == said.shape == (len(grid["v"]), len(grid["u"]))
    inside = np.isfinite(seen)
    assert inside.sum() == len(covered_pixels(s)) and not inside.all()
    # one pixel of the map by hand: the folds' cameras at that place
    j, i = np.argwhere(inside)[7]
    pixel = np.array([[grid["u"][i], grid["v"][j]]])
    moves = [seen_by_fold(s, f, v, pixel) - pixel for f, v in zip(held.fits, held.trained, strict=True)]
    assert seen[j, i] == pytest.approx(np.sqrt(np.mean([(m**2).sum() for m in moves])))
    # noise alone: map and prediction agree within the ratio of all of them
    assert np.sqrt(np.nanmean(seen**2 / said**2)) == pytest.approx(found["ratio"], rel=0.3)
