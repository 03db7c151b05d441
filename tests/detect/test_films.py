"""Films: which frames are searched and kept, what they are called, and reading them again."""

import zipfile

import cv2
import numpy as np
import pytest

from camcal.detect import films, frames, sources
from camcal.detect.decode import UnreadableError
from camcal.detect.films import Range, Shown, candidates, left_out
from camcal.detect.images import detect_images
from camcal.detect.listing import left_in_folders, list_pictures, view_ids
from camcal.detect.refine_images import refine_images
from camcal.detect.resample import read_pictures, written_name
from camcal.detect.targets.base import Detection
from camcal.detect.view_information import chosen_views, information
from camcal.errors import DataError
from camcal.model.pose import Pose
from tests.detect import drawing
from tests.detect.scenes import straight_camera
from tests.shared_data import DATA, needs_data

SIZE, BOARD = (320, 240), (6, 5)


def board(turn, tilt, about, centre=(160, 120), blur=0.0):
    h = drawing.homography(BOARD, centre, 26.0, turn, tilt, about)
    gray = drawing.picture(h, BOARD, SIZE, noise=1.0)
    return cv2.GaussianBlur(gray, (0, 0), blur) if blur else gray


def write_film(path, pictures, code="MJPG"):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 10, SIZE)
    assert writer.isOpened()
    for gray in pictures:
        writer.write(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR))
    writer.release()


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """24 frames: 8 poses, two frames of each and a blurred one on the way to the next."""
    path = tmp_path_factory.mktemp("film") / "board.avi"
    pictures = []
    for i in range(8):
        pose = (0.1 * i - 0.3, 0.5, 2.4 * i, (150 + 5 * (i % 4), 115 + 5 * (i % 3)))
        pictures += [board(*pose), board(*pose), board(*pose, blur=2.5)]
    write_film(path, pictures)
    return path


def test_frames_are_kept_listed_and_read_again(film):
    said = {}
    found = detect_images([film], cache=False, on_event=lambda name, d: said.update({name: d}), jobs=1)
    assert (found.target["columns"], found.target["rows"]) == BOARD and len(found.views) == 8
    assert all(v.id.startswith("board.avi#") for v in found.views)
    reasons = {s.id: s.reason for s in found.skipped}
    assert len(reasons) == 16 and all(s.status == "rejected" for s in found.skipped)
    for pose in range(8):
        kept = {f"board.avi#{3 * pose}", f"board.avi#{3 * pose + 1}"} - set(reasons)
        assert len(kept) == 1
        assert reasons[f"board.avi#{3 * pose + 2}"].startswith("blurred")
        (same,) = {f"board.avi#{3 * pose}", f"board.avi#{3 * pose + 1}"} & set(reasons)
        assert reasons[same] == f"it shows the target where {kept.pop()} does"
    assert said["target"]["noun"] == "frames" and said["frames"]["searched"] == said["frames"]["frames"] == 24
    events, pose = [], Pose(np.eye(3), np.array([0.0, 0, 10]))
    camera = straight_camera(SIZE)
    refine_images(
        found, camera, {v.id: pose for v in found.views}, on_event=lambda name, d: events.append(name)
    )
    assert events == ["refined"] * 8


def test_the_frames_that_are_kept_are_those_that_say_most(film):
    found = detect_images([film], cache=False, keep_frames=3, jobs=1)
    assert len(found.views) == 3
    assert sum("adds less than the 3 frames" in s.reason for s in found.skipped) == 10
    every = detect_images([film], cache=False, keep_frames=None, every=3, jobs=1)
    assert [v.id for v in every.views] == [f"board.avi#{3 * i}" for i in range(8)]


def test_part_of_a_film(film):
    found, count = candidates(film, Range(0.5, 1.2))
    assert [c.number for c in found] == list(range(5, 12)) and count == 12
    assert [c.number for c in candidates(film, Range(1.0, np.inf, 5))[0]] == [10, 15, 20]


def test_the_best_of_each_stretch_is_searched(film, monkeypatch):
    monkeypatch.setattr(films, "MOST_SEARCHED", 8)
    found, count = candidates(film, Range())
    assert count == 24 and [c.number // 3 for c in found] == list(range(8))
    # sharp, and the one before shows the same; of the first frame no motion is known
    assert [c.number % 3 for c in found][1:] == [1] * 7
    assert max(c.motion for c in found) < 0.5


def test_a_film_of_unknown_length(film, monkeypatch):
    monkeypatch.setattr(films, "MOST_SEARCHED", 3)
    monkeypatch.setattr(frames.cv2, "CAP_PROP_FRAME_COUNT", frames.cv2.CAP_PROP_POS_FRAMES)  # 0 at the start
    found, count = candidates(film, Range())
    assert count == 24 and 3 <= len(found) <= 6
    assert len({c.number % 3 for c in found} & {2}) == 0


def test_any_frame_in_any_order(film):
    whole = dict(enumerate(p for _, p in read_pictures([film])))
    assert len(whole) == 24
    for number in (5, 3, 23, 0, 11):
        path = film.with_name(f"board.avi#{number}")
        ((_, again),) = read_pictures([path])
        assert (again == whole[number]).all() and list_pictures([path]) == [path]
        gray, sha = sources.read_gray(path)
        assert gray.shape == SIZE[::-1] and sources.read_gray(path, sha)[1] == sha
    assert written_name(film.with_name("board.avi#7")) == "board_000007.png"
    with pytest.raises(UnreadableError, match="no frame 24"):
        sources.read_gray(film.with_name("board.avi#24"))
    frames.close_films()


def test_a_film_that_cannot_be_entered_is_read_from_its_start(film, monkeypatch):
    path = film.with_name("board.avi#9")
    right, sha = sources.read_gray(path)
    wrong, _ = sources.read_gray(film.with_name("board.avi#2"))
    monkeypatch.setattr(frames.Film, "seek", lambda self, number: self.restart() or self.walk(2))
    assert (sources.read_gray(path)[0] == wrong).all()
    assert (sources.read_gray(path, sha)[0] == right).all()


def test_numbered_frames_are_a_film(tmp_path):
    for i in range(4):
        cv2.imwrite(str(tmp_path / f"frame_{i:03d}.png"), board(0.2 * i - 0.3, 0.5, 2.0 * i))
    pattern = tmp_path / "frame_%03d.png"
    found = detect_images([pattern], cache=False, jobs=1)
    assert [v.id for v in found.views] == [f"frame_%03d.png#{i}" for i in range(4)]


def test_a_film_without_a_board_and_a_broken_one(tmp_path):
    write_film(tmp_path / "a.avi", [np.full(SIZE[::-1], 90 + i, np.uint8) for i in range(6)])
    (tmp_path / "b.mp4").write_bytes(b"no film")
    with pytest.raises(DataError, match="no target was found in 6 of 6 frames"):
        detect_images([tmp_path / "a.avi"], cache=False)
    for limits in ({"from_time": 5.0, "to_time": 3.0}, {"from_time": 60.0}):
        with pytest.raises(DataError, match="there are no frames from"):
            detect_images([tmp_path / "a.avi"], cache=False, **limits)
    with pytest.raises(DataError, match="no target was found in 1 picture") as error:
        detect_images([tmp_path / "b.mp4"], cache=False)
    assert "no decoder can open this film" in error.value.hint
    write_film(tmp_path / "c.avi", [board(0.1, 0.4, i) for i in range(3)])
    found = detect_images([tmp_path], cache=False, jobs=1)  # a folder of films
    assert {s.id: s.status for s in found.skipped}["b.mp4"] == "unreadable" and len(found.views) == 3


# ------------------------------------------------------------------------------------------------ the choice
def shown(name, uv, blur=0.5, motion=0.0):
    points = np.array([[x, y] for y in range(4) for x in range(5)], float)
    info = {"blur_px": blur}
    return Shown(name, points, Detection(np.arange(20), uv, np.full(20, 0.1), info), (640, 480), motion)


def seen(turn, tilt, about, centre=(320, 240)):
    return drawing.corners((5, 4), drawing.homography((5, 4), centre, 60.0, turn, tilt, about))


def test_blur_on_both_sides_of_its_limits():
    views = [shown(f"f#{i}", seen(0.3 * i, 0.5, i), 1.0) for i in range(6)]
    near, far = (shown("f#9", seen(2.0, 0.6, 3), blur) for blur in (1.49, 1.51))
    assert left_out([*views, near], 10) == {}
    assert list(left_out([*views, far], 10)) == [6]
    sharp = [shown(f"f#{i}", seen(0.3 * i, 0.5, i), 0.4) for i in range(6)]
    assert left_out([*sharp, shown("f#9", seen(2.0, 0.6, 3), 0.99)], 10) == {}  # sharp enough for any


def test_motion_on_both_sides_of_its_limit():
    uv = seen(0.2, 0.5, 1)
    least = films.MOVED * 800.0
    assert left_out([shown("a", uv), shown("b", uv + [1.01 * least, 0])], 10) == {}
    (reason,) = left_out([shown("a", uv), shown("b", uv + [0.99 * least, 0])], 10).values()
    assert reason.startswith("it shows the target where")


def test_the_stiller_of_two_frames_is_kept():
    uv = seen(0.2, 0.5, 1)
    assert list(left_out([shown("a", uv, motion=5.0), shown("b", uv)], 10)) == [0]
    assert list(left_out([shown("a", uv), shown("b", uv, motion=5.0)], 10)) == [1]


def test_information_is_that_of_finite_differences():
    """Against the normal matrix of a projection written independently, poses eliminated."""
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (12, 2))
    rotation = cv2.Rodrigues(np.array([0.4, -0.3, 0.2]))[0]
    t, size, sigma = np.array([0.1, -0.2, 4.0]), (640, 480), 0.2

    def project(p):
        x = (cv2.Rodrigues(p[5:8])[0] @ rotation @ np.c_[points, np.zeros(12)].T).T + t + p[8:]
        a = x[:, :2] / x[:, 2:]
        bent = a * (1 + p[4] * (a**2).sum(1, keepdims=True))
        return (640 * (bent * (1 + p[:2]) + p[2:4]) + (np.array(size) - 1) / 2).ravel()

    steps = 1e-5 * np.eye(11)
    jacobian = np.stack([(project(s) - project(-s)) / 2e-5 for s in steps], 1) / sigma
    normal = jacobian.T @ jacobian
    wanted = normal[:5, :5] - normal[:5, 5:] @ np.linalg.solve(normal[5:, 5:], normal[5:, :5])
    uv = project(np.zeros(11)).reshape(-1, 2)
    assert information(points, uv, sigma, size) == pytest.approx(wanted, rel=1e-4, abs=1e-4 * wanted.max())
    assert (information(points[:4], uv[:4], sigma, size) == 0).all()


def test_tilted_views_are_chosen_before_frontal_ones():
    frontal = [seen(0.1 * i, 0.0, 0) for i in range(5)]
    tilted = [seen(0.1 * i, 0.6, 2.0 * i) for i in range(5)]
    points = np.array([[x, y] for y in range(4) for x in range(5)], float)
    gains = [information(points, uv, 0.1, (640, 480)) for uv in frontal + tilted]
    chosen, repeated = chosen_views(gains, 5, lambda a, b: False)
    assert min(chosen[:3]) >= 5 and len(chosen) == 5 and repeated == {}
    assert chosen_views([], 3, lambda a, b: False) == ([], {})


# ------------------------------------------------------------------------------------------------ archives, pages
def test_pictures_of_an_archive(tmp_path):
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for i in range(3):
            gray = board(0.2 * i, 0.4, i)
            archive.writestr(f"session/v{i}.png", cv2.imencode(".png", gray)[1].tobytes())
        archive.writestr("__MACOSX/session/._v0.png", b"fork")
        archive.writestr("notes.txt", b"nothing")
    found = detect_images([tmp_path / "all.zip"], cache=False, jobs=1)
    assert [v.id for v in found.views] == ["v0.png", "v1.png", "v2.png"]
    one = tmp_path / "all.zip" / "session" / "v1.png"
    assert list_pictures([one]) == [one] and view_ids([one]) == ["v1.png"]
    with zipfile.ZipFile(tmp_path / "none.zip", "w") as archive:
        archive.writestr("notes.txt", b"nothing")
    (tmp_path / "broken.zip").write_bytes(b"PK\x03\x04")
    for name in ("none.zip", "broken.zip"):
        with pytest.raises(DataError, match=name):
            list_pictures([tmp_path / name])


def test_films_in_an_archive_are_named(tmp_path):
    gray = np.zeros((48, 64), np.uint8)
    picture = cv2.imencode(".png", gray)[1].tobytes()
    for name, entries in (("films", {}), ("both", {"a.png": picture})):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            for entry, data in {"session/movie.mp4": b"film", "b.GIF": b"film", **entries}.items():
                archive.writestr(entry, data)
    with pytest.raises(
        DataError, match=r"holds films, which are not read from archives: .*movie\.mp4"
    ) as error:
        list_pictures([tmp_path / "films.zip"])
    assert f"python -m zipfile -e {tmp_path}/films.zip films" in error.value.hint
    both = tmp_path / "both.zip"
    assert list_pictures([both]) == [both / "a.png"]
    assert left_in_folders([both]) == [both / "b.GIF", both / "session/movie.mp4"]


def test_pages_of_a_tiff_file(tmp_path):
    pages = [board(0.2 * i, 0.4, i) for i in range(3)]
    cv2.imwritemulti(str(tmp_path / "all.tif"), pages)
    names = list_pictures([tmp_path])
    assert [n.name for n in names] == ["all.tif#0", "all.tif#1", "all.tif#2"]
    assert all((sources.read_gray(n)[0] == p).all() for n, p in zip(names, pages, strict=True))
    with pytest.raises(UnreadableError, match="page 3"):
        sources.read_gray(tmp_path / "all.tif#3")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(tmp_path / "all.tif", "session/all.tif")
    names = list_pictures([tmp_path / "all.zip"])
    assert names == [tmp_path / "all.zip" / "session" / f"all.tif#{i}" for i in range(3)]
    assert all((sources.read_gray(n)[0] == p).all() for n, p in zip(names, pages, strict=True))
    assert len(detect_images([tmp_path], cache=False, jobs=1).views) == 3


@needs_data
def test_the_real_film():
    """Frames that show the board as cv2 finds it (121 of 142), thinned to forty."""
    found = detect_images([DATA / "video_chessboard" / "movie.mjpeg"], jobs=1)
    assert len(found.views) == 40 and (found.target["columns"], found.target["rows"]) == (6, 4)
    assert sum(s.status == "not_found" for s in found.skipped) <= 22
