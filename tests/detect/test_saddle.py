from functools import partial

import numpy as np
import pytest

from camcal.data.observations import View
from camcal.detect import edge_model, saddle
from camcal.detect.camera_pass import refine_in_windows
from camcal.detect.fit import LEAST_BLUR, SETTLED, approached, first_guess, fit, fit_sizes
from camcal.detect.lattice import Lattice
from camcal.detect.local_map import board_from_corners
from camcal.detect.refine_images import on_board
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.windows import cut, nested
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.study.render import Look, render
from tests.detect import drawing

SIZE = (6, 5)


def scene(**pose):
    h = drawing.homography(
        SIZE, (120.0, 100.0), **{"square": 24, "turn": 0.3, "tilt": 0.5, "about": 0.7} | pose
    )
    true = drawing.corners(SIZE, h)
    lattice = Lattice(true.reshape(SIZE[1], SIZE[0], 2))
    return h, true, lattice.steps().reshape(-1, 2, 2)


def fitted(gray, true, sides, off=0.4, seed=1):
    start = true + np.random.default_rng(seed).uniform(-off, off, true.shape)
    first = saddle.refine(gray, start, sides)
    return first, saddle.sharpen(gray, first.take(first.good), sides[first.good], curved(first, true))


def curved(first, true):
    uv = np.where(first.good[:, None], first.uv, np.nan)
    return board_from_corners(uv.reshape(SIZE[1], SIZE[0], 2))


def test_noise_free_corners_are_exact():
    h, true, sides = scene()
    gray = drawing.light(h, SIZE, (240, 200)).astype(np.float32)
    first, second = fitted(gray, true, sides)
    assert first.good.all() and second.good.all()
    # 4 x 4 samples and their blur are exact to about that
    assert np.linalg.norm(second.uv - true, axis=1).max() < 0.004


def test_covariances_are_true():
    """Over many noisy pictures 95 % of the errors lie in the 95 % ellipses, by the fits' own covariances."""
    h, true, sides = scene()
    inside = []
    for seed in range(12):
        gray = drawing.picture(h, SIZE, noise=4.0, seed=seed)
        _, found = fitted(gray, true, sides, seed=seed)
        error = found.uv - true
        inside.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error) < 5.991)
    assert 0.91 < np.mean(inside) < 0.985  # 360 corners: a standard deviation of 0.0115 around 0.95


def test_uneven_light_does_not_pull_the_corners():
    h, true, sides = scene()
    gray = drawing.light(h, SIZE, (240, 200), blur=1.5, slope=1.0).astype(np.float32)
    first, second = fitted(gray, true, sides)
    error = [np.median(np.linalg.norm(c.uv - true, axis=1)) for c in (first, second)]
    assert error[1] < 0.005 < 4 * error[1] + 0.005 < error[0]


def test_saturated_white_does_not_bias():
    h, true, sides = scene()
    light = drawing.light(h, SIZE, (240, 200), white=290.0)
    gray = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    _, second = fitted(gray, true, sides)
    assert second.good.all() and len(second.uv) == len(true)
    # rounding to whole grey levels leaves 0.002 px
    assert np.median(np.linalg.norm(second.uv - true, axis=1)) < 0.006


@pytest.mark.parametrize(
    ("what", "reason"),
    [("covered", ""), ("border", "border"), ("blur", "blurred"), ("flat", "contrast")],
)
def test_bad_corners_are_rejected_with_a_reason(what, reason):
    pose = {"square": 12.0} if what == "blur" else {}
    h, true, sides = scene(**pose)
    look = {"blur": {"blur": 5.0}, "flat": {"black": 120.0, "white": 121.6}}.get(what, {})
    gray = drawing.picture(h, SIZE, noise=0.3, **look)
    if what == "border":
        shift = true[0] - 3
        origin = np.floor(shift).astype(int)
        gray, true = np.ascontiguousarray(gray[origin[1] :, origin[0] :]), true - origin
    if what == "covered":
        x, y = true[7].astype(int)
        gray[y - 9 : y + 9, x - 14 : x + 1] = 90
    found = saddle.refine(gray, true, sides)
    if what == "covered":
        assert found.reasons[7] and sum(map(bool, found.reasons)) < 6
    elif what == "border":
        assert reason in found.reasons[0] and not found.reasons[14]
    else:
        assert sum(map(bool, found.reasons)) > 20
        assert reason in max(found.reasons, key=found.reasons.count)


def test_four_grey_levels_are_enough():
    h, true, sides = scene()
    gray = drawing.picture(h, SIZE, noise=0.3, black=120.0, white=124.0)
    found = saddle.refine(gray, true, sides)
    error = np.linalg.norm(found.uv - true, axis=1)
    assert found.good.all() and error.max() < 0.5
    # with two grey levels rounding is no noise any more: twice what the fits say
    assert np.median(error / found.sigma) < 2.4


def test_no_corners():
    gray = np.zeros((50, 50), np.uint8)
    assert len(saddle.refine(gray, np.zeros((0, 2)), np.zeros((0, 2, 2))).uv) == 0


def test_sixteen_bits_are_the_same_picture():
    h, true, sides = scene()
    gray = drawing.picture(h, SIZE)
    eight = saddle.refine(gray, true, sides)
    sixteen = saddle.refine(gray.astype(np.uint16) * 200, true, sides)
    assert np.abs(eight.uv - sixteen.uv).max() < 2e-3  # float32 normal equations


def test_fits_stop_within_their_share_of_a_standard_deviation():
    """A first fit within `ROUGH` of them, the final fit within a tenth, measured from fits taken much further."""
    h, true, sides = scene()
    gray = drawing.picture(h, SIZE, noise=4.0, seed=3)
    windows = cut(gray, true + 0.5, sides, saddle.HALF, 3.5)
    start = first_guess(windows, saddle.edge_normals(sides), np.ones(len(true)))
    exact = fit(windows, start, (0.0, 255.0), settled=1e-4)
    sigma = np.sqrt(np.einsum("kii->ki", exact.covariance))
    off = {}
    for settled in (saddle.ROUGH, SETTLED):
        found = fit(windows, start, (0.0, 255.0), settled=settled)
        off[settled] = np.abs((found.params - exact.params)[:, :2] / sigma).max()
        assert found.converged.all()
    assert off[SETTLED] < 0.1 and off[saddle.ROUGH] < saddle.ROUGH
    assert exact.converged.all()


def test_the_blur_keeps_to_what_a_pixel_makes():
    h, true, sides = scene()
    gray = drawing.light(h, SIZE, (240, 200), blur=0.01).astype(np.float32)
    found = saddle.refine(gray, true, sides)
    assert (found.params[:, edge_model.BLUR] >= LEAST_BLUR).all()


@pytest.mark.parametrize(("off", "converged"), [(0.008, True), (0.012, False)])
def test_without_iterations_a_corner_counts_that_has_a_hundredth_of_a_pixel_to_go(
    off, converged, monkeypatch
):
    h, true, sides = scene()
    gray = drawing.picture(h, SIZE, noise=1.0, seed=3)
    windows = cut(gray, true, sides, saddle.HALF, 3.5)
    start = first_guess(windows, saddle.edge_normals(sides), np.ones(len(true)))
    exact = fit(windows, start, (0.0, 255.0), settled=1e-4).params
    monkeypatch.setattr("camcal.detect.fit.ITERATIONS", 0)
    found = fit(windows, exact + off * (np.arange(7) == 0), (0.0, 255.0), settled=1e-6)
    assert (found.converged == converged).all()


@pytest.mark.parametrize("off", [0.02, 0.3])  # within one step of the corners (`SHORT`), and not
def test_windows_of_several_sizes_are_fitted_as_each_alone(off):
    h, true, sides = scene()
    gray = drawing.picture(h, SIZE, noise=3.0, seed=2)
    guess, limits = saddle.edge_normals(sides), (0.0, 255.0)
    start = true + np.random.default_rng(0).uniform(-off, off, true.shape)
    shares = np.repeat([[0.35], [0.5], [0.65]], len(true), 1)
    windows, sizes = nested(gray, start, sides, shares, 4.0)
    begin = first_guess(windows, guess, np.full(len(true), 1.0))
    near, _ = approached(windows.inner(sizes[1]), begin, limits)
    for size, fits in zip(sizes, fit_sizes(windows, sizes, near, limits), strict=True):
        alone = fit(windows.inner(size), begin, limits)
        assert fits.converged.all() and alone.converged.all()
        sigma = np.sqrt(0.5 * np.trace(alone.covariance, axis1=1, axis2=2))
        apart = np.linalg.norm((fits.params - alone.params)[:, :2], axis=1)
        assert (apart < 1.5 * SETTLED * sigma).all()  # where a fit may stop
        assert fits.noise == pytest.approx(alone.noise, rel=0.01)


def photographed(blur, bits, f=330.0):
    """A board seen obliquely through a lens: the second pass over its picture, and the true corners."""
    camera = Camera(lenses.make("opencv5"), np.array([f, f, 160, 120, -0.3, 0.08, 0, 0, 0]), (320, 240))
    board = Checkerboard(5, 4)
    middle, rotation = board.points.mean(0), rotations.exp(np.array([0.7, 0.4, 0.1]))
    pose = Pose(rotation, np.array([-0.6, 0.5, f / 33]) - rotation @ middle)
    gray = render(board.pattern(), camera, pose, Look(blur=blur, bits=bits), samples=8)
    true = camera.project(pose.apply(board.points))
    view = View("", board.points, true + 0.2, None, np.arange(len(true)))
    return refine_in_windows(gray, view, partial(on_board, camera, pose), 1.0, [0.65])[0], true


@pytest.mark.parametrize("blur", [0.8, 1.5])
def test_blur_on_curved_and_oblique_edges_does_not_pull_the_corners(blur):
    """Without noise corners are true to the renderer's own error: perspective and curvature leave no part of blur²."""
    found, true = photographed(blur, 16)
    # with the blur taken on the board it was .005 px at 1.5
    assert np.linalg.norm(found.uv - true, axis=1).max() < 0.0015


def test_sigmas_without_noise_are_neither_too_small_nor_too_large():
    """Rounding to 8 bits and the square pixel are all that is left, and are what the sigmas say."""
    z = []
    for blur, f in ((0.5, 320.0), (0.5, 341.0), (0.8, 330.0), (1.2, 335.0)):
        found, true = photographed(blur, 8, f)
        z.append((found.uv - true) / found.sigma[:, None])
    # 160 numbers: a standard deviation of 0.06 about 1
    assert 0.82 < np.sqrt(np.square(z).mean()) < 1.18
