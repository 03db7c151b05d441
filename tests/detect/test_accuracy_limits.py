"""Numbers on which only accuracy and work depend, not what is found.

The result with each of them is that of a finer value within the tolerance, a part of what noise does to it, and that of
a much coarser one is not.
"""

import importlib
from functools import cache

import cv2
import numpy as np
import pytest

from camcal.detect import (
    aliasing,
    camera_pass,
    candidates,
    disc_fit,
    discs,
    edge_blur,
    fit,
    line_points,
    local_map,
    marked_grid,
    matches,
    motion_blur,
    outlines,
    pyramid,
    quality,
    saddle,
    segment_fit,
    squares,
    view_information,
    windows,
)
from camcal.detect.fit import Fits
from camcal.detect.lattice import Lattice
from camcal.detect.targets import circles, tag_board
from camcal.detect.targets.base import Miss
from camcal.geometry import rotations
from camcal.model.pose import Pose
from tests.detect import drawing
from tests.detect.scenes import make, straight_camera
from tests.detect.test_limits_edges import dark_square
from tests.sides import same_with_finer_and_not_with_coarser

SIZE = (7, 5)


@cache
def board(blur=1.0, noise=0.0, square=16):
    """A tilted checkerboard and its corners (5, 7, 2)."""
    h = drawing.homography(SIZE, (80, 60), square, turn=0.2, tilt=0.5)
    gray = drawing.light(h, SIZE, (160, 120), blur=blur)
    gray = gray + np.random.default_rng(0).normal(0, 1, gray.shape) * noise
    return gray.astype(np.float32), drawing.corners(SIZE, h).reshape(*SIZE[::-1], 2)


def blur_of_edges():
    gray, uv = board()
    return np.array(edge_blur.edge_blur(gray, Lattice(uv)))


def directions():
    """Of the four edges of the corners, radians."""
    rays = candidates.find_candidates(board()[0]).marks.rays
    return np.arctan2(rays[..., 1], rays[..., 0])


def sides_by_fisheye():
    uv = np.array([[30.0, 40.0], [100.0, 20.0]])
    sides, _ = camera_pass._sides(uv, lambda p: p * (0.05 + 1e-6 * np.square(p).sum(-1, keepdims=True)), 1.0)
    return sides


def bent_corners():
    """The map of a distorted grid, beside its corners."""
    x = np.stack(np.meshgrid(np.arange(7.0), np.arange(6.0)), -1) - 3
    uv = 200 + 20 * x * (1 - 0.004 * np.square(x).sum(-1, keepdims=True))
    flat = uv.reshape(-1, 1, 2)
    return local_map.board_from_corners(uv)(flat + [[0, 0], [8, 3], [-4, 6]])


def first_fits():
    gray, uv = board(noise=3.0)
    lattice = Lattice(uv)
    sides, at = lattice.steps().reshape(-1, 2, 2), uv.reshape(-1, 2)
    return saddle.refine(gray.astype(np.uint8), at, sides)


def sharpened():
    gray, uv = board(noise=3.0, square=32)
    lattice = Lattice(uv)
    sides = lattice.steps().reshape(-1, 2, 2)[[16, 17, 18]]
    known = saddle.placed(uv.reshape(-1, 2)[[16, 17, 18]] + 0.2, sides, 1.0)
    return saddle.sharpen(gray.astype(np.uint8), known, sides, lambda p: p, 0.6).uv


def motion():
    gray, uv = board(noise=3.0)
    smeared = cv2.blur(gray, (5, 1)).astype(np.uint8)
    lattice = Lattice(uv)
    sides = lattice.steps().reshape(-1, 2, 2)
    fits = saddle.refine(smeared, uv.reshape(-1, 2), sides)
    return np.array(motion_blur.blur_ellipse(*motion_blur.corner_blurs(smeared, fits.uv, fits.params, sides)))


def motion_from_afar():
    """As `motion`, from fits whose blur is wrong."""
    gray, uv = board()
    sides = Lattice(uv).steps().reshape(-1, 2, 2)
    fits = saddle.refine(gray.astype(np.uint8), uv.reshape(-1, 2), sides)
    params = fits.params.copy()
    params[:, 6] *= 2.5
    return motion_blur.corner_blurs(gray, fits.uv, params, sides)[1]


@cache
def disc_picture(noise=2.0):
    v, u = np.mgrid[:120, :120]
    gray = 190 - 130 / (1 + np.exp((np.hypot((u - 60.3) / 1.2, v - 59.6) - 22) / 0.8))
    return np.clip(gray + noise * np.random.default_rng(1).normal(size=gray.shape), 0, 255).astype(np.uint8)


def disc():
    made = discs.Discs(np.array([[61.0, 59.0]]), np.diag([27.0, 21.5])[None])
    return disc_fit.fit_discs(disc_picture(), made).discs.centre


def disc_from_afar():
    """From an outline that is off by 2 px."""
    made = discs.Discs(np.array([[62.0, 59.0]]), np.diag([28.4, 24.0])[None])
    fitted = disc_fit.fit_discs(disc_picture(), made, 0.5)
    return np.r_[fitted.discs.centre[0], fitted.discs.radius, fitted.good]


def small_discs():
    """How many of twelve small discs of a small picture one small window finds."""
    v, u = np.mgrid[:90, :120]
    gray = np.full(u.shape, 180.0)
    for x in range(15, 120, 30):
        for y in range(15, 90, 30):
            gray -= 24 * np.clip(4.1 - np.hypot(u - x, v - y), 0, 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discs, "WINDOWS", discs.WINDOWS[:1])
        return np.array(len(discs.find_discs(gray.astype(np.uint8))))


def noisy_discs():
    gray = cv2.resize(disc_picture(50.0), (40, 40), interpolation=cv2.INTER_NEAREST)
    return np.array(len(discs.find_discs(np.tile(gray, (3, 3)))))


def apparent_shift():
    target = make("circles:3x3:20mm:16mm")
    pose = Pose(rotations.exp(np.array([0.8, 0.2, 0])), np.array([-20.0, -10, 90]))
    return target.apparent_shift(straight_camera(), pose, np.arange(9))


def small_marker():
    """Cells of 3 px of a marker that does not lie on whole pixels."""
    cells = np.random.default_rng(0).integers(0, 2, (6, 6)).astype(float)
    fine = cv2.GaussianBlur(np.kron(cells, np.ones((30, 30))), (0, 0), 5)
    gray = cv2.resize(
        np.pad(fine, 66, constant_values=1.0), None, fx=0.1, fy=0.1, interpolation=cv2.INTER_AREA
    )
    low, high = 6.6 - 0.5, 24.6 - 0.5
    uv = np.array([[[low, low], [high, low]], [[low, high], [high, high]]])
    code = cells - cells.mean()
    found = marked_grid.sample_squares(255 * gray.astype(np.float32), uv, 1.0, 6)[0, 0]
    return np.array((found * code).sum() / np.linalg.norm(code))


def square_corners(blur=1.0, off=0.0, rounds=None):
    gray, quads = dark_square()
    gray = cv2.GaussianBlur(gray, (0, 0), blur) + np.random.default_rng(0).normal(0, 2, gray.shape)
    rounds = outlines.ROUNDS if rounds is None else rounds
    return outlines.refine_squares(gray.astype(np.uint8), quads + off, np.array([20.0]), None, rounds).corners


def square_from_afar():
    """Only two of its corners are off, so that its sides are turned."""
    return square_corners(off=np.array([[2.0, -1.5], [0, 0], [-1.0, 1.5], [0, 0]]))


def segment():
    v, u = np.mgrid[:200, :200]
    gray = 128 + 60 * np.tanh((0.3 * (u - 100) - (v - 100)) / 1.5)
    gray = (gray + np.random.default_rng(0).normal(0, 15, gray.shape)).astype(np.uint8)
    return segment_fit.refined(gray, np.array([[[40.0, 82.5], [160.0, 117.0]]]))


def thin_lines():
    """Rows of the points on lines 2 and 8 px wide, and on two lines 8 px apart."""
    gray = np.full((120, 60), 200, np.uint8)
    for first, last in ((19, 20), (46, 53), (86, 87), (94, 95)):
        gray[first : last + 1] = 60
    found = line_points.ridges(gray, True, line_points.RIDGE_SIGMA).uv[:, 1]
    apart = np.abs(found[:, None] - [19.5, 49.5, 86.5, 94.5])
    return np.r_[apart.min(0, initial=9), apart.min(1).max(initial=0)]  # a line is found, and nothing else


@cache
def texture():
    rng = np.random.default_rng(0)
    gray = cv2.GaussianBlur(rng.uniform(0, 255, (220, 240)), (0, 0), 2.0)
    return cv2.normalize(gray, None, 20, 235, cv2.NORM_MINMAX)


def matched():
    """Two pictures of different exposure, half a pixel apart."""
    moved = cv2.warpAffine(texture(), np.array([[1, 0, 0.5], [0, 1, 0.0]]), (240, 220), flags=cv2.INTER_CUBIC)
    shade = np.linspace(0.4, 1.0, 240)
    a, b = matches.matches(texture().astype(np.uint8), (moved * shade).astype(np.uint8))
    return np.abs(np.median(b - a, 0) - (0.5, 0)) + np.std(b - a, 0)


def grey_range():
    return np.array(pyramid.grey_range(texture16()))


@cache
def texture16():
    gray = np.random.default_rng(0).normal(30_000, 3000, (1500, 1500))
    return np.clip(gray, 0, 65535).astype(np.uint16)


def exposure():
    gray = (texture16() // 100).astype(np.uint8)
    gray[:, :700] = 255
    return np.array(quality._exposure(gray, np.array([[0.0, 0.0], [1499.0, 1499.0]]))["saturated"])


def choice_of_views():
    rng = np.random.default_rng(0)
    gains = [1e6 * (a @ a.T) for a in rng.normal(size=(9, 5, 2))]
    return np.array(view_information.chosen_views(gains, 5, lambda *_: False)[0])


def shared_boards(noise=0.0):
    """How many points of a board are found of which the markers on one side were read."""
    target = make("charuco:8x6:1mm:0.5mm:4X4_50")
    h = drawing.homography((7, 5), (80, 60), 16)
    gray = drawing.light(h, (7, 5), (160, 120), blur=0.7).astype(np.uint8)
    uv = drawing.corners((7, 5), h)
    known = np.flatnonzero(np.arange(35) % 7 < 2)
    jacobian = np.repeat(16 * np.eye(2)[None], len(known), 0)
    found = target.grown(gray, known, uv[known], jacobian, {})
    return np.array(0 if isinstance(found, Miss) else len(found))


#: module.NAME: (coarse, fine, tolerance, example)
LIMITS = {
    "edge_blur.SAMPLES": (5, 129, 0.03, blur_of_edges),
    "edge_blur.ACROSS": (0.9, 0.4, 0.05, blur_of_edges),
    "edge_blur.ENDS": (16, 2, 0.03, blur_of_edges),
    "candidates.SPACING": (12.0, 0.4, 0.02, directions),
    "camera_pass.STEP": (30.0, 0.05, 1e-3, sides_by_fisheye),
    "local_map.RIDGE": (1e-2, 1e-12, 1e-6, bent_corners),
    "saddle.ENOUGH": (8, 10**6, 2e-4, sharpened),
    "motion_blur.MOST_CORNERS": (2, 35, 0.02, lambda: motion()[:1]),
    "motion_blur.LARGEST": (2, 24, 0.02, lambda: motion()[:1]),
    "motion_blur.STEPS": (1, 20, 1e-2, motion_from_afar),
    "disc_fit.BAND": (0.1, 5.0, 0.02, disc),
    "disc_fit.START_ERROR": (-1.2, 2.0, 0.01, disc_from_afar),
    "discs.LEAST_WINDOW": (1, 24, 0, small_discs),
    "discs.BLUR": (0.01, 1.2, 0, noisy_discs),
    "circles.CONTOUR": (6, 512, 1e-5, apparent_shift),
    "marked_grid.PER_CELL": (1, 9, 0.01, small_marker),
    "outlines.STEP": (3.0, 0.1, 0.02, square_corners),
    "outlines.PLATEAUS": (1, 8, 0.02, square_corners),
    "outlines.ROUNDS": (1, 6, 5e-3, square_from_afar),
    "segment_fit.STEP": (2.5, 0.05, 0.02, segment),
    "segment_fit.BLUR": (0.1, 1.2, 0.012, segment),
    "line_points.RIDGE_SIGMA": (6.0, 1.8, 0.3, thin_lines),
    "matches.EVEN": (0.5, 12.0, 0.01, matched),
    "matches.DEVIATION": (0.2, 36.0, 0.02, matched),
    "pyramid.SAMPLES": (300, 10**7, 200, grey_range),
    "quality.SAMPLES": (300, 10**7, 2e-3, exposure),
    "view_information.PRIOR": (1e-4, 10.0, 0, choice_of_views),
    "targets.tag_board.ROUNDS": (1, 16, 0, shared_boards),
}


@pytest.mark.parametrize("name", LIMITS)
def test_finer_is_the_same_and_coarser_is_not(monkeypatch, name):
    module, _, constant = name.rpartition(".")
    owner = circles if module == "circles" else importlib.import_module(f"camcal.detect.{module}")
    same_with_finer_and_not_with_coarser(monkeypatch, owner, constant, *LIMITS[name])


# ------------------------------------------------------------------------------------ exact ones
def test_interpolation_blurs_edges():
    """The blur is that of the picture, once the variance that linear interpolation adds is taken off."""
    for blur in (0.7, 1.0):
        gray, uv = board(blur)
        assert edge_blur.edge_blur(gray, Lattice(uv)) == pytest.approx((blur,) * 2, abs=0.04)


def test_what_a_fit_starts_from(monkeypatch):
    """Neither the percentiles nor the blur from which fits start change what they end at."""
    usual = disc(), shared_boards()
    for dark, bright, blur in ((5, 95, 0.8), (30, 70, 3.0)):
        monkeypatch.setattr(disc_fit, "DARK", dark)
        monkeypatch.setattr(disc_fit, "BRIGHT", bright)
        monkeypatch.setattr(tag_board, "START_BLUR", blur)
        assert disc() == pytest.approx(usual[0], abs=1e-3) and shared_boards() == usual[1] == 35


def test_pixels_processed_at_a_time(monkeypatch):
    usual = first_fits()
    for count in (1, 10**9):
        monkeypatch.setattr(fit, "CACHED", count)
        np.testing.assert_allclose(first_fits().uv, usual.uv, atol=1e-6)


def test_positions_sampled_at_a_time(monkeypatch):
    """More than cv2 takes at once are sampled in parts."""
    gray = texture().astype(np.float32)
    at = np.random.default_rng(0).uniform(10, 200, (70_000, 2))
    assert np.isfinite(squares._sample(gray, at)).all()
    monkeypatch.setattr(squares, "MOST_AT_ONCE", 40_000)
    with pytest.raises(cv2.error):
        squares._sample(gray, at)


def test_positions_along_an_edge():
    """Six determine a curve of the fifth degree."""
    t = windows.ALONG
    curve = 0.1 * t**2 - 0.05 * t**3 + 0.02 * t**4 + 0.03 * t**5
    beside = np.stack([-curve - windows.BESIDE, -curve + windows.BESIDE])[None]
    np.testing.assert_allclose(windows._curve(beside), [[0.1, -0.05, 0.02, 0.03]], atol=1e-12)
    assert len(t) >= 6


@pytest.mark.parametrize("reach", [3.0, 100.0])
def test_pixels_of_windows(reach):
    """All pixels of a window that are near an edge, whatever tiles they were searched in; the others do not count."""
    gray, uv = board()
    at, sides = uv[2, 3][None] + 0.3, Lattice(uv).steps()[2, 3][None]
    cut = windows.cut(gray, at, sides, 0.45, reach)
    v, u = np.mgrid[: gray.shape[0], : gray.shape[1]]
    place = np.stack([u - at[0, 0], v - at[0, 1]], -1) @ np.linalg.inv(0.45 * sides[0])
    scale = np.linalg.norm(np.linalg.inv(0.45 * sides[0]).T, axis=1)
    inside = (np.abs(place) < 1).all(-1) & (np.abs(place) < reach * scale).any(-1)
    assert cut.counts.sum() == inside.sum()
    assert sorted(cut.value[cut.counts].tolist()) == sorted(gray[inside].tolist())
    assert (cut.value[~cut.counts] == windows.UNUSED).all()
    assert (cut.q[:, :, ~cut.counts[0]] == windows.FAR).all()


def test_edges_of_an_aliased_picture():
    """An edge along the pixels may lie anywhere between two rows; one across n of them within 1 / (n + 1)."""
    fits = Fits(np.zeros((1, 7)), np.zeros((1, 2, 2)), np.zeros(1), np.ones(1, bool))
    along = aliasing.with_sampling(fits, 8 * np.eye(2)[None]).covariance[0]
    np.testing.assert_allclose(along, aliasing.UNIFORM**2 * np.eye(2))
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    across = aliasing.with_sampling(fits, 8 * turn[None]).covariance[0]
    crossed = 2 * 8 * np.sin(0.3)
    assert np.sqrt(across[0, 0]) == pytest.approx(aliasing.UNIFORM / (1 + crossed))
