"""Pictures as they arrive: which are taken when, what each brings, and the page that shows it."""

import itertools
import shutil
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.batch import arrivals
from camcal.batch.arrivals import Arrivals, is_complete
from camcal.batch.live_page import LivePage, page
from camcal.batch.watch import FIRST_POSES, Step, Watcher
from camcal.errors import UsageError
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data" / "board"
PICTURES = sorted(SAMPLES.glob("*.jpg"))


def watcher(**search):
    given = {name: option.default for name, option in DetectionOptions.options().items()}
    told = {name: option.default for name, option in CalibrationOptions.options().items()}
    return Watcher({**given, "cache": False, **search}, told)


# ------------------------------------------------------------------------------------ arrivals
@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(arrivals.time, "monotonic", lambda: now[0])
    return now


def picture(suffix):
    return cv2.imencode(suffix, np.random.default_rng(0).integers(0, 255, (40, 60), np.uint8))[1].tobytes()


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_picture_in_two_halves_is_taken_when_it_is_complete(tmp_path, clock, suffix):
    data, path = picture(suffix), tmp_path / f"a{suffix}"
    seen = Arrivals(tmp_path)
    path.write_bytes(data[: len(data) // 2])
    assert seen.look() == ([], []) and seen.waiting == 1
    clock[0] += arrivals.SETTLED - 0.01
    assert seen.look() == ([], [])
    path.write_bytes(data + b"\0\0")
    assert seen.look() == ([path], []) and seen.waiting == 0
    assert seen.look() == ([], [])


def test_a_file_that_never_ends_is_taken_after_a_while_and_again_when_it_changes(tmp_path, clock):
    data, path = picture(".jpg"), tmp_path / "a.jpg"
    seen = Arrivals(tmp_path)
    path.write_bytes(data[:100])
    assert seen.look() == ([], [])
    clock[0] += arrivals.SETTLED
    assert seen.look() == ([path], [])
    path.write_bytes(data)
    assert seen.look() == ([path], [])
    path.unlink()
    assert seen.look() == ([], [path])
    assert seen.look() == ([], [])


def test_formats_without_a_mark_wait_until_they_stop_changing(tmp_path, clock):
    path = tmp_path / "a.bmp"
    seen = Arrivals(tmp_path)
    path.write_bytes(picture(".bmp"))
    assert seen.look() == ([], [])
    clock[0] += arrivals.SETTLED
    assert seen.look() == ([path], [])


def test_other_files_are_left_alone_and_pictures_come_in_natural_order(tmp_path):
    for name in ("b10.png", "b2.png", ".hidden.png", "notes.txt"):
        (tmp_path / name).write_bytes(picture(".png"))
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "broken.png").symlink_to(tmp_path / "absent.png")
    ready, _ = Arrivals(tmp_path).look()
    assert [p.name for p in ready] == ["b2.png", "b10.png"]


def test_a_mark_in_the_middle_is_no_end(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd9" + b"x" * 100)
    assert not is_complete(tmp_path / "a.jpg") and not is_complete(tmp_path / "absent.jpg")


# ------------------------------------------------------------------------------------ the camera
def test_each_picture_brings_something(tmp_path):
    seen = watcher(board=(9, 6))
    steps = []
    for path in PICTURES[:6]:
        shutil.copy(path, tmp_path)
        steps.append(seen.take(tmp_path / path.name))
    (tmp_path / "empty.png").write_bytes(
        cv2.imencode(".png", np.full((480, 640), 128, np.uint8))[1].tobytes()
    )
    nothing = seen.take(tmp_path / "empty.png")
    assert [s.views for s in steps] == [1, 2, 3, 4, 5, 6] and {s.points for s in steps} == {54}
    known = [s for s in steps if s.after is not None]
    assert len(known) >= 3 and known[-1].after < known[0].after
    assert all(s.before == t.after for t, s in itertools.pairwise(steps))
    assert 0 < steps[-1].rms < 0.1 and "hold the target at the " in steps[-1].advice
    assert (
        nothing.status == "not_found" and nothing.reason and nothing.after == pytest.approx(steps[-1].after)
    )
    views = seen.observations()
    assert len(views.views) == 6 and [s.id for s in views.skipped] == ["empty.png"]
    gone = seen.drop(tmp_path / PICTURES[5].name)
    assert gone.views == 5 and gone.after == pytest.approx(steps[4].after)


def test_the_target_is_recognised_on_the_way(tmp_path):
    seen = watcher()
    for number, path in enumerate(PICTURES[:4], 1):
        shutil.copy(path, tmp_path)
        step = seen.take(tmp_path / path.name)
        assert seen.certain == (number >= 3)
    assert seen.target is not None and seen.target.spec == "checkerboard:9x6" and step.views == 4


def test_before_there_is_a_camera_there_is_advice(tmp_path):
    (tmp_path / "grey.png").write_bytes(cv2.imencode(".png", np.full((480, 640), 128, np.uint8))[1].tobytes())
    step = watcher().take(tmp_path / "grey.png")
    assert step.status == "not_found" and step.advice in FIRST_POSES and step.after is None


# ------------------------------------------------------------------------------------ the page
def test_the_page_is_served_to_this_machine_only():
    shown = LivePage(0)
    try:
        assert b"Waiting for the first picture" in urllib.request.urlopen(shown.address).read()
        step = Step("<b>a</b>", "found", "", 54, 0.2, 20.0, 10.0, "", "top left", "hold it there", 3, 0.1)
        shown.show([step], None, 5.0)
        text = urllib.request.urlopen(shown.address).read().decode()
        assert (
            "&lt;b&gt;a&lt;/b&gt;" in text
            and "10 px" in text
            and "wanted: 5 px" in text
            and "refresh" in text
        )
        for address, host in ((shown.address, "evil.example:80"), (shown.address + "etc/passwd", None)):
            request = urllib.request.Request(address, headers={"Host": host} if host else {})
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(request)
        assert shown.server.server_address[0] == "127.0.0.1"
        with pytest.raises(UsageError, match="cannot be used"):
            LivePage(shown.server.server_address[1])
    finally:
        shown.close()


def test_the_page_says_why_there_is_no_camera():
    step = Step("a", "found", "", 54, None, None, None, "too few views.", "", "hold it so", 1, 0.1)
    assert "too few views." in page([step], None, None)
