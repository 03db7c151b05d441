import numpy as np
import pytest

from camcal.detect import edge_model as model
from camcal.detect.lattice import Lattice, predicted
from camcal.detect.local_map import board_from_corners
from camcal.detect.shading import slopes
from camcal.detect.windows import LARGEST, cut, nested


def bent(board):
    """A strong lens: perspective, then a radial cubic."""
    x, y = board[..., 0] - 4, board[..., 1] - 2.5
    w = 1 + 0.04 * x - 0.03 * y
    u, v = x / w, y / w
    r = 1 - 0.004 * (u * u + v * v)
    return np.stack([320 + 40 * u * r, 240 + 40 * v * r], -1)


def test_local_map_straightens_a_strong_lens():
    board = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1)
    uv = bent(board)
    uv[2, 3] = np.nan
    present = np.isfinite(uv[..., 0])
    to_board = board_from_corners(uv)
    offset = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 5)), -1).reshape(-1, 2)
    around = board[present][:, None] + offset
    found = to_board(bent(around))
    straight = found - found[:, 12:13]
    error = np.abs(straight - offset).max(2)
    inside = ((around >= 0) & (around <= [8, 5])).all(2)
    assert np.median(error.max(1)) < 5e-3
    # polynomials of the fourth degree through 6x6 corners follow a distortion of 9 % to .02 squares at the board's
    # ends; beyond them they are extrapolated, which the narrower windows there allow for
    assert error[inside].max() < 0.025 and error.max() < 0.15


def test_missing_corners_are_predicted():
    board = np.stack(np.meshgrid(np.arange(7.0), np.arange(6.0)), -1)
    uv = bent(board)
    holes = uv.copy()
    holes[2, 3] = holes[0, 0] = np.nan
    guess = predicted(holes, np.array([2, 0]), np.array([3, 0]))
    assert np.linalg.norm(guess[0] - uv[2, 3]) < 1.0  # px, of 40 a square
    assert np.linalg.norm(guess[1] - uv[0, 0]) < 4.0


def test_stray_rows_are_cut():
    uv = np.full((6, 9, 2), 1.0)
    uv[0, 2:] = np.nan
    uv[:, 8] = np.nan
    uv[1, 8] = 1.0
    assert Lattice(uv).trimmed().size == (8, 5)


def test_slopes_of_the_light():
    rng = np.random.default_rng(0)
    uv = rng.uniform(0, 600, (54, 2))
    white = 200 + 0.05 * uv[:, 0] - 1e-4 * uv[:, 1] ** 2
    black = 30 + 0.01 * uv[:, 0]
    offset, contrast = (white + black) / 2, (white - black) / 2
    contrast[5] += 40  # a reflection
    sound = np.arange(54) != 5
    found = slopes(uv, offset, contrast, np.ones(54, bool))
    assert np.abs(found[sound, 0, 0] - 0.05).max() < 0.01
    assert np.abs(found[sound, 0, 1] + 2e-4 * uv[sound, 1]).max() < 0.02
    assert np.abs(found[sound, 1, 0] - 0.01).max() < 0.01


def test_windows_hold_the_edges_and_nothing_twice():
    gray = np.arange(100 * 120, dtype=np.uint16).reshape(100, 120)
    uv = np.array([[40.3, 50.7], [3.0, 50.0], [60.0, 60.0]])
    sides = np.array([[[20, 3], [-6, 18]], [[20, 3], [-6, 18]], [[200, 0], [0, 200]]], float)
    windows = cut(gray, uv, sides, 0.4, 3.0)
    for k in range(3):
        q = windows.q[k][:, windows.counts[k]]
        pixels = q.T + uv[k]
        assert np.abs(pixels - np.rint(pixels)).max() < 1e-4
        assert len(np.unique(np.rint(pixels), axis=0)) == len(pixels)
        column, row = np.rint(pixels).astype(int).T
        assert (windows.value[k, windows.counts[k]] == gray[row, column]).all()
        share = np.linalg.solve(sides[k].T, q)
        assert np.abs(share).max() < 0.4
    assert windows.inside[0] == 1 and windows.inside[1] < 0.8
    assert np.abs(windows.q[2][:, windows.counts[2]]).max() <= LARGEST + 1
    # every pixel of the parallelogram that lies within reach of an edge is there
    rows, columns = np.mgrid[:100, :120]
    q = np.stack([columns - uv[0, 0], rows - uv[0, 1]]).reshape(2, -1)
    share = np.abs(np.linalg.solve(sides[0].T, q))
    per_square = 1 / np.linalg.norm(np.linalg.inv(sides[0].T), axis=1)
    near = (share < 0.4).all(0) & (share * per_square[:, None] < 3.0).any(0)
    assert windows.counts[0].sum() >= near.sum()


def test_windows_of_several_sizes_hold_what_each_holds_alone():
    gray = np.arange(100 * 120, dtype=np.uint16).reshape(100, 120)
    uv = np.array([[40.3, 50.7], [3.0, 50.0], [60.0, 60.0]])
    sides = np.array([[[20, 3], [-6, 18]], [[20, 3], [-6, 18]], [[71.3, 0.2], [0.1, 70.9]]], float)
    shares = np.array([[0.3, 0.3, 0.1], [0.5, 0.3, 0.2], [0.8, 0.4, 0.3]])
    windows, sizes = nested(gray, uv, sides, shares, 3.0)
    for share, size in zip(shares, sizes, strict=True):
        inner, alone = windows.inner(size), cut(gray, uv, sides, share, 3.0, np.inf)
        assert inner.inside == pytest.approx(alone.inside)
        for k in range(3):
            assert sorted(inner.value[k, inner.counts[k]]) == sorted(alone.value[k, alone.counts[k]])


def test_unused_pixels_do_not_pull():
    gray = np.zeros((50, 50), np.uint8)
    windows = cut(gray, np.array([[2.0, 2.0]]), np.array([[[10.0, 0], [0, 10.0]]]), 0.5, 2.0)
    _, jacobian = model.evaluate(windows.q, np.array([[0, 0, 0, np.pi / 2, 100, 50, 1.0]]))
    unused = ~windows.counts[0]
    assert unused.any() and np.abs(jacobian[0, [0, 1, 2, 3, 6]][:, unused]).max() == 0
