"""Limits of the comparisons with cv2, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.peers import (
    base,
    calibrate_camera_ro,
    calibrate_multiview,
    closed_form,
    find_homography,
    stereo_calibrate,
)
from camcal.peers.base import NotComparableError
from tests.sides import LESS, MORE
from tests.solved import solved


def test_a_value_at_its_bound():
    assert base.judge(1.0, 1.0, "x") == ("pass", None)
    for value in (MORE, np.nan):
        status, why = base.judge(value, 1.0, "x")
        assert status == "fail" and "at most 1 was expected" in why


def common(views, points, shared):
    """Views that show so many points of a board, some of which all of them show."""
    rng = np.random.default_rng(0)
    xyz = np.c_[rng.uniform(-1, 1, (points, 2)), np.zeros(points)]
    made, half = [], (points - shared) // 2
    for i in range(views):  # no other point is in all views
        own = np.r_[np.arange(shared), shared + i % 2 * half + np.arange(half)]
        made.append(View(f"v{i}", xyz[own], rng.uniform(0, 100, (len(own), 2)), None, own))
    return Observations.from_views(made, (640, 480))


def test_the_points_that_all_views_share():
    least = base.LEAST_POINTS
    # with the shared points alone half of the observations are left where (points - shared) / 2 = shared
    assert len(calibrate_camera_ro.complete(common(3, 3 * least, least)).views) == 3
    for points, shared in ((3 * least + 2, least), (3 * (least - 1), least - 1)):
        with pytest.raises(NotComparableError, match="all points in every view"):
            calibrate_camera_ro.complete(common(3, points, shared))


def test_unknowns_that_cv2_solves_for():
    def data(unknowns):  # 3 a point, 6 a view
        points, views = 20, (unknowns - 60) // 6
        assert 3 * points + 6 * views == unknowns
        return SimpleNamespace(views=[range(points)] * views)

    quick, most = calibrate_camera_ro.QUICK_UNKNOWNS, calibrate_camera_ro.MOST_UNKNOWNS
    quick, most = quick - quick % 6, most - most % 6
    calibrate_camera_ro._check_size(data(quick), False)
    calibrate_camera_ro._check_size(data(most), True)
    with pytest.raises(NotComparableError, match="--crosscheck full"):
        calibrate_camera_ro._check_size(data(quick + 6), False)
    with pytest.raises(NotComparableError, match="cv2 would take minutes"):
        calibrate_camera_ro._check_size(data(most + 6), True)


@pytest.mark.parametrize(
    ("cameras", "points", "said"),
    [
        (calibrate_multiview.MOST_CAMERAS, calibrate_multiview.MOST_POINTS, "cv2 takes no weights"),
        (calibrate_multiview.MOST_CAMERAS + 1, calibrate_multiview.MOST_POINTS, "cameras or"),
        (calibrate_multiview.MOST_CAMERAS, calibrate_multiview.MOST_POINTS + 1, "cameras or"),
    ],
)
def test_the_largest_rig(monkeypatch, cameras, points, said):
    monkeypatch.setattr(
        calibrate_multiview.cv2, calibrate_multiview.AGAINST.partition(".")[2], None, raising=False
    )
    data = SimpleNamespace(point_count=points, precision=np.ones(points))
    fit = SimpleNamespace(observations=SimpleNamespace(kept=lambda: data), cameras=[None] * cameras)
    with pytest.raises(NotComparableError, match=said):
        calibrate_multiview._run(fit)


def test_pairs_that_are_compared(monkeypatch):
    made = []
    monkeypatch.setattr(stereo_calibrate, "_entry", lambda *given: made.append(given[2:4]))
    monkeypatch.setattr(stereo_calibrate.calibrate_multiview, "crosscheck", lambda _: "all")
    for cameras, pairs, left in (("abcd", 6, None), ("abcde", stereo_calibrate.MOST_PAIRS, "4 of 10 pairs")):
        made.clear()
        solution = SimpleNamespace(rig=SimpleNamespace(cameras=cameras), board=None)
        entries = stereo_calibrate.crosscheck(solution, None, None)
        assert len(made) == pairs
        assert (len(entries) == pairs + 1) if left is None else left in entries[-1]["why"]


@pytest.mark.parametrize(("apart", "failed"), [(LESS, False), (MORE, True)])
@pytest.mark.parametrize("rms", [0.5, 0.0])
def test_a_homography_that_is_better(monkeypatch, apart, failed, rms):
    """Residuals of both in one direction, so that the transfers are `apart` of what is allowed from each other."""
    ours = np.tile([rms, 0.0], (9, 1))
    ours[0, 0] += 1e-9  # the better one is cv2's
    allowed = max(find_homography.PART * rms, find_homography.FLOOR_PX)
    theirs = ours.copy()
    theirs[0, 0] -= apart * allowed if rms else 0.0
    if not rms:
        ours, theirs = theirs + [apart * allowed, 0.0], np.zeros((9, 2))
        allowed = max(find_homography.PART * apart * allowed, find_homography.FLOOR_PX)
    view = View("v", np.zeros((9, 3)), np.zeros((9, 2)))
    monkeypatch.setattr(find_homography, "_transfers", lambda _: [(view, ours, theirs)])
    assert (find_homography.against_cv2([view], "zhang")["status"] == "fail") == failed


def test_a_view_that_is_a_plane():
    xy = np.random.default_rng(0).uniform(-1, 1, (12, 2))
    extent = np.linalg.svd(xy - xy.mean(0), compute_uv=False)[0]
    uv = 100 * xy + 300
    for share, flat in ((0.5, True), (20.0, False)):
        z = np.where(np.arange(12) % 2, 1.0, -1.0) * share * find_homography.FLAT * extent / np.sqrt(12)
        view = View("v", np.c_[xy, z], uv)
        assert (len(list(find_homography._transfers([view]))) == 1) == flat


@pytest.mark.parametrize(("times", "status"), [(LESS, "fail"), (MORE, "not_applicable")])
def test_a_pinhole_that_does_not_describe_the_lens(monkeypatch, times, status):
    solution = solved(views=3)
    stage = SimpleNamespace(name="zhang", matrix=solution.camera.matrix, poses=solution.poses)
    pinhole = closed_form.refine
    rms = times * closed_form.OTHER_MINIMA * solution.rms_point

    def refine(*given):
        found = pinhole(*given)
        return replace(found, residuals=found.residuals * (rms / found.rms_point))

    def compare(*_):
        return {"status": "fail", "why": "w", "difference": None}

    monkeypatch.setattr(closed_form, "refine", refine)
    monkeypatch.setattr(closed_form.refinement, "compare", compare)
    assert closed_form.against_cv2(stage, solution)["status"] == status
