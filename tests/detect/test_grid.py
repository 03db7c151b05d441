"""Marks to grids: numbers, links and the limits at which a link is none."""

import numpy as np
import pytest

from camcal.detect import grid
from camcal.detect.candidates import SPREAD
from camcal.detect.disc_grid import find_board
from camcal.detect.discs import Discs, links


def board(columns=5, rows=4, turn=0.3, bend=0.0, twist=0.0, contrast=None, closed=True):
    """Marks of corners on a turned grid; each ray is off by `bend` rad, those of odd columns by `twist`."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    xy = 20 * np.stack([i, j], -1) @ spin.T + 100
    # the sector behind an even ray is bright: neighbours begin with rays a right angle apart
    angle = turn + bend + twist * (i % 2) + (np.arange(4)[:, None] + (i + j) % 2) * np.pi / 2
    rays = np.stack([np.cos(angle), np.sin(angle)], -1).transpose(1, 0, 2)
    size = np.full(len(xy), 50.0) if contrast is None else contrast(i, j)
    return grid.Marks(xy, rays, size, SPREAD, alternating=True, closed=closed)


def grown(marks, shown=None):
    return grid.grow(*grid.neighbours(marks, shown))


def test_marks_in_any_order_are_numbered_clockwise():
    marks, order = board(), np.random.default_rng(0).permutation(20)
    mixed = grid.Marks(marks.xy[order], marks.rays[order], marks.size, SPREAD, alternating=True, closed=True)
    (index,) = grown(mixed)
    number = order[index]
    assert any(
        (np.rot90(number, k) == np.arange(20).reshape(4, 5)).all()
        for k in range(4)
        if index.shape[k % 2] == 4
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_rays_may_point_past_a_neighbour_a_little(sign):
    assert len(grown(board(bend=sign * 0.38))) == 1
    assert grown(board(bend=sign * 0.42)) == []


def test_neighbours_have_nearly_the_same_contrast():
    def halves(ratio):
        return lambda i, _: np.where(i < 2, 30.0, 30.0 * ratio)

    assert [p.shape for p in grown(board(contrast=halves(3.8)))] in ([(4, 5)], [(5, 4)])
    assert sorted((p >= 0).sum() for p in grown(board(contrast=halves(4.2)))) == [8, 12]


def test_bright_and_dark_change_sides():
    marks = board()
    alike = np.broadcast_to(marks.rays[0], marks.rays.shape)  # even rays meet even rays
    same = grid.Marks(marks.xy, alike, marks.size, SPREAD, alternating=True, closed=True)
    assert grown(same) == []


def test_two_squares_are_the_least():
    assert grown(board(2, 2)) == [] and len(grown(board(3, 2))) == 1


def test_a_mark_beside_the_grid_is_no_part_of_it():
    marks = board(6, 4)
    keep = np.r_[np.arange(24)[np.arange(24) % 6 < 5], 5]  # of the last column only the first mark
    for closed, number in ((True, 20), (False, 21)):
        part = grid.Marks(
            marks.xy[keep], marks.rays[keep], marks.size[keep], SPREAD, alternating=True, closed=closed
        )
        assert [(p >= 0).sum() for p in grown(part)] == [number]


def test_a_link_that_the_picture_does_not_show_divides_a_grid():
    marks = board(6, 4)

    def shown(i, _, j):
        return ~((np.minimum(i, j) % 6 == 2) & (np.abs(i - j) == 1))

    assert sorted((p >= 0).sum() for p in grown(marks, shown)) == [12, 12]


def discs(columns=6, rows=5, hidden=(), stretch=1.0):
    i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
    centre = np.stack([30 * stretch * i, 30 * j], -1) + 50.0
    kept = np.setdiff1d(np.arange(len(centre)), hidden)
    return Discs(centre[kept], np.broadcast_to(9.0 * np.eye(2), (len(kept), 2, 2)))


@pytest.mark.parametrize(("stretch", "number"), [(1.22, 30), (1.33, 0)])
def test_discs_are_as_far_apart_one_way_as_the_other(stretch, number):
    index = grid.grow(*links(discs(stretch=stretch)))
    assert sum((p >= 0).sum() for p in index if min(p.shape) > 1) == number


def test_a_board_of_discs_may_hide_a_fifth():
    hidden = [1, 4, 10, 19, 25, 28]
    found, _ = find_board(discs(hidden=hidden), False, (6, 5), 1.0)
    assert found is not None and len(found.ids) == 24
    assert find_board(discs(hidden=[*hidden, 12]), False, (6, 5), 1.0)[0] is None
