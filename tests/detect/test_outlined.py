"""Separate squares: their edges are arcs in the picture of a lens, and their corners where arcs meet."""

import numpy as np
import pytest

from camcal.detect import targets
from camcal.detect.outlines import Squares
from camcal.detect.targets import outlined
from tests.detect.scenes import expected, picture, pose, random_view

SQUARES, TAGS = "squares:8x6:12mm:0.8", "aruco-grid:5x7:40mm:0.25:4X4_50"


def fitted(corners):
    count = len(corners)
    return Squares(corners, np.zeros((count, 4, 2, 2)), np.ones(count, bool), np.ones(count), np.ones(count))


def seen_squares(columns, rows, size=12.0):
    """Squares of a board and their corners through a lens, clockwise in the picture."""
    target = targets.make(f"squares:{columns}x{rows}:{size}mm:0.8")
    board = target.points.reshape(-1, 4, 3)[:, [0, 1, 3, 2]]
    seen_by, _ = random_view(target, np.random.default_rng(0))
    where = pose((0.3, -0.2, 0.1), np.array([0, 0, 180.0]) - board.reshape(-1, 3).mean(0))
    return board, lambda points: seen_by.project(where.apply(points.reshape(-1, 3))).reshape(
        points.shape[:2] + (2,)
    )


def test_bows_are_those_of_the_lens():
    board, project = seen_squares(8, 6)
    corners = project(board)
    found = outlined.bows(board[..., :2], fitted(corners))
    after = np.roll(board, -1, 1)
    middle, a, b = project((board + after) / 2), corners, np.roll(corners, -1, 1)
    outward = np.stack([(b - a)[..., 1], (a - b)[..., 0]], -1)
    wanted = ((middle - a) * outward).sum(-1) / np.linalg.norm(outward, axis=-1)
    assert np.abs(wanted).max() > 0.05
    # at the rim of the board a polynomial is least certain; there .004 of .06 px
    assert np.abs(found - wanted).max() < 0.1 * np.abs(wanted).max()


@pytest.mark.parametrize(("count", "known"), [(8, True), (7, False)])
def test_few_corners_show_no_bow(count, known):
    """A polynomial of the third degree has ten terms, and is asked of 30 corners: 8 squares have 32, and 7 have 28."""
    board, project = seen_squares(4, 2)
    assert outlined.bows(board[:count, :, :2], fitted(project(board[:count]))).any() == known


@pytest.mark.parametrize("spec", [SQUARES, TAGS])
def test_corners_are_where_the_edges_would_meet_without_the_lens(spec):
    """With straight edges they are off by .04 to .06 px along the radius, which no neighbour contradicts."""
    target, off = targets.make(spec), []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        seen_by, where = random_view(target, rng, tilt=(0.0, 20.0), fill=(0.8, 0.95), roll=10.0)
        found = target.find(picture(target, seen_by, where, rng, noise=0.5))
        true = expected(target, seen_by, where, found.point_ids)
        outward = true - true.mean(0)
        far = np.linalg.norm(outward, axis=1) > 100
        radial = ((found.uv - true) * outward).sum(1) / np.linalg.norm(outward, axis=1)
        off.append(float(radial[far].mean()))
    assert np.abs(np.mean(off)) < 0.006, off
