"""Parts of pictures that are kept for the second pass."""

import numpy as np
import pytest

from camcal.detect import part as parts
from camcal.detect.camera_pass import LARGEST, LONGER, SLACK, margin
from camcal.detect.part import Kept, OutsideError, around, span, values, white
from tests.sides import LESS, MORE

GRAY = np.arange(30 * 40, dtype=np.uint16).reshape(30, 40)


def test_a_part_has_the_pixels_of_its_picture():
    part = around(GRAY, np.array([[10.2, 8.0], [20.0, 15.5]]), 2.0)
    assert (part.left, part.top, part.pixels.shape, part.shape) == (8, 6, (13, 15), (30, 40))
    row, column = np.divmod(np.arange(13 * 15), 15)
    row, column, used = row + 6, column + 8, np.ones(13 * 15, bool)
    np.testing.assert_array_equal(values(part, column, row, used), values(GRAY, column, row, used))
    assert (white(part), span(part)) == (white(GRAY), span(GRAY))


@pytest.mark.parametrize(("column", "row"), [(7, 10), (23, 10), (10, 5), (10, 19)])
def test_pixels_beyond_a_part_are_noticed(column, row):
    part = around(GRAY, np.array([[10.2, 8.0], [20.0, 15.5]]), 2.0)
    at = np.array([column, 10]), np.array([row, 10])
    with pytest.raises(OutsideError):
        values(part, *at, np.array([True, True]))
    assert (
        values(part, *at, np.array([False, True]))[1] == GRAY[10, 10]
    )  # one that is not used may lie anywhere


def test_parts_end_at_the_border_of_the_picture():
    part = around(GRAY, np.array([[1.0, 1.0], [39.0, 29.0]]), 5.0)
    assert (part.left, part.top, part.pixels.shape) == (0, 0, (30, 40))


def test_parts_are_kept_within_their_limit(monkeypatch):
    part = around(GRAY, np.array([[10.0, 8.0], [19.0, 17.0]]), 0.0)
    monkeypatch.setattr(parts, "KEPT", 2 * part.pixels.nbytes)
    kept = Kept()
    for name in ("one", "two", "three", "one"):
        kept.keep(name, part)
    assert [kept.get(n) is not None for n in ("one", "two", "three")] == [True, True, False] and kept.full
    np.testing.assert_array_equal(kept.get("one").pixels, part.pixels)
    assert not np.shares_memory(kept.get("one").pixels, GRAY)
    kept.begin(3)
    assert kept.get("one") is None and not kept.full and kept.jobs == 3


def test_without_memory_no_part_is_kept(monkeypatch):
    def none_left(*_):
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr(parts.mmap, "mmap", none_left)
    kept = Kept()
    kept.keep("one", around(GRAY, np.array([[10.0, 8.0]]), 3.0))
    assert kept.get("one") is None


def test_the_margin_holds_every_window():
    """Windows of .9 squares, their corners up to the sum of both sides away; at most `LARGEST` along each side."""
    sides = np.array([[[20.0, 5.0], [-5.0, 20.0]]])
    assert margin(sides) == pytest.approx((1 + LONGER) * 0.9 * 25.0 + SLACK)
    diagonal = np.array([[[100.0, 100.0], [100.0, -100.0]]])
    assert margin(diagonal) == pytest.approx((1 + LONGER) * LARGEST * np.sqrt(2) + SLACK)
    along = np.array([[[100.0, 0.0], [99.0, 1.0]]])  # seen along its plane
    assert margin(along) == margin() == pytest.approx(2 * LARGEST + SLACK)
    assert margin(LESS * sides) < margin(sides) < margin(MORE * sides)
