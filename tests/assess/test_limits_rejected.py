"""Limits of what is said of rejected views, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import outliers
from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from tests.sides import LESS, MORE
from tests.solved import grid, solved

SIZE = (640, 480)


@pytest.fixture(scope="module")
def good():
    return solved(views=8)


CAMERA = Camera(make("pinhole"), np.array([800.0, 800, 320, 240]), SIZE)


def seen_as(monkeypatch, ratio=1.0, angle=90.0, median=1.0):
    """The code of a rejected view whose plane has these proportions."""
    made = outliers.Proportions(ratio, angle, median, median)
    monkeypatch.setattr(outliers, "proportions", lambda *_, **__: made)
    view = View("v", grid(), 20 * grid()[:, :2] + 100)
    return outliers._kind(view, CAMERA, None, 1.0)[0]


def test_the_proportions_of_a_rejected_view(monkeypatch):
    same, angle = outliers.SAME_PROPORTION, outliers.SAME_ANGLE
    assert seen_as(monkeypatch, 1 + LESS * same) == "rejected-view"
    assert seen_as(monkeypatch, 1 + MORE * same) == "other-board"
    assert seen_as(monkeypatch, 1.0, outliers.RIGHT_ANGLE + LESS * angle) == "rejected-view"
    assert seen_as(monkeypatch, 1.0, outliers.RIGHT_ANGLE - MORE * angle) == "other-board"
    assert seen_as(monkeypatch, 1.5, median=LESS * outliers.EXPLAINED) == "other-board"
    assert seen_as(monkeypatch, 1.5, median=MORE * outliers.EXPLAINED) == "rejected-view"


def test_points_that_are_not_those_of_the_board(monkeypatch):
    """All are off by a part of the spacing, at the best pose."""
    monkeypatch.setattr(outliers, "proportions", lambda *_, **__: None)
    xyz = grid()
    pose = outliers.Pose(np.eye(3), np.array([0.0, 0.0, 40.0]))
    uv = CAMERA.project(pose.apply(xyz))
    spacing = outliers.exchanged_points.spacing(uv)
    for share, code in ((0.98, "rejected-view"), (1.02, "other-board")):
        seen = (
            uv
            + np.array([0.0, share * outliers.FAR_OFF * spacing])
            * np.where(np.arange(len(xyz)) % 2, 1, -1)[:, None]
        )
        far = outliers.exchanged_points.spacing(seen)
        seen = uv + (seen - uv) * far / spacing
        taken = SimpleNamespace(swapped=(), shifted=())
        monkeypatch.setattr(outliers.exchanged_points, "in_view", lambda *_, t=taken: t)
        monkeypatch.setattr(outliers.exchanged_points, "spacing", lambda _, f=far: f)
        assert outliers._kind(View("v", xyz, seen), CAMERA, pose, 1.0)[0] == code
        monkeypatch.undo()
        monkeypatch.setattr(outliers, "proportions", lambda *_, **__: None)


def test_a_used_view_of_another_board(good, monkeypatch):
    monkeypatch.setattr(outliers.mirror, "mirrored_views", lambda _: np.zeros(0, int))
    for share, bad in ((LESS, set()), (MORE, {3})):
        suspect = SimpleNamespace(index=3, ratio=1 - share * outliers.OTHER_PROPORTION)
        monkeypatch.setattr(outliers, "_suspects", lambda _, s=suspect: [s])
        assert outliers.foreign_views(good) == bad


def test_a_plane_that_is_nearly_that_of_x_and_y():
    """Then proportions are along x and y, otherwise along the axes of the points."""
    xyz = np.c_[grid(6, 4)[:, :2] * (1.0, 2.0), np.zeros(24)]
    turned = rotations.exp(np.array([0, 0, 0.7]))  # the points' own axes are turned in the plane
    for share, along in ((1.0003, True), (0.9997, False)):
        tilt = rotations.exp(np.array([np.arccos(min(share * outliers.ALONG_Z, 1.0)), 0, 0]))
        points = xyz @ turned.T @ tilt.T
        pose = outliers.Pose(rotations.exp(np.array([0.3, 0.2, 0.0])), np.array([0.0, 0.0, 40.0]))
        # the plane that was seen is 1.1 times as long in the y of the frame
        uv = CAMERA.project(pose.apply(points * (1.0, 1.1, 1.0)))
        found = outliers.proportions(View("v", points, uv), CAMERA, every=True)
        assert (abs(found.ratio - 1.1) < 1e-3) == along
