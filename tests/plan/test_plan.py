"""The plan: what is tried, in which order, how often, and for which points the report says so."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camcal.data.points import read_points
from camcal.detect.camera_pass import WINDOWS
from camcal.detect.images import detect_images
from camcal.detect.saddle import INNER_HALF
from camcal.errors import DataError, EstimationError
from camcal.plan import minima, second_pass
from camcal.plan import run as road
from camcal.plan.better import Candidate
from camcal.plan.calibrate import calibrate
from camcal.plan.options import Options
from camcal.plan.progress import Attempt, Change, Progress, advance, follow
from camcal.plan.run import begun, plan
from camcal.solve.refine import refine
from camcal.start import zhang
from tests.shared_data import DATA, needs_data
from tests.solved import camera_of, grid, observe, solved, tilted_poses

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def data_of(views=10, noise=0.2, seed=3, outliers=0):
    rng = np.random.default_rng(seed)
    data = observe(camera_of(), tilted_poses(grid(), views, rng), grid(), noise, rng)
    if outliers:
        rows = rng.choice(data.point_count, outliers, replace=False)
        uv = data.uv.copy()
        uv[rows] += rng.uniform(10, 40, (outliers, 2))
        data = replace(data, uv=uv)
    return data


def names(solution):
    return [s.name for s in solution.stages]


# ---------------------------------------------------------------------------------------- what it costs
@pytest.fixture
def counted(monkeypatch):
    """How often the closed form and the refinement are run by a calibration."""
    count = Counter()

    def counting(name, real):
        def run(*args, **more):
            count[name] += 1
            return real(*args, **more)

        return run

    fit = counting("refine", refine)
    for module in ("camera", "minima", "outlying", "second_pass"):
        monkeypatch.setattr(f"camcal.plan.{module}.refine", fit)
    for module in ("camcal.solve.refine", "camcal.solve.robust", "camcal.solve.starts"):
        monkeypatch.setattr(f"{module}.refine", fit)
    monkeypatch.setattr("camcal.start.zhang.estimate", counting("zhang", zhang.estimate))
    return count


def test_the_sample_pictures_cost_one_closed_form_and_nine_fits(counted):
    # 9 closed forms and 22 refinements before the plan was one list; five are for the windows of the second pass, three
    # for weights: the sigmas as they are given, with a floor, and with the floor that these weights show
    found = detect_images([str(SAMPLES / "board")])
    calibrate(found, robust="auto", refine_points=None)
    assert counted["zhang"] == 1 and counted["refine"] <= 9


@needs_data
def test_a_board_that_is_not_flat_does_not_hide_what_new_points_gain(monkeypatch):
    """With the flat board, whose misfit is three times the noise of the corners, the gain is 1.5 to 1.8 standard errors
    and taken as not enough here.
    """
    plain = second_pass.better

    def in_doubt_on_a_flat_board(new, old):
        free = any(np.ptp(candidate.calibration.observations.xyz[:, 2]) > 0 for candidate in (new, old))
        return plain(new, old) if free else (False, "in doubt")

    monkeypatch.setattr(second_pass, "better", in_doubt_on_a_flat_board)
    found = detect_images([str(DATA / "opencv_left")])
    made = calibrate(found, model="opencv5", refine_points=None, checks=False, crosscheck=False)
    notes = next(s for s in made.stages if s.name == "second-pass").info
    assert notes["kept"] and "with the board's shape estimated" in notes["why"]


def test_clean_points_cost_one_closed_form_and_one_fit(counted):
    calibrate(data_of(), robust="auto")
    assert counted == {"zhang": 1, "refine": 1}


def test_every_stage_is_entered_once_and_in_order():
    """A trace of the observations through a calibration: no attempt runs twice, none calls back into the plan."""
    entered = []

    def spying(attempt):
        def make(progress):
            entered.append(attempt.name)
            depth = len(entered)
            change = attempt.make(progress)
            assert len(entered) == depth  # nothing entered the plan from inside
            return change

        return Attempt(attempt.name, attempt.applies, make)

    data = data_of(outliers=20)
    started = Progress(*_begun(data, robust="auto"))
    follow([spying(a) for a in plan()], started)
    assert entered == [
        "zhang", "least-squares", "agreeing", "zhang", "least-squares", "reweighted", "rejected", "better-poses",
        "rejected", "without-foreign-views",
    ]  # fmt: skip


def _begun(data, **options):
    p = begun(data, Options.resolve(model="opencv5", **options))
    return p.options, p.lens, p.how, p.given, p.data


# ---------------------------------------------------------------------------------------- what the report says
def test_clean_data_show_the_closed_form_and_the_result():
    assert names(calibrate(data_of())) == ["zhang", "refine"]


def test_the_stages_are_of_the_points_that_the_result_rests_on():
    found = calibrate(data_of(outliers=20), robust="auto", checks=False)
    assert (~found.used).sum() == 20
    at = {s.name: s for s in found.stages}
    plain = at["least-squares"]
    off = found.observations.uv[found.used] - _projected(plain, found)
    assert plain.rms_point == pytest.approx(float(np.sqrt(np.square(off).sum(1).mean())), rel=1e-9)
    # the closed form is made again on the points that were kept, not quoted from those that agreed
    again = zhang.estimate(found.observations.kept())
    np.testing.assert_array_equal(at["zhang"].matrix, again.matrix)


def _projected(stage, found):
    views = found.observations.views
    every = [stage.camera.project(p.apply(v.xyz)) for v, p in zip(views, stage.poses, strict=True)]
    return np.concatenate(every)[found.used]


def test_the_last_stage_names_the_attempt_that_gave_it():
    assert calibrate(data_of()).stages[-1].info["attempt"] == "least-squares"
    found = calibrate(data_of(outliers=20), robust="auto", checks=False)
    assert found.stages[-1].info["attempt"] == "rejected"


@needs_data
def test_a_robust_run_of_real_data_keeps_its_stages_together():
    """Five poles, one of them 14 to 17 px off: no stage fits its points twice as well as the result fits them."""
    cases = DATA / "cases"
    data = read_points(points3d=cases / "vaila_ref3d.csv", points2d=cases / "vaila_c02.csv")
    found = calibrate(data, model="opencv4", robust="auto", checks=False)
    assert found.stages[-1].rms_point == pytest.approx(found.rms_point) and 0.6 < found.rms_point < 0.8
    assert len(found.stages) > 2
    for stage in found.stages[:-1]:
        assert stage.rms_point >= 0.5 * found.rms_point, stage.name


@needs_data
def test_points_numbered_as_a_board_of_the_other_size_are_refused():
    with pytest.raises(
        DataError, match="a grid of 6x9, but their positions in the pictures are those of 9x6"
    ):
        calibrate(read_points(DATA / "cases" / "wrong-count-1.csv"), robust="auto", checks=False)


# ---------------------------------------------------------------------------------------- never worse
@pytest.mark.parametrize("seed", range(6))
def test_rejection_never_fits_the_kept_points_worse_than_plain_least_squares(seed):
    data = data_of(views=6, seed=seed, outliers=8)
    # one model: by itself the fit to all points takes another one, for the sake of the outliers
    robust = calibrate(data, model="opencv5", robust="auto", checks=False)
    plain = calibrate(data, model="opencv5", robust="none", checks=False)
    places = [plain.observations.view_ids.index(v) for v in robust.observations.view_ids]
    again = refine(plain.camera, plain.poses[np.array(places)], robust.observations)
    assert robust.fit.cost <= again.fit.cost * (1 + 1e-9)


def test_the_fit_from_all_points_is_taken_where_it_is_lower():
    # a fit that pretends to have rejected its way into a worse minimum
    data = data_of()
    good = calibrate(data, robust="none", checks=False)
    worse = replace(good, fit=replace(good.fit, cost=good.fit.cost * 2))
    asked = _begun(data, robust="auto")
    attempt = [a for a in plan() if a.name == "from-all-points"]
    started = Progress(*asked, best=Candidate(worse), plain=good, notes={"begun_from": "x"})
    assert advance(attempt, started).fit.fit.cost == pytest.approx(good.fit.cost, rel=1e-9)
    # ... and left where it is not
    started = Progress(*asked, best=Candidate(good), plain=worse, notes={"begun_from": "x"})
    assert advance(attempt, started).fit is good


# ---------------------------------------------------------------------------------------- the second pass
@pytest.mark.parametrize("gain", [+1, -1])
def test_the_second_pass_is_kept_where_views_held_out_gain(monkeypatch, gain):
    found = detect_images([str(SAMPLES / "board")])
    rng = np.random.default_rng(0)
    worse = replace(found, uv=found.uv + rng.normal(0, 0.05, found.uv.shape))
    first, second = (worse, found) if gain > 0 else (found, worse)
    monkeypatch.setattr(second_pass, "refine_images", lambda *_, windows: [second] * len(windows))
    solution = calibrate(first, refine_points=None, checks=False)
    assert solution.second_pass["kept"] == (gain > 0)
    kept = np.array_equal(solution.observations.uv, second.uv)
    assert kept == (gain > 0)
    # asked for, it is kept whatever it brings
    assert calibrate(first, refine_points=True, checks=False).second_pass["kept"]


def test_the_windows_of_the_second_pass_are_chosen_by_views_held_out(monkeypatch):
    found = detect_images([str(SAMPLES / "board")])
    rng = np.random.default_rng(0)

    def version(scale):
        return replace(found, uv=found.uv + rng.normal(0, 0.05, found.uv.shape) * scale)

    def chosen(scales):
        versions = {w: version(s) for w, s in zip(WINDOWS, scales, strict=True)}
        monkeypatch.setattr(second_pass, "refine_images", lambda *_, windows: [versions[w] for w in windows])
        return calibrate(found, refine_points=True, checks=False).second_pass["window"]

    assert chosen([2, 2, 2, 0, 2]) == WINDOWS[3]
    assert chosen([0, 2, 2, 2, 2]) == WINDOWS[0]
    assert chosen([1, 1, 1, 1, 1]) == INNER_HALF  # in doubt the usual one


def test_of_many_views_some_are_tried_in_all_windows_and_all_in_the_chosen_one(monkeypatch):
    found = detect_images([str(SAMPLES / "board")])
    read = []

    def refine_images(points, camera, poses, windows):
        read.append((len(poses), tuple(windows)))
        return [points] * len(windows)

    monkeypatch.setattr(second_pass, "refine_images", refine_images)
    count, few = len(found.views), len(found.views) // 2
    whole, part = [(count, WINDOWS)], [(few, WINDOWS), (count, (INNER_HALF,))]
    usual = second_pass.refine

    def refused(camera, poses, observations, how):  # as where some views alone do not determine the camera
        if len(poses) < count:
            raise EstimationError("no camera.", "Try again.")
        return usual(camera, poses, observations, how)

    for most, expected, fitting in ((few + 1, whole, usual), (few, part, usual), (few, whole, refused)):
        monkeypatch.setattr(second_pass, "TRIED_ON", most)
        monkeypatch.setattr(second_pass, "refine", fitting)
        read.clear()
        assert calibrate(found, refine_points=True, checks=False).second_pass is not None
        assert read[: len(expected)] == expected


# ---------------------------------------------------------------------------------------- the loop itself
def test_an_attempt_that_fails_leaves_the_rest_to_the_others():
    def fails(_):
        raise EstimationError("no camera.", "Try again.")

    data = data_of()
    started = Progress(*_begun(data))
    broken = [Attempt("broken", lambda _: True, fails), *minima.from_nothing()]
    assert follow(broken, started).fit.rms_point < 0.4
    with pytest.raises(EstimationError, match="no camera"):
        follow([Attempt("broken", lambda _: True, fails)], started)


def test_a_fit_is_compared_unless_it_is_taken_instead():
    good = solved(views=8)
    worse = replace(good, fit=replace(good.fit, cost=2 * good.fit.cost))
    started = Progress(*_begun(good.observations), best=Candidate(good))
    for kept in (False, True):
        change = Change(fit=Candidate(worse), instead=kept)
        after = advance([Attempt("x", lambda _: True, lambda _, c=change: c)], started)
        assert (after.fit is worse) == kept
        assert after.stages[-1].info["kept"] == kept
    refused = Change(fit=Candidate(worse), instead=True, refused="not significant")
    after = advance([Attempt("x", lambda _: True, lambda _: refused)], started)
    assert after.fit is good and after.stages[-1].info["why"] == "not significant"


def test_the_plan_is_data_with_a_name_and_a_condition_for_each_attempt():
    assert all(isinstance(a, Attempt) and a.name for a in road.plan())
    assert {"zhang", "dlt", "central", "radial", "least-squares", "bowl", "free", "second-pass"} <= {
        a.name for a in road.plan()
    }
