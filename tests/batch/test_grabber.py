"""Frames of a film that become pictures: still ones that differ."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from camcal.batch import grabber
from camcal.batch.grabber import Grabber, Selector, is_source
from camcal.errors import DataError

BOARD = Path(__file__).resolve().parents[2] / "sample_data" / "board"


def picture(shift=0, noise=0.0, seed=0):
    """A bright bar on grey, moved by `shift` px, with noise."""
    frame = np.full((240, 320), 100.0)
    frame[60:180, 60 + shift : 140 + shift] = 220
    return np.clip(frame + np.random.default_rng(seed).normal(0, noise, frame.shape), 0, 255).astype(np.uint8)


def test_still_frames_that_differ_are_wanted():
    selector = Selector()
    shifts = [0, 0, 0, 40, 80, 120, 120, 120]
    wanted = [selector.wants(picture(s, 5.0, i)) for i, s in enumerate(shifts)]
    assert wanted == [False, True, False, False, False, False, True, False]


@pytest.mark.parametrize(("level", "still"), [(grabber.STILL - 0.1, True), (grabber.STILL + 0.1, False)])
def test_how_much_may_change_between_still_frames(level, still):
    first = np.full((240, 320), 100, np.float32)
    selector = Selector()
    selector.wants(first)
    assert selector.wants(first + level) == still


@pytest.mark.parametrize(("level", "new"), [(grabber.NEW - 0.1, False), (grabber.NEW + 0.1, True)])
def test_how_much_a_new_picture_differs(level, new):
    first = np.full((240, 320), 100, np.float32)
    selector = Selector()
    assert [selector.wants(f) for f in (first, first, first + level, first + level)] == [
        False,
        True,
        False,
        new,
    ]


@pytest.fixture
def film(tmp_path):
    """Five sample pictures, each for a second, with a cut between them."""
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no films")
    for name in sorted(BOARD.glob("*.jpg"))[:5]:
        frame = cv2.imread(str(name))
        for _ in range(10):
            writer.write(frame)
    writer.release()
    return path


def test_a_film_becomes_pictures(film, tmp_path):
    assert is_source(film) and not is_source(tmp_path)
    thread = Grabber(film, tmp_path / "frames")
    thread.start()
    thread.join(60)
    names = sorted(p.name for p in (tmp_path / "frames").iterdir())
    assert thread.done and len(names) == 5
    numbers = [int(name[5:11]) for name in names]
    assert [n // 10 for n in (m - 1 for m in numbers)] == [0, 1, 2, 3, 4]


def test_a_film_that_is_none(tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"no film")
    with pytest.raises(DataError, match="cannot be opened"):
        Grabber(tmp_path / "film.mp4", tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


def test_a_film_is_watched_to_its_end(film, tmp_path, monkeypatch, capsys):
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert run(["watch", str(film), "-o", "r.yaml", "--board", "9x6"]) == 0
    said = capsys.readouterr().err
    assert said.count("54 points") == 5 and "Worst uncertainty" in said
    assert len(list(Path("r-frames").iterdir())) == 5
    assert run(["watch", str(film), "-o", "r.yaml"]) == 2
    assert run(["watch", str(film), "-o", "s.yaml", "--once"]) == 2
