"""The cross-check passes where both are right, fails where cv2 is better, and says what it cannot compare."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from camcal.assess.covariance import covariance
from camcal.data.observations import Correspondences, View
from camcal.errors import EstimationError
from camcal.geometry import projective, rotations
from camcal.least_squares import STILL
from camcal.model.pose import Poses
from camcal.peers import calibrate_camera, find_homography, project_points, refinement, rodrigues
from camcal.peers.base import LOWER_CHI2, ROUNDED, SIGMAS, NotComparableError
from camcal.peers.run import crosscheck
from camcal.plan.calibrate import calibrate
from camcal.solve.refine import refine, residuals
from camcal.system.processes import one_opencv_thread
from tests.solved import TRUTH, camera_of, grid, observe, rig, solved, tilted_poses

WIDE = {"fx": 400.0, "fy": 402.0, "cx": 322.0, "cy": 238.0, "p1": 4e-4, "p2": -3e-4}
WIDE |= {"k1": 0.5, "k2": 0.1, "k3": 0.01, "k4": 0.9, "k5": 0.3, "k6": 0.02}
KEYS = {"stage", "against", "status", "why", "opencv", "difference"}


def entry_of(entries, stage, against, status=None):
    return next(
        e for e in entries if (e["stage"], e["against"]) == (stage, against) and status in (None, e["status"])
    )


def data_of(model="opencv5", views=8, xyz=None, noise=0.2, seed=5, skew=None, sigma=None):
    rng = np.random.default_rng(seed)
    xyz = grid() if xyz is None else xyz
    values = TRUTH if skew is None else TRUTH | {"skew": skew}
    camera = camera_of(model, values, skew is not None)
    return observe(camera, tilted_poses(xyz, views, rng, shift=0.5), xyz, noise, rng, sigma)


# ---- the refinement
@pytest.mark.parametrize(
    ("model", "fix"),
    [
        ("pinhole", {}),
        ("opencv4", {}),
        ("opencv4", {"p1": 0.0, "p2": 0.0}),
        ("opencv5", {"aspect": None}),
        ("opencv5", {"k1": -0.25, "k2": 0.08}),
        ("opencv5", {"cx": 322.0, "cy": 238.0}),
        ("opencv5", {"fx": 533.0, "fy": 534.0}),
        ("opencv8", {}),
        ("opencv12", {}),
        ("opencv14", {"tauX": 0.0, "tauY": 0.0, "s1": 0.0, "s2": 0.0, "s3": 0.0, "s4": 0.0}),
    ],
)
def test_the_same_free_parameters_reach_the_same_camera(model, fix):
    # a rational model needs a lens that is one, or its coefficients have no single optimum
    wide = {"truth": WIDE, "distance": (5.0, 9.0), "shift": 1.5, "seed": 0}
    solution = solved(
        model, views=8, fix=fix, **(wide if model in ("opencv8", "opencv12", "opencv14") else {})
    )
    (made,) = refinement.against_cv2(solution)
    assert set(made) == KEYS
    assert made["status"] == "pass", made["why"]
    assert made["difference"]["sigmas"] < 0.05
    assert made["opencv"]["rms_point"] == pytest.approx(solution.rms_point, rel=1e-6)


def test_precise_points_may_differ_by_the_rounding_of_cv2():
    """At a noise of .002 px, rounding to float32 (6e-5 px at 640 px) moves the optimum of cv2 visibly."""
    precise, usual = solved("opencv5", views=40, noise=0.0008), solved("opencv5", views=8)
    (made,) = refinement.against_cv2(precise)
    assert made["status"] == "pass", made["why"]
    moved = 2.0**-14 / np.sqrt(12) / 0.0008 * 3  # a unit in the last place of 512 to 1023 px; 9 parameters
    assert refinement.same_sigmas(precise, True) == pytest.approx(np.hypot(SIGMAS, ROUNDED * moved), rel=0.1)
    assert made["difference"]["sigmas"] < refinement.same_sigmas(precise, True)
    assert refinement.same_sigmas(precise, False) == SIGMAS
    assert refinement.same_sigmas(usual, True) == pytest.approx(SIGMAS, rel=1e-3)


def test_a_rig_needs_a_guess_and_gets_camcals_start():
    data = data_of("opencv4", 1, rig())
    solution = calibrate(data, model="opencv4", robust="none")
    made = entry_of(crosscheck(solution, solution.stages), "refine", "cv2.calibrateCamera")
    assert made["status"] == "pass" and "camcal's start" in made["why"]
    assert made["difference"]["projection_max_px"] < 1e-3


def test_a_frame_far_from_the_origin():
    solution = solved(views=6)
    shift = np.array([5e4, -3e4, 0.0])
    views = tuple(replace(v, xyz=v.xyz + shift) for v in solution.observations.views)
    poses = Poses(
        solution.poses.rotations,
        solution.poses.translations - np.einsum("vij,j->vi", solution.poses.rotations, shift),
    )
    far = refine(solution.start, poses, solution.observations.with_views(views))
    (made,) = refinement.against_cv2(far)
    assert made["status"] == "pass" and made["difference"]["sigmas"] < 0.05


def test_it_fails_where_cv2_reaches_a_lower_cost():
    good = solved(views=6)
    worse = good.camera.params.copy()
    worse[0] += 0.05
    camera = replace(good.camera, params=worse)
    off = residuals(camera, good.poses, good.observations)
    (made,) = refinement.against_cv2(replace(good, camera=camera, residuals=off))
    assert made["status"] == "fail" and "lower rms" in made["why"]


def test_it_fails_where_the_projection_differs_at_the_same_cost():
    # residuals that claim the optimum for a camera that is not there
    good = solved(views=6)
    other = good.camera.params.copy()
    other[:2] *= 1.01
    (made,) = refinement.against_cv2(replace(good, camera=replace(good.camera, params=other)))
    assert made["status"] == "fail" and "projections differ" in made["why"]


def test_it_fails_where_only_the_second_chance_finds_the_lower_cost(monkeypatch):
    good = solved(views=6)
    real = calibrate_camera.run

    def lost_without_help(task, guess):
        result = real(task, guess)
        return result if guess is not None else replace(result, rms_point=2 * result.rms_point)

    monkeypatch.setattr(calibrate_camera, "run", lost_without_help)
    (made,) = refinement.against_cv2(good)
    assert made["status"] == "pass" and "camcal's optimum" in made["why"]
    claimed = replace(good, residuals=good.residuals * 1.001)
    (made,) = refinement.against_cv2(claimed)
    assert made["status"] == "fail" and "lower rms" in made["why"]


@pytest.mark.parametrize(("part", "status"), [(0.9, "pass"), (1.1, "fail")])
def test_a_fit_that_ended_in_a_valley_may_be_higher_by_what_no_interval_shows(part, status):
    good = solved(views=6)
    share = (
        part * LOWER_CHI2 / (4 * good.used.sum())
    )  # chi² of two coordinates a point, of the rms twice that
    claimed = replace(good, residuals=good.residuals * (1 + share))
    valley = replace(claimed, fit=replace(good.fit, stop_reason=STILL))
    assert refinement.against_cv2(valley)[0]["status"] == status
    assert refinement.against_cv2(claimed)[0]["status"] == "fail"


def test_a_lower_cost_of_a_camera_that_folds_before_the_points_is_no_failure(monkeypatch):
    good = solved(views=6)
    real = calibrate_camera.run

    def folding(task, guess):
        result = real(task, guess)
        values = result.camera.values | {"k1": -3.0, "k2": 0.0, "k3": 0.0}
        bent = replace(result.camera, params=good.camera.lens.from_values(values))
        return replace(result, camera=bent, rms_point=0.5 * result.rms_point)

    monkeypatch.setattr(calibrate_camera, "run", folding)
    (made,) = refinement.against_cv2(good)
    assert made["status"] == "not_applicable" and "folds back" in made["why"]


def test_skew_is_not_applicable_and_the_rest_is_compared():
    solution = calibrate(data_of("opencv4", skew=1.5), model="opencv4", skew=True, robust="none")
    entries = crosscheck(solution, solution.stages)
    assert "skew" in entry_of(entries, "refine", "cv2.calibrateCamera", "not_applicable")["why"]
    nearest = entry_of(entries, "refine", "cv2.calibrateCamera", "pass")
    assert "without skew in both" in nearest["why"]


def test_skew_held_at_zero_is_like_cv2():
    solution = calibrate(data_of("opencv4"), model="opencv4", skew=True, fix={"skew": 0.0}, robust="none")
    assert [e["status"] for e in refinement.against_cv2(solution)] == ["pass"]


def test_weights_are_taken_out():
    sigma = np.linspace(0.1, 0.5, 54)
    solution = calibrate(data_of(sigma=sigma), model="opencv5", robust="none")
    entries = refinement.against_cv2(solution)
    assert [e["status"] for e in entries] == ["not_applicable", "pass"]
    assert "weights" in entries[0]["why"] and "unit weights" in entries[1]["why"]


def test_equal_weights_change_nothing():
    solution = calibrate(data_of(sigma=np.full(54, 0.3)), model="opencv5", robust="none")
    assert [e["status"] for e in refinement.against_cv2(solution)] == ["pass"]


def test_rejected_points_are_left_out_for_cv2_too():
    good = solved(views=6)
    used = good.used.copy()
    used[good.observations.slices[2]][::5] = False
    fewer = refine(good.start, good.poses, good.observations.with_used(used))
    (made,) = refinement.against_cv2(fewer)
    assert made["status"] == "pass" and made["difference"]["sigmas"] < 0.05


def test_a_robust_loss_is_compared_without_it():
    solution = calibrate(data_of(), model="opencv5", robust="huber")
    entries = refinement.against_cv2(solution)
    assert [e["status"] for e in entries] == ["not_applicable", "pass"] and "huber" in entries[0]["why"]


def test_a_rest_that_cannot_be_fitted_is_said(monkeypatch):
    solution = calibrate(data_of("opencv4", skew=1.5), model="opencv4", skew=True, robust="none")

    def refine(*_):
        raise EstimationError("no camera.")

    monkeypatch.setattr(refinement, "refine", refine)
    entries = refinement.against_cv2(solution)
    assert [e["status"] for e in entries] == ["not_applicable"] * 2 and "no camera." in entries[1]["why"]


@pytest.mark.parametrize("fix", [{"p1": 0.0}, {"cx": 320.0}, {"fx": 533.0}])
def test_what_cv2_cannot_hold_alone(fix):
    (made,) = refinement.against_cv2(solved(views=6, fix=fix))
    assert made["status"] == "not_applicable" and "cannot" in made["why"]


def test_cv2s_refusal_is_no_failure():
    # cv2 wants the principal point of a guess inside the image
    solution = solved("pinhole", views=1, xyz=rig(), shift=0.3)
    outside = replace(solution, start=replace(solution.start, params=solution.start.params * [1, 1, -1, 1]))
    (made,) = refinement.against_cv2(outside)
    assert made["status"] == "not_applicable" and "rejects" in made["why"]


def test_exact_data_are_no_trouble():
    # the rms is rounding alone, and cv2's, who sees float32, is larger
    (made,) = refinement.against_cv2(solved(views=6, noise=0.0))
    assert made["status"] == "pass", made["why"]


def test_few_points_and_views():
    for entries in (
        crosscheck(solved("pinhole", views=2, xyz=grid(2, 2) * 4, noise=0.05)),
        crosscheck(solved("pinhole", views=1, xyz=rig(count=6), shift=0.3)),
    ):
        assert all(e["status"] in ("pass", "not_applicable") for e in entries), entries


# ---- cv2's own figures
def test_its_rms_is_recomputed_from_what_it_returned(monkeypatch):
    # as 4.14.0 does when its iterations run out: a printed rms that belongs to other parameters
    solution = solved(views=5)
    real = cv2.calibrateCamera
    monkeypatch.setattr(cv2, "calibrateCamera", lambda *a, **k: (99.0, *real(*a, **k)[1:]))
    result = calibrate_camera.run(calibrate_camera.task_of(solution), None)
    assert result.rms_point == pytest.approx(solution.rms_point, rel=1e-6)


@pytest.mark.parametrize("shape", [(-1, 1), (1, -1)])
def test_both_layouts_of_its_answers_are_read(monkeypatch, shape):
    solution = solved(views=4)
    real = cv2.calibrateCamera

    def other(*args, **more):
        rms, k, bend, rvecs, tvecs = real(*args, **more)
        return rms, k, bend.reshape(shape), tuple(r.reshape(3, 1) for r in rvecs), np.array(tvecs)

    monkeypatch.setattr(cv2, "calibrateCamera", other)
    result = calibrate_camera.run(calibrate_camera.task_of(solution), None)
    assert result.rms_point == pytest.approx(solution.rms_point, rel=1e-6)


def test_nan_is_no_answer(monkeypatch):
    solution = solved(views=4)
    real = cv2.calibrateCamera

    def broken(*args, **more):
        rms, k, *rest = real(*args, **more)
        return (rms, k * np.nan, *rest)

    monkeypatch.setattr(cv2, "calibrateCamera", broken)
    with pytest.raises(NotComparableError, match="NaN"):
        calibrate_camera.run(calibrate_camera.task_of(solution), None)


def test_it_is_repeatable_and_the_threads_are_given_back():
    before = cv2.getNumThreads()
    solution = solved(views=6)
    a, b = crosscheck(solution), crosscheck(solution)
    assert a == b and cv2.getNumThreads() == before
    with pytest.raises(ZeroDivisionError, match="division by zero"), one_opencv_thread():
        assert cv2.getNumThreads() == 1
        1 / 0  # noqa: B018
    assert cv2.getNumThreads() == before


# ---- the stages before
def test_every_stage_has_its_entries():
    solution = calibrate(data_of(), model="opencv5", robust="none")
    entries = crosscheck(solution, solution.stages)
    assert all(set(e) == KEYS for e in entries)
    assert all(e["status"] == "pass" for e in entries), entries
    assert {(e["stage"], e["against"]) for e in entries} == {
        ("zhang", "cv2.calibrateCamera"),
        ("zhang", "cv2.findHomography"),
        ("refine", "cv2.calibrateCamera"),
        ("refine", "cv2.projectPoints"),
        ("refine", "cv2.Rodrigues"),
    }
    zhang = entry_of(entries, "zhang", "cv2.calibrateCamera")
    assert zhang["difference"]["closed_form_rms_point"] > 0


def test_a_matrix_of_one_view_is_compared_by_its_projection():
    solution = calibrate(data_of("pinhole", 1, rig()), model="pinhole", skew=True, robust="none")
    entries = crosscheck(solution, solution.stages)
    for stage in ("central", "dlt"):
        assert entry_of(entries, stage, "cv2.projectPoints")["status"] == "pass"


def test_a_wrong_matrix_is_seen():
    xyz = rig()
    k = camera_of("pinhole").matrix
    matrix = projective.compose(k, rotations.exp(np.array([0.1, 0.2, 0.3])), np.array([0.0, 0.0, 15.0]))
    view = View("a", xyz, projective.project(matrix, xyz))
    assert project_points.of_matrix("dlt", matrix, view)["status"] == "pass"
    left_handed = View("a", xyz * [1, 1, -1], view.uv)
    mirrored = matrix @ np.diag([1, 1, -1, 1])
    assert project_points.of_matrix("dlt", mirrored, left_handed)["status"] == "not_applicable"


def test_a_wrong_projection_is_seen(monkeypatch):
    solution = solved(views=3)
    assert project_points.of_solution(solution)["status"] == "pass"
    lens = type(solution.camera.lens)
    real = lens.project
    monkeypatch.setattr(lens, "project", lambda self, p, x: (real(self, p, x)[0] + 1e-6, real(self, p, x)[1]))
    assert project_points.of_solution(solution)["status"] == "fail"


def test_a_wrong_rotation_is_seen(monkeypatch):
    poses = solved(views=3).poses
    assert rodrigues.against_cv2(poses, "refine")["status"] == "pass"
    real = rotations.log
    monkeypatch.setattr(rotations, "log", lambda r: real(r) * (1 + 1e-6))
    assert rodrigues.against_cv2(poses, "refine")["status"] == "fail"


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-4, 3.0, np.pi - 1e-6, np.pi])
def test_rotations_of_any_size(angle):
    axes = np.random.default_rng(0).normal(size=(20, 3))
    turned = rotations.exp(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    assert rodrigues.against_cv2(Poses(turned, np.zeros((20, 3))), "refine")["status"] == "pass"


def test_a_wrong_homography_is_seen(monkeypatch):
    views = data_of("pinhole", 3).views
    assert find_homography.against_cv2(views, "zhang")["status"] == "pass"
    real = find_homography.homography.solve
    monkeypatch.setattr(
        find_homography.homography, "solve", lambda x, u, **_: (real(x, u)[0] @ np.diag([1, 1.001, 1]),)
    )
    made = find_homography.against_cv2(views, "zhang")
    assert made["status"] == "fail" and "better" in made["why"]


def test_rigs_have_no_homography():
    assert find_homography.against_cv2(data_of("pinhole", 2, rig()).views, "zhang") is None


def test_a_camera_without_image_size():
    data = data_of()
    solution = calibrate(Correspondences.from_views(data.views), model="opencv5", robust="none")
    assert all(e["status"] == "pass" for e in crosscheck(solution, solution.stages))


def test_the_lens_table_of_the_calibrators_is_real():
    from camcal.peers import CALIBRATORS
    from camcal.registry import load

    assert all(callable(load(path)) for path in CALIBRATORS.values())


# ---- from the result
def test_cv2_stays_at_an_optimum():
    solution = calibrate(data_of(), model="opencv5", robust="none")
    entries = crosscheck(solution, solution.stages, full=False)
    assert all(e["status"] == "pass" for e in entries), entries
    assert {(e["stage"], e["against"]) for e in entries} == {
        ("zhang", "cv2.findHomography"),
        ("refine", "cv2.calibrateCamera"),
        ("refine", "cv2.projectPoints"),
        ("refine", "cv2.Rodrigues"),
    }
    refined = entry_of(entries, "refine", "cv2.calibrateCamera")
    assert "at camcal's optimum" in refined["why"] and refined["difference"]["sigmas"] < SIGMAS


@pytest.mark.parametrize("model", ["opencv5", "kb4"])
@pytest.mark.parametrize("sigmas", [0.1, 3.0])
def test_it_does_not_stay_where_there_is_no_optimum(model, sigmas):
    """A tenth of a standard deviation away is not the optimum: cv2 leaves, begins by itself, and is better."""
    solution = calibrate(data_of(model), model=model, robust="none", checks=False)
    params = solution.camera.params.copy()
    params[0] += sigmas * covariance(solution).sigmas["fx"]
    moved = replace(solution, camera=replace(solution.camera, params=params))
    moved = replace(moved, residuals=residuals(moved.camera, moved.poses, moved.observations))
    entry = refinement.against_cv2(moved, full=False)[0]
    assert entry["status"] == "fail" and "lower rms" in entry["why"] and "by itself" in entry["why"]


@pytest.mark.parametrize("model", ["eucm", "mei"])
def test_what_only_the_full_comparison_makes_is_said(model):
    solution = calibrate(data_of("kb4"), model=model, robust="none", checks=False)
    entry = refinement.against_cv2(solution, full=False)[0]
    assert entry["status"] == "not_applicable" and "--crosscheck full" in entry["why"]


@pytest.mark.parametrize("part, same", [(0.9, True), (1.1, False)])
def test_what_rounding_the_points_explains_is_the_same_optimum(part, same):
    solution = calibrate(data_of(noise=0.003), model="opencv5", checks=False)
    rounding = np.spacing(np.float32(solution.observations.uv.max()))
    more = refinement.SAME * solution.rms_point + refinement.LOWER_PX
    more += part * (np.hypot(solution.rms_point, rounding) - solution.rms_point)
    for rms, expected in ((solution.rms_point + more, same), (solution.rms_point - more, False)):
        result = calibrate_camera.Result(solution.camera, solution.poses, rms, np.zeros(5), "somewhere")
        assert refinement._same(result, solution) == expected
