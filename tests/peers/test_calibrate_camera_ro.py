"""A free board against cv2.calibrateCameraRO: the same optimum, and what cv2 cannot take is said."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.data.observations import Correspondences
from camcal.peers import calibrate_camera_ro
from camcal.peers.run import crosscheck
from camcal.plan.calibrate import calibrate
from tests.solved import camera_of, grid, observe, tilted_poses

BOARD = grid(5, 4)  # cv2's time grows with the cube of the number of points


def uneven(views=7, noise=0.1, seed=3, sigma=None):
    """Views of a board whose points are off their places, said to be ideal."""
    rng = np.random.default_rng(seed)
    true = BOARD + rng.normal(0, 0.01, BOARD.shape)
    data = observe(camera_of("opencv4"), tilted_poses(BOARD, views, rng, shift=0.5), true, noise, rng, sigma)
    return data.with_views(tuple(replace(v, xyz=BOARD) for v in data.views))


def compared(data, **options):
    solution = calibrate(data, model="opencv4", board_shape="free", checks=False, **options)
    return calibrate_camera_ro.against_cv2(solution)


def without(data, view, *points):
    keep = np.setdiff1d(np.arange(len(data.views[view])), points)
    views = list(data.views)
    views[view] = views[view].take(keep)
    return Correspondences.from_views(tuple(views), data.image_size)


def passed(entry, began="by itself"):
    """The same optimum: the board, too. cv2 gives its points as float32, 5e-7 of five squares."""
    assert entry["status"] == "pass", entry["why"]
    assert abs(entry["difference"]["rms_point"]) < 1e-6 * entry["opencv"]["rms_point"]
    assert entry["difference"]["board_max"] < 1e-5
    assert began in entry["why"]
    return True


def test_the_same_camera_and_the_same_board():
    assert passed(compared(uneven()))


def test_it_stands_among_the_entries_of_a_report():
    solution = calibrate(uneven(), model="opencv4", board_shape="free", checks=False, crosscheck=True)
    entry = next(e for e in solution.crosscheck if e["against"] == "cv2.calibrateCameraRO")
    assert entry["stage"] == "refine" and passed(entry, "at camcal's optimum")


def test_beyond_some_unknowns_only_the_full_comparison_is_made(monkeypatch):
    solution = calibrate(uneven(), model="opencv4", board_shape="free", checks=False)
    views, points = len(solution.poses), len(solution.board.points)
    for most, status in ((3 * points + 6 * views, "pass"), (3 * points + 6 * views - 1, "not_applicable")):
        monkeypatch.setattr(calibrate_camera_ro, "QUICK_UNKNOWNS", most)
        made = calibrate_camera_ro.against_cv2(solution, full=False)
        assert made["status"] == status
    assert "--crosscheck full" in made["why"]


def test_held_parameters_are_held_by_cv2_too():
    data = uneven()
    solution = calibrate(data, model="opencv4", board_shape="free", fix={"p1": 0.0, "p2": 0.0}, checks=False)
    entry = calibrate_camera_ro.against_cv2(solution)
    assert passed(entry)
    assert entry["opencv"]["distortion"][2:4] == [0.0, 0.0]


def test_points_that_a_view_lacks_are_left_out_of_all():
    entry = compared(without(uneven(), 2, 7))
    assert passed(entry)
    assert "19 points that 7 views share" in entry["why"]


def test_a_view_that_lacks_many_is_left_out():
    entry = compared(without(uneven(), 2, *range(8)))
    assert passed(entry)
    assert "20 points that 6 views share" in entry["why"]


def test_weights_are_taken_out():
    sigma = np.where(np.arange(len(BOARD)) % 2, 0.1, 0.3)
    entry = compared(uneven(sigma=sigma))
    assert passed(entry)
    assert "unit weights" in entry["why"]


def test_too_many_unknowns_are_said(monkeypatch):
    monkeypatch.setattr(calibrate_camera_ro, "MOST_UNKNOWNS", 50)
    entry = compared(uneven())
    assert entry["status"] == "not_applicable"
    assert "102 unknowns" in entry["why"]


def test_views_that_share_too_little_are_said():
    data = uneven()
    for view in range(7):
        data = without(data, view, 2 * view, 2 * view + 1, 14 + view % 6)
    assert compared(data)["status"] == "not_applicable"


def test_other_boards_have_no_entry():
    for kind in ("flat", "bowl"):
        solution = calibrate(uneven(), model="opencv4", board_shape=kind, checks=False)
        assert calibrate_camera_ro.against_cv2(solution) is None
        assert not any("RO" in e["against"] for e in crosscheck(solution))


def test_it_fails_where_cv2_reaches_a_lower_cost():
    solution = calibrate(uneven(), model="opencv4", board_shape="free", checks=False)
    worse = solution.residuals + 0.01 * np.sign(solution.residuals)
    entry = calibrate_camera_ro.against_cv2(replace(solution, residuals=worse))
    assert entry["status"] == "fail"
    assert "lower rms" in entry["why"]


@pytest.mark.parametrize("shift", [np.zeros(3), np.array([300.0, -200.0, 50.0])])
def test_the_place_of_the_boards_frame_does_not_matter(shift):
    data = uneven()
    moved = data.with_views(tuple(replace(v, xyz=v.xyz + shift) for v in data.views))
    assert passed(compared(moved))
