"""Boards in pictures of other kinds: motion blur, glare, no anti-aliasing, little contrast, 16 bits with an offset."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from camcal.detect import edge_model as model
from camcal.detect import saddle
from camcal.detect.aliasing import grey_limits, with_sampling
from camcal.detect.blur_shape import as_seen, rounded, shape_of
from camcal.detect.edge_blur import edge_blur
from camcal.detect.fit import Fits
from camcal.detect.lattice import Lattice
from camcal.detect.pyramid import SOMETHING, WEAK, as_float, grey_range, noise, to_8_bits
from camcal.detect.shading import with_slopes
from camcal.detect.targets.base import Detection
from camcal.detect.targets.checkerboard import Checkerboard, find_any
from camcal.detect.windows import Windows, cut
from tests.detect import drawing

SIZE, SHAPE = (7, 6), (260, 230)


def scene(**pose):
    usual = {"square": 24, "turn": 0.25, "tilt": 0.4, "about": 0.8}
    h = drawing.homography(SIZE, (130, 115), **usual | pose)
    return h, drawing.corners(SIZE, h)


def smeared(values, length, direction):
    """Motion of constant speed, `length` px in a direction (degrees)."""
    reach = int(np.ceil(length / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    c, s = np.cos(np.deg2rad(direction)), np.sin(np.deg2rad(direction))
    for t in np.linspace(-length / 2, length / 2, 400):  # shared out over the four nearest pixels
        x, y = reach + t * c, reach + t * s
        i, j = int(x), int(y)
        for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
            kernel[j + dj, i + di] += (1 - abs(x - i - di)) * (1 - abs(y - j - dj))
    return cv2.filter2D(values, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)


def noisy(values, noise=1.0, seed=0):
    values = values + np.random.default_rng(seed).normal(0, noise, values.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def errors(found, true):
    assert isinstance(found, Detection), found
    last = len(true) - 1
    every = (
        np.linalg.norm(found.uv - true[ids], axis=1) for ids in (found.point_ids, last - found.point_ids)
    )
    return min(every, key=np.median)


@pytest.mark.parametrize("direction", [0, 14, 60, 104, 150])
@pytest.mark.parametrize("length", [6, 9, 12])
def test_motion_blur(direction, length):
    """Motion by half a square hides a corner of 42 at most, and moves none by more than a hundredth of it."""
    h, true = scene()
    found = Checkerboard(*SIZE).find(noisy(smeared(drawing.light(h, SIZE, SHAPE), length, direction)))
    error = errors(found, true)
    assert len(found) >= len(true) - (length == 12)
    assert np.median(error) < 0.02 and error.max() < 0.01 * length


@pytest.mark.parametrize("blur", [0.6, 1.5, 3.0])
def test_blur_of_edges(blur):
    h, true = scene()
    gray = noisy(drawing.light(h, SIZE, SHAPE, blur=blur), 4.0)
    for seen in edge_blur(gray, Lattice(true.reshape(SIZE[1], SIZE[0], 2))):
        # of the pixel's own area as well; bilinear samples add some hundredths
        assert seen == pytest.approx(np.hypot(blur, np.sqrt(1 / 12)), rel=0.1)


def test_shape_of_a_blur():
    sides = np.array([[[20.0, 3.0], [-4.0, 18.0]]])
    assert shape_of((1.0, 1.29), sides) is None and shape_of((1.31, 1.0), sides) is not None
    assert shape_of((0.0, 2.0), sides) is None  # no edge was seen one way
    shape = shape_of((3.0, 1.0), sides)
    assert np.linalg.det(shape) == pytest.approx(1)
    inverse = np.linalg.inv(shape @ shape)  # S but for its size
    across = [n @ inverse @ n / (n @ n) for n in (np.array([-3.0, 20.0]), np.array([-18.0, -4.0]))]
    assert across[0] / across[1] == pytest.approx(9)


def test_fits_in_coordinates_of_a_round_blur_are_brought_back():
    gray = np.zeros((60, 60), np.uint8)
    sides = np.array([[[10.0, 1.0], [-2.0, 12.0]]])
    windows = cut(gray, np.array([[30.2, 29.7]]), sides, 0.5, 3.0)
    shape = shape_of((3.0, 1.0), sides)
    turned, seen = rounded(windows, sides, shape)
    params = np.array([[0.3, -0.2, *saddle.edge_normals(seen)[0], 100, 50, 1.0]])
    fits = Fits(params, np.eye(2)[None], np.ones(1), np.ones(1, bool))
    back = as_seen(fits, shape)
    assert shape @ back.params[0, :2] == pytest.approx(params[0, :2])
    off = (back.params[:, 2:4] - saddle.edge_normals(sides) + np.pi / 2) % np.pi - np.pi / 2
    assert np.abs(off).max() < 1e-12
    assert shape @ back.covariance[0] @ shape.T == pytest.approx(np.eye(2))
    assert (turned.q[0][:, ~turned.counts[0]] == windows.q[0][:, ~windows.counts[0]]).all()


def test_glare_is_in_the_sigma_of_the_corners_beside_it():
    h, true = scene()
    y, x = np.mgrid[: SHAPE[1], : SHAPE[0]]
    spot = 400 * np.exp(-(((x - true[17, 0]) / 22) ** 2 + ((y - true[17, 1]) / 16) ** 2) / 2)
    found = Checkerboard(*SIZE).find(noisy(drawing.light(h, SIZE, SHAPE) + spot))
    error = errors(found, true)
    assert len(found) >= 30 and error.max() > 0.1  # there is something to say
    assert (error < 4 * found.sigma + 0.05).all()
    assert np.median(found.sigma) < 0.02  # and the others do not suffer


def test_two_grey_levels():
    """Pictures without anti-aliasing: each corner has a finite sigma that is about right."""
    h, true = scene()
    gray = np.where(
        drawing.light(h, SIZE, SHAPE, blur=0.0, black=0.0, white=255.0, background=255.0) > 127, 255, 0
    )
    found = Checkerboard(*SIZE).find(gray.astype(np.uint8))
    error = errors(found, true)
    assert len(found) == len(true) and np.isfinite(found.sigma).all() and (found.sigma > 0.01).all()
    assert np.median(error) < 0.15 and error.max() < 0.6


def test_a_picture_without_noise_has_no_sigma_of_nothing():
    gray = np.kron(np.indices((8, 9)).sum(0) % 2, np.ones((24, 24))) * 200 + 20
    found = find_any(np.pad(gray, 20, constant_values=120).astype(np.uint8))
    assert found[0] == (8, 7)
    assert (found[2].sigma > 0).all() and np.isfinite(found[2].sigma).all()


@pytest.mark.parametrize("bits", [8, 16])
def test_four_grey_levels(bits):
    h, true = scene()
    values = drawing.light(h, SIZE, SHAPE, black=100.0, white=104.0, background=102.0)
    values = values + np.random.default_rng(1).normal(0, 0.3, values.shape)
    gray = (
        np.rint(values).astype(np.uint8)
        if bits == 8
        else np.rint(29500 + 40 * (values - 98)).astype(np.uint16)
    )
    error = errors(Checkerboard(*SIZE).find(gray), true)
    assert len(error) >= 40 and np.median(error) < 0.12


def test_sixteen_bits_are_stretched_to_what_is_there():
    rng = np.random.default_rng(0)
    gray = rng.integers(29500, 29721, (300, 400)).astype(np.uint16)
    gray[5, 7], gray[100, 30] = 0, 65535  # dead pixels
    low, high = grey_range(gray)
    assert 29500 <= low < 29505 and 29715 < high <= 29720
    assert np.percentile(to_8_bits(gray), (1, 99)) == pytest.approx([2.5, 252.5], abs=3)
    assert as_float(gray, (low, high))[50, 50] == pytest.approx(
        (gray[50, 50] - low) * 255 / (high - low), abs=1e-3
    )
    assert grey_range(np.full((4, 4), 7, np.uint16)) == (7.0, 8.0)
    assert grey_range(np.full((4, 4), 7, np.uint8)) == (0.0, 255.0)


def test_an_aliased_edge_is_undetermined_between_the_rows_that_it_crosses():
    fits = Fits(np.zeros((1, 7)), np.zeros((1, 2, 2)), np.ones(1), np.ones(1, bool))
    along = with_sampling(fits, np.array([[[20.0, 0.0], [0.0, 20.0]]])).covariance[0]
    assert along == pytest.approx(np.eye(2) / 12, abs=2e-3)
    # over its 40 px the edge along x crosses 4 rows
    slanted = with_sampling(fits, np.array([[[20.0, 2.0], [0.0, 20.0]]])).covariance[0]
    assert np.sqrt(slanted[0, 0]) == pytest.approx(1 / np.sqrt(12), abs=4e-3)
    normal = np.array([-2.0, 20.0]) / np.hypot(2, 20)
    assert np.sqrt(normal @ slanted @ normal) == pytest.approx(1 / np.sqrt(12) / 5, rel=0.02)


def test_a_picture_is_aliased_where_hardly_a_pixel_is_grey():
    value = np.where(np.arange(1000) % 2 == 0, 0.0, 255.0).astype(np.float32)[None]
    gray = np.zeros((4, 4), np.uint8)
    for grey, limits in ((40, (-1.0, 256.0)), (60, (0.0, 255.0))):
        seen = value.copy()
        seen[0, :grey] = 100
        windows = Windows(
            np.zeros((1, 2)), np.zeros((1, 2, 1000)), seen, np.ones((1, 1000), bool), np.ones(1)
        )
        assert grey_limits(gray, windows) == limits


def test_a_slope_of_the_shading_counts_from_five_sigmas_on():
    sides = np.broadcast_to(np.array([[20.0, 1.0], [-2.0, 19.0]]), (9, 2, 2))
    windows = cut(np.zeros((80, 80), np.uint8), np.full((9, 2), 40.2), sides, 0.5, 4.0)
    params = np.tile([0.0, 0, *saddle.edge_normals(sides)[0], 120, 60, 1.2], (9, 1))
    value = model.evaluate(windows.q, params)[0]
    value[-1] += np.where(windows.counts[-1], 0.4 * windows.q[-1, 0], 0)
    windows = replace(windows, value=value)
    noise = np.r_[np.full(8, 1.0), 3.0]

    def added(sigma):
        fits = Fits(params, sigma**2 * np.broadcast_to(np.eye(2), (9, 2, 2)), noise, np.ones(9, bool))
        more = np.trace(
            with_slopes(windows, fits, (0.0, 255.0)).covariance - fits.covariance, axis1=1, axis2=2
        )
        assert (more[:-1] == 0).all()
        return np.sqrt(more[-1])

    move = added(1e-6)
    assert 0.02 < move < 0.5
    assert added(move / 5.2) == pytest.approx(move) and added(move / 4.8) == 0


def test_noise_is_measured_beside_edges():
    rng = np.random.default_rng(4)
    for sigma in (0.7, 3.0, 12.0):
        gray = np.kron(np.indices((30, 40)).sum(0) % 2, np.ones((10, 10))) * 100 + 80
        gray = np.clip(np.rint(gray + rng.normal(0, sigma, gray.shape)), 0, 255).astype(np.uint8)
        assert noise(gray) == pytest.approx(np.hypot(sigma, np.sqrt(1 / 12)), rel=0.25)
        assert noise(gray.astype(np.uint16) * 40) == pytest.approx(40 * noise(gray), rel=0.01)


@pytest.mark.parametrize("step, stretched", [(WEAK - 2, True), (WEAK + 1, False)])
def test_a_small_range_is_stretched(step, stretched):
    gray = np.full((80, 80), 90, np.uint8)
    gray[:, 40:] += np.uint8(step)
    made = to_8_bits(gray)
    assert bool(made.min() == 0 and made.max() == 255) == stretched
    assert (made is gray) == (not stretched)


@pytest.mark.parametrize("times, stretched", [(0.5 * SOMETHING, False), (1.7 * SOMETHING, True)])
def test_noise_alone_is_not_stretched(times, stretched):
    """The ramp has a range of so many standard deviations; noise widens the range by about 2 of them."""
    ramp = np.linspace(0, times * 4.0, 300)[None] + np.random.default_rng(2).normal(0, 4.0, (200, 300))
    gray = np.rint(100 + ramp).astype(np.uint8)
    assert (to_8_bits(gray) is not gray) is stretched
    covered = np.rint(np.random.default_rng(3).normal(3, 1.2, (200, 300))).clip(0).astype(np.uint8)
    assert to_8_bits(covered) is covered
