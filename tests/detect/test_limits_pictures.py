"""Limits of pictures, files and searches, each just below and just above."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.data.observations import Observations
from camcal.detect import (
    cache,
    decode,
    film_motion,
    images,
    lines,
    listing,
    local_contrast,
    matches,
    pyramid,
    rig_images,
    segments,
    sources,
)
from camcal.detect.examine import Outcome
from camcal.detect.targets.base import Detection
from camcal.errors import DataError
from tests.detect.scenes import make
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ contrast
def two_levels(apart, low=100):
    gray = np.full((60, 80), low, np.uint8)
    gray[:, 40:] += apart
    return gray


def test_a_picture_of_weak_contrast():
    weak = int(pyramid.WEAK)
    assert pyramid.to_8_bits(two_levels(weak)).max() == 100 + weak
    assert pyramid.to_8_bits(two_levels(weak - 1)).max() > 250


def test_a_contrast_that_is_more_than_noise(monkeypatch):
    gray = two_levels(30)
    for share, stretched in ((LESS, True), (MORE, False)):
        monkeypatch.setattr(pyramid, "noise", lambda _, s=share: s * 30 / pyramid.SOMETHING)
        assert (pyramid.to_8_bits(gray).max() > 250) == stretched


def test_noise_of_a_blurred_picture():
    """Half of it is left; and an edge of one pixel remains one of two."""
    noise = np.random.default_rng(0).normal(size=(300, 300))
    assert cv2.GaussianBlur(noise, (0, 0), pyramid.WEAK_BLUR).std() == pytest.approx(0.5, abs=0.05)


def test_the_weakest_contrast_that_is_raised_in_full():
    for apart in (local_contrast.WEAKEST, 2 * local_contrast.WEAKEST):
        region = np.repeat(np.array([100, 100 + apart]) * local_contrast.STEPS, 500)
        made = local_contrast._equalising(region)
        raised = made[region[-1]] - made[region[0]]
        assert raised == pytest.approx(local_contrast.WEAKEST * local_contrast.MOST_GAIN, rel=0.02)


def test_regions_of_a_picture_that_differ():
    """A weak board beside a lamp covers a region of its own, and not the whole of a larger one."""
    gray = np.full((400, 400), 10, np.uint8)
    side = 400 // local_contrast.REGIONS
    board = np.kron(np.indices((8, 8)).sum(0) % 2, np.ones((side // 8, side // 8)))[:side, :side]
    gray[: board.shape[0], : board.shape[1]] = 30 + local_contrast.WEAKEST * board
    part = local_contrast.evened(gray)[: side // 2, : side // 2].astype(int)
    assert np.ptp(part) > 0.9 * local_contrast.WEAKEST * local_contrast.MOST_GAIN


def test_regions_of_a_board_that_fills_the_picture():
    """A region of a board of 5x4 squares has both colours: its squares keep nearly their whole contrast."""
    board = np.indices((4, 5)).sum(0) % 2
    gray = (30 + local_contrast.WEAKEST * np.kron(board, np.ones((80, 80)))).astype(np.uint8)
    middle = local_contrast.evened(gray)[40::80, 40::80].astype(float)
    raised = middle[board == 1].min() - middle[board == 0].max()
    assert raised > 0.8 * local_contrast.WEAKEST * local_contrast.MOST_GAIN


# ------------------------------------------------------------------------------------ files
def test_the_properties_of_a_heic_file():
    box = b"\0\0\0\x09irot\1"
    for before, turns in ((decode.LONGEST_META - len(box), 1), (decode.LONGEST_META - len(box) + 1, 0)):
        assert decode._quarter_turns(bytes(before) + box) == turns


def test_the_largest_file_of_a_picture(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(bytes(100))
    asked = []
    monkeypatch.setattr(sources, "read_file", lambda _, most, *__: asked.append(most) or b"")
    sources.read_bytes(path)
    assert asked == [sources.MOST_BYTES]
    monkeypatch.undo()
    for most, read in ((100, True), (99, False)):
        monkeypatch.setattr(sources, "MOST_BYTES", most)
        if read:
            assert len(sources.read_bytes(path)) == 100
        else:
            with pytest.raises(sources.UnreadableError, match="cannot be read"):
                sources.read_bytes(path)


def test_the_entries_of_the_cache(tmp_path):
    """More than the limit is pruned, the longest unused first, to a part of it."""
    folder = tmp_path / "ab"
    folder.mkdir()
    for limit, left in ((1000, 100), (999, int(cache.KEPT * 99.9))):
        for i in range(100):
            (folder / f"{i}.npz").write_bytes(bytes(10))
        cache.prune(tmp_path, limit)
        assert len(list(folder.iterdir())) == left
    assert cache.prune.__defaults__ == (cache.LIMIT,)


def test_the_largest_entry_of_the_cache(tmp_path, monkeypatch):
    path = tmp_path / "ab" / "c.npz"
    cache.store(path, {"uv": np.zeros((50, 2))}, {"a": 1})
    size = path.stat().st_size
    for most, read in ((size + 1000, True), (size - 1, False)):
        monkeypatch.setattr(cache, "LARGEST", most)
        assert (cache.load(path) is not None) == read


def test_folders_that_an_error_names(tmp_path):
    for count in (listing.MOST_NAMED, listing.MOST_NAMED + 1):
        root = tmp_path / str(count)
        for i in range(count):
            (root / f"cam{i}").mkdir(parents=True)
            (root / f"cam{i}" / "a.png").write_bytes(b"")
        with pytest.raises(DataError, match="subfolders do") as raised:
            listing.list_pictures([root])
        assert raised.value.hint.count("=") == listing.MOST_NAMED


@pytest.mark.parametrize(("same", "copies"), [(0, False), (1, True)])
def test_cameras_with_the_same_pictures(same, copies):
    """Of twenty of one camera; half of them may be black in both."""
    shared = int(20 * rig_images.SAME) + same
    parts = {}
    for name, count in (("a", 20), ("b", 30)):
        names = [f"both{i}" if i < shared else f"{name}{i}" for i in range(count)]
        parts[name] = Observations.from_views([], files=tuple({"sha256": n} for n in names))
    if copies:
        with pytest.raises(DataError, match=f"were given the same pictures: {shared} of 20 and 30"):
            rig_images._check_own_pictures(parts)
    else:
        rig_images._check_own_pictures(parts)


def test_pictures_in_which_the_target_is_confirmed(monkeypatch):
    for count, read in (
        (images.CONFIRMED_IN, images.CONFIRMED_IN),
        (3 * images.CONFIRMED_IN, images.CONFIRMED_IN),
    ):
        asked = []
        outcomes = [SimpleNamespace(path=i, status="found") for i in range(count)]
        run = SimpleNamespace(read=lambda path, _, a=asked: a.append(path))
        monkeypatch.setattr(images, "contradiction", lambda *_: None)
        images._confirm(run, [SimpleNamespace(target=make("aprilgrid:6x6:22mm:0.3"), outcomes=outcomes)])
        assert len(asked) == read


def test_frames_for_whose_motion_others_are_searched(tmp_path):
    """Of more than that every second one."""
    film = tmp_path / "film.mp4"
    film.touch()
    for count, step in ((film_motion.MOST_FRAMES, 1), (film_motion.MOST_FRAMES + 1, 2)):
        names = [film.with_name(f"film.mp4#{10 * i}") for i in range(count)]
        found = Detection(np.arange(1), np.zeros((1, 2)))
        outcomes = [Outcome(n, "found", detection=found, size=(9, 9)) for n in names]
        asked = []
        film_motion.with_motion(outcomes, lambda files, a=asked: a.extend(files) or [], outcomes)
        assert [n.name for n in asked] == [f"film.mp4#{10 * i + 1}" for i in range(0, count, step)]


# ------------------------------------------------------------------------------------ lines and points
def drawn_line(length, size=(300, 400)):
    gray = np.full(size, 200, np.uint8)
    x0 = (size[1] - length) / 2
    gray = (gray + np.random.default_rng(0).normal(0, 1, size)).astype(np.uint8)
    start, end = (round(16 * x0), 16 * 150 + 40), (round(16 * (x0 + length)), 16 * 150 + 40)
    return cv2.line(gray, start, end, 60, 3, cv2.LINE_AA, 4)


def test_the_shortest_line():
    for share, count in ((0.9, 0), (1.1, 1)):
        gray = drawn_line(share * lines.LEAST_LENGTH * 1000, (600, 800))
        assert len(lines.find_lines(gray)) == count


def test_an_edge_beside_a_thin_line():
    for apart, count in ((lines.BORDER - 3, 1), (lines.BORDER + 3, 2)):
        gray = np.full((300, 400), 200, np.uint8)
        gray[149:152] = 40  # the line's middle is row 150
        gray[int(150 + apart) :] = 150
        assert len(lines.find_lines(gray)) == count


def test_a_point_that_is_on_an_exact_line():
    x = np.linspace(-200, 200, 401)
    for share, kept in ((0.9, 401), (1.1, 400)):
        y = 0.1 * x
        y[200] += share * lines.ROUNDING
        assert len(lines._smooth(np.c_[x, y])[0]) == kept


@pytest.mark.parametrize(("share", "seen"), [(0.85, 0), (1.15, 4)])
def test_the_shortest_segment(share, seen):
    side = round(share * segments.SHORTEST)
    gray = np.full((80, 80), 200, np.uint8)
    gray[30 : 30 + side, 30 : 30 + side] = 60
    assert len(segments.find_segments(gray)) == seen


def test_points_of_a_picture():
    rng = np.random.default_rng(0)
    gray = cv2.GaussianBlur(rng.uniform(0, 255, (470, 500)), (0, 0), 1.0)
    gray = cv2.normalize(gray, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    assert matches.MOST <= len(matches.points_of(gray)) < 1.02 * matches.MOST  # some have two orientations
    assert 100 < len(matches.points_of(gray[:200, :200])) < matches.MOST
