"""Further numbers that decide what a report says, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.data.observations import View
from camcal.errors import DataError
from camcal.report import bias, board, embedded, stereo
from camcal.report.doctor import installation, remedies, rig
from camcal.report.doctor.findings import Finding, Gain
from camcal.report.html import pictures, scene
from tests.sides import LESS, MORE
from tests.solved import grid, solved


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


# ------------------------------------------------------------------------------------ remedies
def test_a_bias_that_is_a_finding():
    def found(ratio, p_value=0.0):
        report = {"bias": {"ratio": {"ratio": ratio, "p_value": p_value}}, "fit": {"sigma_hat": 1.0}}
        return remedies.bias(report) is not None

    limit = remedies.BIASED
    assert found(MORE * limit) and not found(LESS * limit)
    assert found(0.9, LESS * remedies.BY_CHANCE) and not found(0.9, MORE * remedies.BY_CHANCE)


def worse(good, monkeypatch, rms, count=8, gain=2.0):
    """Which pictures are said to be worse, and how gravely, where the first ones have so many times the rms."""
    own = [SimpleNamespace(rms_point=r) for r in [*rms, *np.ones(count - len(rms))]]
    monkeypatch.setattr(remedies.figures, "per_view", lambda _: own)
    monkeypatch.setattr(remedies, "_without", lambda *_: Gain("", gain, 1.0, ""))
    views = [SimpleNamespace(id=f"v{i}") for i in range(count)]
    solution = SimpleNamespace(observations=SimpleNamespace(views=views))
    found = remedies.worse_views(solution, {"views": [{"id": v.id} for v in views]})
    return None if found is None else found.grade


def test_pictures_that_are_worse(good, monkeypatch):
    limit, fewest = remedies.WORSE_VIEW, remedies.FEWEST_VIEWS
    assert worse(good, monkeypatch, [MORE * limit]) == "better"
    assert worse(good, monkeypatch, [LESS * limit]) is None
    assert worse(good, monkeypatch, [9.0], gain=MORE * remedies.WORTH) == "better"
    assert worse(good, monkeypatch, [9.0], gain=LESS * remedies.WORTH) == "note"
    assert worse(good, monkeypatch, [9.0], fewest + 1) == "better"
    assert worse(good, monkeypatch, [9.0], fewest) is None


def test_pictures_that_were_lost():
    """The gain is the root of the ratio of their numbers."""
    for share, severity in ((MORE, "better"), (LESS, "note")):
        used = round(1000 / (share * remedies.WORTH) ** 2)
        lost = [{"id": str(i), "reason": "blurred", "status": "rejected"} for i in range(1000 - used)]
        (found,) = remedies.lost_pictures(used, lost)
        assert found.grade == severity


def test_pictures_that_are_worth_taking(good, monkeypatch):
    answer = {"now": {"worst_px": 1.0, "median_px": 1.0}, "suggestions": [{"words": "left", "worst_px": 1.0}]}
    monkeypatch.setattr(remedies, "next_ones", lambda *_: (answer, None))
    for share, said in ((MORE, True), (LESS, False)):
        gain = Gain("", share * remedies.WORTH_PICTURES, 1.0, "")
        monkeypatch.setattr(remedies, "Gain", lambda *_, g=gain: g)
        assert (remedies.next_views(good, "") is not None) == said


def ranked(good, monkeypatch, now=2.0, left=9.0, views=8):
    """Whether another lens model is named: hold-out errors are `now` and 1, a board leaves `left` px of 1 px."""
    from camcal.plan import selection

    monkeypatch.setattr(remedies, "_calls_for_a_model", lambda _: True)
    monkeypatch.setattr(remedies, "_detector_sigma", lambda _: 1.0)
    monkeypatch.setattr(selection, "select", lambda _: None)
    models = [{"model": m, "holdout": {"rms_point": r}} for m, r in (("opencv5", now), ("opencv8", 1.0))]
    monkeypatch.setattr(selection, "described", lambda _: {"models": models, "chosen": "opencv8"})
    shaped = Finding("", "better", "", "", Gain("", 10.0, left, ""))
    solution = SimpleNamespace(
        observations=good.observations, poses=[None] * views, free=good.free, camera=good.camera
    )
    return remedies.lens_model(solution, {"camera": {"model": "opencv5"}}, shaped) is not None


def test_another_lens_model(good, monkeypatch):
    assert ranked(good, monkeypatch, MORE * remedies.WORTH)
    assert not ranked(good, monkeypatch, LESS * remedies.WORTH)
    assert ranked(good, monkeypatch, left=MORE * remedies.EXPLAINS)
    assert not ranked(good, monkeypatch, left=LESS * remedies.EXPLAINS)
    assert ranked(good, monkeypatch, views=remedies.FEWEST_VIEWS + 1)
    assert not ranked(good, monkeypatch, views=remedies.FEWEST_VIEWS)


def test_epipolar_lines_of_a_rig(monkeypatch):
    solution = SimpleNamespace(rig=SimpleNamespace(cameras=("a", "b")), poses=[None] * 8)
    monkeypatch.setattr(rig, "covariance", lambda _: None)
    monkeypatch.setattr(rig, "sigma_hat", lambda _: 0.2)
    for share, said in ((LESS, False), (MORE, True)):
        at = [{"epipolar_px": {"median": share * rig.LARGE * 0.2}}]
        monkeypatch.setattr(rig, "pair", lambda *_, a=at: {"at": a})
        assert bool(list(rig._pairs(solution))) == said


# ------------------------------------------------------------------------------------ stereo pairs
@pytest.mark.parametrize(
    ("matches", "median", "noise", "codes"),
    [
        (stereo.FEW, 0.0, 1.0, []),
        (stereo.FEW - 1, 0.0, 1.0, ["few-matches"]),
        (99, LESS * stereo.EXCESS, 1.0, []),
        (99, MORE * stereo.EXCESS, 1.0, ["vertical-disparity"]),
        (99, LESS * stereo.MATTERS, 0.0, []),
        (99, MORE * stereo.MATTERS, 0.0, ["vertical-disparity"]),
    ],
)
def test_vertical_disparities(matches, median, noise, codes):
    turn = {"rotation_vector_deg": [0, 0, 1.0], "sigma_deg": [0, 0, 0.1], "camera": "b", "median_after": 0.1}
    made = {
        "matches": matches, "vertical_disparity": {"median": median}, "noise": {"median": noise}, "turn": turn,
    }  # fmt: skip
    assert [w["code"] for w in stereo._warnings(made)] == codes


# ------------------------------------------------------------------------------------ boards, charts, pages
def test_points_of_a_known_board(monkeypatch):
    shape = {"ideal": grid(3, 3).tolist(), "points": grid(3, 3).tolist()}
    monkeypatch.setattr(board, "read_document", lambda _: {"target": {"shape": shape, "square": 2.0}})
    monkeypatch.setattr(board, "on_board", lambda data, *_: data)
    monkeypatch.setattr(board, "_known", lambda data, *_: data)
    for share, known in ((LESS, True), (MORE, False)):
        xyz = 2 * grid(3, 3) + [share * board._SAME * 2.0, 0, 0]
        data = SimpleNamespace(target={"square": 2.0}, views=[View("a", xyz, xyz[:, :2])])
        if known:
            assert board.on_known_board(data, "x") is data
        else:
            with pytest.raises(DataError, match="another board"):
                board.on_known_board(data, "x")


def test_thumbnails_that_are_shown():
    most, others = pictures.MOST_USED, pictures.MOST_OTHERS
    entries = [{"status": "used", "rms_point": float(i)} for i in range(most + 1)]
    shown = pictures._chosen([*entries, *[{"status": "rejected"}] * (others + 1)])
    assert [e["rms_point"] for e in shown[:most]] == list(range(most, 0, -1))
    assert [e["status"] for e in shown[most:]] == ["rejected"] * others


def test_calibrations_whose_residuals_are_tested(good, monkeypatch):
    class Tested(Exception):
        pass

    def design(_):
        raise Tested

    monkeypatch.setattr(bias, "Design", design)
    least = bias.LEAST_REDUNDANCY
    monkeypatch.setattr(bias, "redundancy", lambda _: least)
    with pytest.raises(Tested):
        bias.section(good, None)
    monkeypatch.setattr(bias, "redundancy", lambda _: least - 1)
    assert bias.section(good, None) is None


def test_rows_of_a_report_that_are_read():
    """No more than fit into memory, before anything is unpacked."""
    most = embedded.LARGEST // embedded.BYTES // len(embedded.COLUMNS)
    for rows, said in ((most, "damaged"), (most + 1, "at most")):
        with pytest.raises(DataError, match=said):
            embedded._table(SimpleNamespace(columns=list(embedded.COLUMNS), rows=rows, text=""))


def test_the_size_of_a_scene_in_its_drawing():
    """It fills its part of the drawing, and a flat one no more than may be turned within it."""
    width = np.array([[-1.0, -1e-3, 0], [1.0, 1e-3, 0]])
    for size, fills in ((MORE, True), (LESS, False)):
        # with the size 1 the sphere has the height of the drawing; a bar of 1 / LARGEST of it fills it by LARGEST
        half = size * scene.FILL / scene.LARGEST * scene.WIDTH / scene.HEIGHT
        made = [SimpleNamespace(points=half * width)]
        found = scene.filling(made, np.zeros(3), 1.0, 0.0, 0.0)
        assert (found < scene.LARGEST) == fills
    assert scene.filling([SimpleNamespace(points=width)], np.zeros(3), 1.0, 0.0, 0.0) == pytest.approx(
        scene.FILL * scene.WIDTH / scene.HEIGHT
    )


# ------------------------------------------------------------------------------------ the installation
@pytest.mark.parametrize(
    ("share", "agrees", "status"), [(LESS, True, "ok"), (MORE, True, "wrong"), (LESS, False, "wrong")]
)
def test_a_calibration_of_exact_points(monkeypatch, share, agrees, status):
    from camcal.plan import calibrate

    made = SimpleNamespace(
        residuals=[np.array([share * installation.EXACT_PX])],
        crosscheck=[{"status": "pass" if agrees else "fail"}],
    )
    monkeypatch.setattr(calibrate, "calibrate", lambda *_, **__: made)
    (found,) = installation._calibration()
    assert found.status == status


def test_codecs_that_lose_too_much(monkeypatch):
    import cv2

    gray = (np.add.outer(np.arange(32), np.arange(48)) * 3).astype(np.uint8)
    for off, lost in ((installation.LOSSY - 1, False), (installation.LOSSY, True)):
        monkeypatch.setattr(cv2, "imdecode", lambda *_, o=off: gray.astype(int) + o)
        (found,) = installation._pictures()
        assert ("; not png" in found.found) == lost
