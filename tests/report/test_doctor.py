"""Findings: their order and gains, and that each case of bad data is named with what helps."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.figures import sigma_hat
from camcal.data.observations import Correspondences, SkippedView, View
from camcal.errors import DataError
from camcal.plan import selection
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import of_fit
from camcal.report.doctor import Finding, Gain, calibration, diagnosis, installation, pictures, remedies
from camcal.report.doctor.findings import ordered
from camcal.report.document import document
from camcal.solve.refine import How, refine
from tests.solved import SIZE, camera_of, grid, observe, solved, tilted_poses


def found_in(data, **options):
    solution = calibrate(data, crosscheck=False, **options)
    return calibration.examine(document(solution), solution, "r.yaml"), solution


def board_views(count=12, noise=0.2, xyz=None, seed=3, **pose):
    rng = np.random.default_rng(seed)
    pose = {"shift": 3.0, "distance": (9.0, 16.0)} | pose
    return observe(
        camera_of(), tilted_poses(grid(), count, rng, **pose), grid() if xyz is None else xyz, noise, rng
    )


# ------------------------------------------------------------------ findings
def test_what_is_wrong_stands_first_then_the_largest_gain():
    def gain(times):
        return Gain("px", times, 1.0, "")

    some = [
        Finding("a", "note", "", ""),
        Finding("b", "better", "", "", gain(2)),
        Finding("c", "better", "", ""),
        Finding("d", "better", "", "", Gain("px", np.inf, 1.0, "")),
        Finding("e", "wrong", "", ""),
        Finding("f", "better", "", "", gain(3)),
    ]
    assert [f.code for f in ordered(some)] == list("edfbca")
    assert not diagnosis("x", "s", some)["healthy"]
    assert diagnosis("x", "s", some[:4])["healthy"]


def test_a_gain_in_words():
    assert (
        Gain("sigma_hat, px", 0.1147, 0.0540, "predicted").words
        == "sigma_hat, px: from 0.115 to 0.054 (predicted)"
    )
    assert "at best 1 " in Gain("x", 2.75, 1.0, "y", True).words
    assert Gain("x", 1.0, 0.0, "").times == np.inf


# ------------------------------------------------------------------ calibrations
def test_a_good_calibration_is_called_good():
    found, solution = found_in(board_views(60, distance=(14.0, 20.0), shift=2.0))
    assert not [f for f in found if f.grade == "wrong"]
    assert not {f.code for f in found} & {"board-not-flat", "lens-model", "not-only-noise", "worse-pictures"}
    assert "Do not use" not in calibration.sentence(document(solution), found)


def test_few_views_of_the_middle_gain_by_pictures():
    found, solution = found_in(board_views(6, distance=(18.0, 22.0), shift=0.5))
    first = next(f for f in found if f.code == "next-pictures")
    assert first.gain.times > 3
    assert "camcal next r.yaml --count 3" in first.todo and "of the picture" in first.todo
    assert calibration.sentence(document(solution), found).count(first.message) == 1


def test_a_bent_board_is_found_with_what_its_shape_gains():
    bowl = grid() + np.c_[np.zeros((54, 2)), 0.004 * ((grid()[:, :2] - [4, 2.5]) ** 2).sum(1)]
    rng = np.random.default_rng(3)
    camera, poses = camera_of(), tilted_poses(grid(), 14, rng, shift=3.0)
    seen = observe(camera, poses, bowl, 0.05, rng)
    flat = seen.with_views(tuple(replace(v, xyz=grid()) for v in seen.views))
    found, solution = found_in(flat, model="opencv4")
    board = next(f for f in found if f.code == "board-not-flat")
    again = calibrate(flat, "opencv4", board_shape="free", crosscheck=False, holdout=0)
    assert board.gain.now == pytest.approx(sigma_hat(solution))
    assert board.gain.after == pytest.approx(sigma_hat(again), rel=0.05)  # one step for the whole way
    assert "--board-shape auto" in board.todo


def test_a_lens_that_the_model_does_not_follow(monkeypatch):
    few = functools.partial(selection.select, models=("pinhole", "opencv4"))
    monkeypatch.setattr(selection, "select", few)
    truth = {"fx": 400, "fy": 401, "cx": 322, "cy": 238, "k1": -0.3, "k2": 0.08}
    rng = np.random.default_rng(3)
    camera = camera_of("opencv4", {**truth, "p1": 0.0, "p2": 0.0})
    data = observe(camera, tilted_poses(grid(), 12, rng, shift=3.0), grid(), 0.05, rng)
    found, _ = found_in(data, model="pinhole")
    model = next(f for f in found if f.code == "lens-model")
    assert model.gain.times > 3 and "--model opencv4" in model.todo


def test_one_bad_picture_is_named_with_its_gain():
    data = board_views(10, noise=0.05)
    rng = np.random.default_rng(0)
    views = list(data.views)
    views[4] = replace(views[4], uv=views[4].uv + rng.normal(size=(54, 2)) * 0.5)
    found, _ = found_in(data.with_views(tuple(views)), robust="none")
    worse = next(f for f in found if f.code == "worse-pictures")
    assert "view4" in worse.message and worse.message.count("rms") == 1
    assert worse.gain.after == pytest.approx(0.05, rel=0.2)


def test_what_a_picture_looks_like_is_said():
    solution = solved(views=8)
    report = document(solution)
    report["views"][2]["quality"] = {"warnings": ["blurred: very"]}
    worse = remedies.worse_views(solution, report)
    assert worse.grade == "note" and "view2" in worse.message and "blurred: very" in worse.message


def test_lost_pictures_gain_by_their_number():
    lost = [{"id": f"{i}.jpg", "status": "not_found", "reason": "too dark"} for i in range(6)]
    found = next(remedies.lost_pictures(2, lost))
    assert found.gain.times == pytest.approx(2.0)  # 8 pictures in place of 2
    assert "6 of 8" in found.message and "0.jpg (too dark)" in found.message and "1 more" in found.message
    assert not list(remedies.lost_pictures(2, []))
    frames = [{"id": "f.avi#1", "status": "rejected", "reason": "it shows the target where f.avi#3 does"}]
    assert not list(remedies.lost_pictures(2, frames))
    assert next(remedies.lost_pictures(2, frames + lost)).message.startswith("6 of 8 pictures")
    assert next(remedies.lost_pictures(100, lost[:1])).grade == "note"


def test_a_warning_carries_the_gain_of_its_remedy_and_a_grave_one_comes_first():
    solution = solved(views=3, distance=(30.0, 34.0), shift=0.2)
    report = document(solution)
    report["warnings"] = [
        {"code": "few-views", "severity": "doubtful", "message": "few.", "hint": "h"},
        {"code": "fold-in-image", "severity": "wrong", "message": "folds.", "hint": "h"},
    ]
    found = calibration.examine(report, solution, "r.yaml")
    assert found[0].code == "fold-in-image" and found[0].grade == "wrong"
    by_code = {f.code: f for f in found}
    assert by_code["few-views"].gain == by_code["next-pictures"].gain
    assert calibration.sentence(report, found) == "Do not use this calibration as it is: folds."


def test_a_gate_that_fell_is_wrong():
    solution = replace(solved(), options={"max_rms": 1e-6})
    found = calibration.examine(document(solution), solution, "r.yaml")
    assert found[0].code == "gate" and "max-rms" in found[0].message


def test_every_code_of_pictures_exists():
    from pathlib import Path

    import camcal

    text = "".join(
        p.read_text() for p in Path(camcal.__file__).parent.rglob("*.py") if "doctor" not in p.parts
    )
    for code in calibration._PICTURES:
        assert f'"{code}"' in text, code


def test_a_camera_of_which_nothing_was_estimated():
    camera = camera_of()
    fix = dict.fromkeys(camera.lens.names)
    solution = of_fit(refine(camera, solved(views=5).poses, solved(views=5).observations, How(fix)))
    assert remedies.next_views(solution, "r.yaml") is None
    assert (
        calibration.examine(document(solution), solution, "r.yaml") == []
    )  # and no suggestion to estimate it


# ------------------------------------------------------------------ pictures
def test_pictures_by_what_they_look_like():
    views = tuple(View(f"{i}.jpg", grid(), grid()[:, :2]) for i in range(12))
    quality = {f"{i}.jpg": {"warnings": ["blurred: 3 px"] if i < 6 else []} for i in range(12)}
    quality["11.jpg"]["warnings"] = ["overexposed: 40%"]
    data = Correspondences.from_views(
        views, SIZE, picture_quality=quality, skipped=(SkippedView("x", "not_found", "dark"),)
    )
    found = {f.code: f for f in pictures.examine(data)}
    assert found["pictures-blurred"].grade == "better" and "6 of 12" in found["pictures-blurred"].message
    assert found["pictures-overexposed"].grade == "note"
    assert "few-pictures" not in found
    assert "dark" in next(pictures.lost(data)).message
    assert {f.code for f in pictures.examine(data.with_views(views[:3]))} >= {"few-pictures"}


def test_every_word_on_a_picture_has_a_remedy():
    from camcal.detect.quality import warnings

    bad = {"blur_px": 3.0, "square_px": 10.0, "blur_ratio": 3.0, "blur_direction_deg": 0.0, "saturated": 0.9,
           "contrast": 5.0, "residual": 4.0, "coverage": 0.001}  # fmt: skip
    kinds = {said.partition(":")[0] for said in warnings(bad)}
    assert kinds == set(pictures.REMEDIES)


def test_nothing_found_says_why_once():
    seen = [{"id": f"{i}.png", "status": "not_found", "reason": "no board"} for i in range(3)]
    (found,) = pictures.nothing_found(DataError("no board was found in 3 pictures.", "In 3: no board."), seen)
    assert found.grade == "wrong" and found.message == "no board was found in 3 pictures."
    assert "--board" in found.todo
    seen[1]["reason"] = "blurred"
    (found,) = pictures.nothing_found(DataError("none.", "Try: --board 8x6"), seen)
    assert "1.png (blurred)" in found.message and found.todo == "Try: --board 8x6"


# ------------------------------------------------------------------ installation
def test_this_installation_works():
    found = installation.diagnose()
    assert found["healthy"], found["findings"]
    names = {c["name"] for c in found["checks"]}
    assert names >= {
        "camcal",
        "python",
        "cv2",
        "calibration",
        "pictures",
        "processors",
        "cache",
        "matplotlib",
    }


def test_a_broken_part_is_a_finding(monkeypatch):
    monkeypatch.setattr(installation, "_has", lambda module, name: name != "aruco")
    monkeypatch.setattr(
        installation, "_required", lambda: iter([("numpy", "99.0"), ("absent-package", "1.0")])
    )
    found = installation.diagnose()
    assert not found["healthy"]
    said = {f["code"]: f for f in found["findings"]}
    assert "needed 99.0" in said["installation-numpy"]["message"]
    assert "missing" in said["installation-absent-package"]["message"]
    assert "aruco" in said["installation-cv2 parts"]["message"]


def test_a_check_that_breaks_is_a_finding(monkeypatch):
    def broken():
        raise ImportError("no such library")

    monkeypatch.setattr(installation, "_opencv", broken)
    found = installation.diagnose()
    assert any("no such library" in f["message"] for f in found["findings"]) and not found["healthy"]


def test_two_opencvs_are_named(monkeypatch):
    monkeypatch.setattr(installation, "_is_installed", lambda name: name in installation.OPENCV[:2])
    wrong = [f for f in installation.diagnose()["findings"] if f["grade"] == "wrong"]
    assert wrong and "overwrite each other" in wrong[0]["message"] and "uninstall" in wrong[0]["todo"]


def test_missing_extras_are_only_noted(monkeypatch):
    monkeypatch.setattr(installation, "_is_installed", lambda name: name in installation.OPENCV[-1:])
    found = installation.diagnose()
    assert found["healthy"]
    assert {f["code"] for f in found["findings"]} == {"installation-matplotlib", "installation-jinja2"}


def test_settings_from_outside_are_named(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CAMCAL_MODEL", "kb4")
    (tmp_path / "camcal.yaml").write_text("model: kb4\n")
    (found,) = installation._settings()
    assert "./camcal.yaml" in found.found and "CAMCAL_MODEL" in found.found
