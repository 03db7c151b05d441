"""Limits of grids of marks, levels of contrast, lists of pictures and files, each just below and just above."""

import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.detect import (
    edge_blur,
    exif,
    grid,
    local_contrast,
    local_map,
    pages,
    shading,
    sources,
    unasked,
)
from camcal.detect.grid import Marks
from camcal.detect.recognition import layout
from camcal.detect.targets import outlined
from camcal.detect.windows import Windows
from camcal.errors import DataError
from tests.detect.scenes import make
from tests.sides import LESS, MORE


def linked(xy, turn=0.0):
    """How many marks have a neighbour on their first ray, along x, where the rays of all are turned by an angle."""
    angle = turn + np.arange(4) * np.pi / 2
    rays = np.tile(np.stack([np.cos(angle), np.sin(angle)], -1), (len(xy), 1, 1))
    marks = Marks(xy, rays, np.ones(len(xy)), 1.5, alternating=False, closed=False)
    return int((grid.neighbours(marks)[0][:, 0] >= 0).sum())


def test_how_far_a_ray_points_past_the_neighbour():
    xy = np.c_[20.0 * np.arange(8), np.zeros(8)]
    assert linked(xy, LESS * grid.ANGLE) == 7 and linked(xy, MORE * grid.ANGLE) == 0


def test_the_marks_of_a_grid():
    least = grid.LEAST_NODES
    for count, links in ((least, least - 1), (least - 1, 0)):
        assert linked(np.c_[20.0 * np.arange(count), np.zeros(count)]) == links


def test_terms_of_the_fourth_degree():
    for number, side, terms in (
        (local_map.FOR_QUARTIC, 5, local_map.QUARTIC),
        (local_map.FOR_QUARTIC - 1, 5, local_map.CUBIC),
        (local_map.FOR_QUARTIC, 4, local_map.CUBIC),
    ):
        assert local_map._terms(np.array([number]), side) == [terms]


def test_the_degree_of_bent_edges(monkeypatch):
    """Three corners a term are needed for each of the degrees, the higher one first."""
    board = make("squares:9x8:10mm:0.5").points[:, :2].reshape(-1, 4, 2)
    asked = []
    solve = np.linalg.lstsq
    monkeypatch.setattr(np.linalg, "lstsq", lambda a, *r, **k: asked.append(a.shape[1]) or solve(a, *r, **k))
    for degree in outlined.DEGREES:
        terms = (degree + 1) * (degree + 2) // 2
        least = -(-3 * terms // 4)  # squares
        for count, used in ((least, True), (least - 1, False)):
            asked.clear()
            seen = 4 * board[:count] + 0.002 * board[:count] ** 2
            outlined.bows(board[:count], SimpleNamespace(good=np.ones(count, bool), corners=seen))
            assert (terms in asked) == used


def test_distances_of_neighbours_of_a_layout():
    """A marker has one neighbour, which has two: distances in pairs."""
    square = 40.0 * (layout.UNIT + 0.5)
    for count, known in ((layout.FEWEST_STEPS, True), (layout.FEWEST_STEPS - 1, False)):
        view = [SimpleNamespace(id=i, corners=square + (60.0 * i, 0.0)) for i in range(3)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(layout, "_steps", lambda *_, n=count: np.full(n, 1.5))
            assert bool(layout._patches([view], False)[0]) == known


def test_the_largest_gain_of_contrast():
    """Of two levels that lie apart: the slope of the map is a part of the whole range at most."""
    region = np.repeat([80 * local_contrast.STEPS, 160 * local_contrast.STEPS], 500)
    one = np.full(1000, 80 * local_contrast.STEPS)
    for values in (region, one):
        made = local_contrast._equalising(values)
        assert np.diff(made).max() * local_contrast.STEPS <= MORE * local_contrast.MOST_GAIN
    # all values at one level would be raised by 255 / WEAKEST without the limit
    assert np.diff(made).max() * local_contrast.STEPS > LESS * local_contrast.MOST_GAIN
    wide = np.arange(256 * local_contrast.STEPS)
    assert np.diff(local_contrast._equalising(wide)).max() * local_contrast.STEPS < 1.1


def test_shading_that_exceeds_a_corner_s_range():
    """The range from black to white at a pixel is no less than a part of that of the corner."""
    least = shading.LEAST_RANGE
    for share, exact in ((1.01, True), (0.99, False)):
        # white falls by so much at q = 1 that the range there is a part of 100
        q, counts = np.array([[[1.0], [0.0]]]), np.ones((1, 1), bool)
        white = -(1 - share * least) * 100
        value = np.array([[10 + 0.5 * share * least * 100]], np.float32)  # half way between black and white
        windows = Windows(np.zeros((1, 2)), q, value, counts, np.ones(1))
        slope = np.array([[[white, 0.0], [0.0, 0.0]]])
        made = shading.evened(windows, slope, np.array([60.0]), np.array([50.0]), (0.0, 255.0))
        assert np.isclose(made.value[0, 0], 60.0, atol=0.01) == exact


def test_evened_values_stay_inside_the_limits():
    windows = Windows(
        np.zeros((1, 2)),
        np.zeros((1, 2, 2)),
        np.array([[250.0, 255.0]], np.float32),
        np.ones((1, 2), bool),
        np.ones(1),
    )
    slope = np.zeros((1, 2, 2))
    # black 10, white 110: 250 lies beyond white, and stays; 255 is cut off, and stays
    made = shading.evened(windows, slope, np.array([60.0]), np.array([50.0]), (0.0, 250.0005))
    assert (
        made.value[0, 0] == pytest.approx(250.0005 - shading.INSIDE, abs=1e-4) and made.value[0, 1] == 255.0
    )


def test_edges_that_are_examined(monkeypatch):
    """Of more than the largest number every second one."""
    asked = []
    keep = edge_blur.cv2.remap
    monkeypatch.setattr(
        edge_blur.cv2, "remap", lambda g, at, *a, **k: asked.append(len(at)) or keep(g, at, *a, **k)
    )
    most = edge_blur.MOST_EDGES
    for count, examined in ((most - 1, most - 1), (most, most // 2)):
        start = np.zeros((count, 2)) + 10
        edge_blur._blurs(
            np.zeros((40, 40), np.float32), start, start + (0.0, 4), *[np.tile([8.0, 0], (count, 1))] * 2
        )
        assert asked[-1] == examined


# ------------------------------------------------------------------------------------ pictures without a target
def test_pictures_in_which_every_kind_is_looked_for():
    """Two are looked at, then so many spread over all, then the rest: not where enough show markers or discs."""
    files = list(range(40))
    for votes, rest in ((unasked.ENOUGH_VOTES, False), (unasked.ENOUGH_VOTES - 1, True)):
        looked = []

        class Stop(Exception):
            pass

        def examine_all(some, *_, seen=looked, **__):
            seen.append(len(some))
            return [SimpleNamespace(path=f, sight=None) for f in some]

        best = SimpleNamespace(target="discs", pictures=tuple(range(votes)))
        run = SimpleNamespace(files=files, examine_all=examine_all)

        def stop(*_):
            raise Stop

        with pytest.MonkeyPatch.context() as patch, pytest.raises(Stop):
            patch.setattr(unasked, "best_of", lambda _, b=best: b)
            patch.setattr(unasked, "unread", stop)
            unasked.recognised(run, None)
        first = unasked.FIRST_LOOK
        known = set(unasked.spread(files, unasked.AGREEING))
        second = len([f for f in unasked.spread(files, first) if f not in known])
        assert looked == [unasked.AGREEING, second] + [40 - unasked.AGREEING - second] * rest
        assert (
            unasked.spread(files[:first], first) == files[:first]
            and len(unasked.spread(files, first)) == first
        )


def test_reasons_that_are_named():
    most = unasked.MOST_REASONS
    for count in (most, most + 1):
        outcomes = [SimpleNamespace(code=str(i), reason=f"reason {i}") for i in range(count)]
        run = SimpleNamespace(tell_pictures=lambda _: None, count="9 pictures")
        error = unasked.nothing_found("target", outcomes, None, run)
        assert isinstance(error, DataError) and error.hint.count("reason") == most


def test_the_block_of_a_heic_file():
    """EXIF data in the file's items: an entry behind the longest block is not read."""
    for before, read in ((exif.LONGEST_BLOCK - 60, True), (exif.LONGEST_BLOCK, False)):
        tiff = b"II*\0" + (8 + before).to_bytes(4, "little") + bytes(before)
        tiff += b"\1\0" + (0x0112).to_bytes(2, "little") + b"\3\0\1\0\0\0\6\0\0\0" + bytes(4)
        data = b"\0\0\0\x18ftypheic" + b"Exif\0\0" + tiff
        assert (exif.read_exif(data).orientation == 6) == read


def test_an_entry_of_an_archive_that_claims_too_much(tmp_path, monkeypatch):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("a.png", bytes(100))
    monkeypatch.setattr(sources, "archive_of", lambda _: path)
    for size, read in ((100, True), (99, False)):
        monkeypatch.setattr(sources, "MOST_UNPACKED", size)
        if read:
            assert len(sources.read_bytes(path / "a.png")) == 100
        else:
            with pytest.raises(Exception, match="unpacked"):
                sources.read_bytes(path / "a.png")
    monkeypatch.setattr(pages, "_count", lambda *_: 7)
    with zipfile.ZipFile(path) as opened:
        for size, count in ((100, 7), (99, 1)):
            monkeypatch.setattr(pages, "MOST_UNPACKED", size)
            assert pages.page_count_in(opened, "a.png") == count
