from dataclasses import replace

import cv2
import numpy as np
import pytest

from camcal.data.observations import View
from camcal.detect.camera_pass import WINDOWS, refine_in_windows
from camcal.detect.images import detect_images
from camcal.detect.part import KEPT_PARTS
from camcal.detect.refine_images import on_board, refine_images, rms_move
from camcal.detect.sources import read_gray
from tests.detect.scenes import make, picture, pose, straight_camera

TARGET = make("checkerboard:6x5:20mm")
POSES = [pose([0.5, 0.3, 0.2], [-55, -40, 330]), pose([-0.4, 0.2, 0.1], [-52, -40, 340])]


@pytest.fixture
def pictures(tmp_path):
    camera, rng = straight_camera((320, 260), 600.0), np.random.default_rng(0)
    for i, at in enumerate(POSES):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(TARGET, camera, at, rng, blur=1.0, noise=2.0))
    return tmp_path, camera, {f"{i}.png": at for i, at in enumerate(POSES)}


def test_corners_move_little_and_stop(pictures):
    folder, camera, poses = pictures
    found = detect_images([folder], square="20mm", cache=False)
    events = []
    (new,) = refine_images(found, camera, poses, on_event=lambda *e: events.append(e))
    (again,) = refine_images(new, camera, poses)
    assert 0 < rms_move(found.uv, new.uv) < 0.05
    assert rms_move(new.uv, again.uv) < 0.1 * np.median(new.views[0].sigma)  # where a fit stops
    for view in again.views:
        true = camera.project(poses[view.id].apply(TARGET.points))
        nearest = np.linalg.norm(view.uv[:, None] - true, axis=2).min(1)
        assert np.median(nearest / view.sigma) < 2.0  # 1.2 for a Gaussian, 30 corners
    assert [name for name, _ in events] == ["refined", "refined"]


def test_several_windows_of_one_reading(pictures):
    folder, camera, poses = pictures
    found = detect_images([folder], square="20mm", cache=False)
    several = refine_images(found, camera, poses, windows=WINDOWS)
    assert len(several) == len(WINDOWS)
    row, column = np.divmod(several[0].views[0].point_ids, 6)
    rim = (row % 4 == 0) | (column % 5 == 0)
    sigmas = [np.median(o.views[0].sigma[~rim]) for o in several]
    assert sorted(sigmas, reverse=True) == sigmas and sigmas[-1] < 0.8 * sigmas[0]
    # outer squares may be cut narrower: only the shading, which all corners show, changes something there
    half, most = several[1].views[0], several[4].views[0]
    assert half.sigma[rim] == pytest.approx(most.sigma[rim], rel=0.02)
    assert np.abs(half.uv[rim] - most.uv[rim]).max() < 0.1 * np.abs(half.uv[~rim] - most.uv[~rim]).max()


def test_a_second_pass_of_the_same_camera_is_taken_from_the_cache(pictures, monkeypatch, tmp_path_factory):
    folder, camera, poses = pictures
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    found = detect_images([folder], square="20mm")
    first = refine_images(found, camera, poses, windows=WINDOWS)

    def fit(*_):
        raise AssertionError("fitted again")

    monkeypatch.setattr("camcal.detect.refine_images.refine_in_windows", fit)
    for one, again in zip(first, refine_images(found, camera, poses, windows=WINDOWS), strict=True):
        assert (one.uv == again.uv).all() and (one.sigma == again.sigma).all()
    nearly = {**poses, "0.png": pose([0.5, 0.3, 0.2 + 1e-12], [-55, -40, 330])}
    with pytest.raises(AssertionError, match="fitted again"):
        refine_images(found, camera, nearly, windows=WINDOWS)
    detect_images([folder], square="20mm", cache=False)
    with pytest.raises(AssertionError, match="fitted again"):  # where no cache is wanted, none is read
        refine_images(found, camera, poses, windows=WINDOWS)


def test_views_without_a_pose_stay(pictures):
    folder, camera, poses = pictures
    found = detect_images([folder], square="20mm", cache=False)
    (new,) = refine_images(found, camera, {"0.png": poses["0.png"]})
    assert (found.views[1].uv == new.views[1].uv).all()
    assert (found.views[0].uv != new.views[0].uv).any()


def test_parts_that_were_kept_give_the_same_bits(pictures, monkeypatch):
    """With and without them, and where the camera asks for pixels beyond them."""
    folder, camera, poses = pictures
    found = detect_images([folder], square="20mm", cache=False)
    kept = [KEPT_PARTS.get(f["sha256"]) for f in found.files]
    assert all(0 < p.pixels.size < 320 * 260 for p in kept)
    read = []
    monkeypatch.setattr(
        "camcal.detect.refine_images.read_gray", lambda *args: read.append(args) or read_gray(*args)
    )
    from_parts = refine_images(found, camera, poses, windows=WINDOWS)
    assert not read
    KEPT_PARTS.clear()
    for file, part in zip(found.files, kept, strict=True):
        KEPT_PARTS.keep(file["sha256"], replace(part, pixels=part.pixels[:-40]))
    beyond = refine_images(found, camera, poses, windows=WINDOWS)
    assert len(read) == 2
    KEPT_PARTS.clear()
    from_files = refine_images(found, camera, poses, windows=WINDOWS)
    for one, other, third in zip(from_parts, beyond, from_files, strict=True):
        for uv in (other.uv, third.uv):
            np.testing.assert_array_equal(one.uv, uv)
        np.testing.assert_array_equal(one.sigma, third.sigma)


def test_of_a_negative_no_part_is_used(pictures):
    """It may have been kept while the picture was searched as it is."""
    folder, camera, poses = pictures
    found = detect_images([folder], square="20mm", cache=False)
    (usual,) = refine_images(found, camera, poses)
    for i in range(2):
        path = folder / f"{i}.png"
        cv2.imwrite(str(path), ~cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    inverted = detect_images([folder], square="20mm", cache=False)
    as_negative = replace(found, files=inverted.files, target={**found.target, "negative": True})
    assert all(KEPT_PARTS.get(f["sha256"]) is not None for f in inverted.files)
    (same,) = refine_images(as_negative, camera, poses)
    np.testing.assert_array_equal(same.uv, usual.uv)


def test_changed_and_lost_pictures_are_said(pictures):
    folder, camera, poses = pictures
    found = detect_images([folder], cache=False)
    KEPT_PARTS.clear()
    (folder / "0.png").unlink()
    (folder / "1.png").write_bytes(b"another")
    events = []
    (new,) = refine_images(found, camera, poses, on_event=lambda *e: events.append(e))
    assert all((a.uv == b.uv).all() for a, b in zip(found.views, new.views, strict=True))
    assert [name for name, _ in events] == ["unrefined", "unrefined"]
    assert "changed" in events[1][1]["reason"]


def test_wider_windows_have_less_noise():
    """On a perfect board each window brings what its sigmas say, wherever its corners started."""
    camera, rng = straight_camera((480, 400), 700.0), np.random.default_rng(3)
    target = make("checkerboard:9x7:20mm")
    at = pose([0.3, -0.2, 0.1], [-80, -60, 420])
    gray = picture(target, camera, at, rng, blur=1.0, noise=6.0)
    true = camera.project(at.apply(target.points))
    start = true + rng.normal(0, 0.1, true.shape)
    view = View("", target.points, start, None, np.arange(len(true)))
    views = refine_in_windows(gray, view, lambda px: on_board(camera, at, px), 20.0)
    error = [np.sqrt(np.square(v.uv - true).sum(1).mean()) for v in views]
    assert len(views) == len(WINDOWS) and error[0] > 1.2 * error[2] > 1.2 * 0.9 * error[-1]
    for v, e in zip(views, error, strict=True):  # 63 corners, so 9 % of scatter
        assert e == pytest.approx(np.sqrt(2 * np.square(v.sigma).mean()), rel=0.3)


def test_a_map_without_values_leaves_the_corners():
    gray = np.zeros((50, 60), np.uint8)
    view = View("", np.zeros((4, 3)), np.full((4, 2), 20.0), np.ones(4), np.arange(4))
    for new in refine_in_windows(gray, view, lambda px: np.full(px.shape, np.nan), 1.0):
        assert (new.uv == view.uv).all() and (new.sigma == view.sigma).all()
