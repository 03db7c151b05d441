import cv2
import numpy as np
import pytest

from camcal.detect.images import detect_images
from camcal.detect.refine_images import refine_images
from camcal.model.pose import Pose
from camcal.study.cameras import example_camera
from tests.detect import drawing

SIZE, SHAPE = (6, 5), (240, 200)


@pytest.fixture
def pictures(tmp_path):
    maps = []
    for i in range(2):
        h = drawing.homography(SIZE, (120, 100), square=24, turn=0.3 * i, tilt=0.6, about=0.5 + i)
        cv2.imwrite(str(tmp_path / f"{i}.png"), drawing.picture(h, SIZE, SHAPE, noise=2.0, seed=i))
        maps.append(h)
    return tmp_path, maps


def camera_and_poses(maps, square=1.0):
    """The camera of `drawing.homography` and its poses by picture, lengths in units of `square`."""
    focal = 24 * 3.0 * max(SIZE)
    values = {"fx": focal, "fy": focal, "cx": 120.0, "cy": 100.0}
    k = np.array([[focal, 0, 120], [0, focal, 100], [0, 0, 1]])
    poses = {}
    for i, h in enumerate(maps):
        a = np.linalg.inv(k) @ h
        rotation = np.c_[a[:, :2], np.cross(a[:, 0], a[:, 1])]
        poses[f"{i}.png"] = Pose(rotation, square * a[:, 2])
    return example_camera("pinhole", SHAPE, values), poses


def test_corners_move_little_and_stop(pictures):
    folder, maps = pictures
    found = detect_images([folder], square="20mm", cache=False)
    events = []
    new, moved = refine_images(found, *camera_and_poses(maps, 20.0), on_event=lambda *e: events.append(e))
    again, still = refine_images(new, *camera_and_poses(maps, 20.0))
    assert 0 < moved < 0.05
    assert still < 2e-3  # where a fit stops
    for view, h in zip(again.views, maps, strict=True):
        error = np.linalg.norm(view.uv - drawing.corners(SIZE, h)[view.point_ids], axis=1)
        assert np.median(error / view.sigma) < 2.0  # 1.2 for a Gaussian, 30 corners
    assert [name for name, _ in events] == ["refined", "refined"]


def test_views_without_a_pose_stay(pictures):
    folder, maps = pictures
    found = detect_images([folder], cache=False)
    new, moved = refine_images(found, camera_and_poses(maps)[0], {})
    assert moved == 0 and all((a.uv == b.uv).all() for a, b in zip(found.views, new.views, strict=True))


def test_changed_and_lost_pictures_are_said(pictures):
    folder, maps = pictures
    found = detect_images([folder], cache=False)
    (folder / "0.png").unlink()
    (folder / "1.png").write_bytes(b"another")
    events = []
    new, moved = refine_images(found, *camera_and_poses(maps), on_event=lambda *e: events.append(e))
    assert moved == 0 and all((a.uv == b.uv).all() for a, b in zip(found.views, new.views, strict=True))
    assert [name for name, _ in events] == ["unrefined", "unrefined"]
    assert "changed" in events[1][1]["reason"]
