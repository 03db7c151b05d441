"""Rendered pictures against brute force, against areas that are known, and through the corner fit."""

import numpy as np
import pytest

from camcal.detect import saddle
from camcal.detect.black_area import BlackArea
from camcal.detect.targets.base import Pattern
from camcal.study.render import Look, exposure, pixel_rays, render
from tests.detect.scenes import camera, make, pose, straight_camera

PLAIN = Look(blur=0.0, black=0.0, white=255.0, background=128.0)


def brute_force(target, seen_by, cam_from_board, samples):
    """Grey levels by counting samples: every ray by the lens itself, every polygon and disc by itself."""
    width, height = seen_by.image_size
    step = (np.arange(samples) + 0.5) / samples - 0.5
    u = (np.arange(width)[:, None] + step).ravel()
    v = (np.arange(height)[:, None] + step).ravel()
    rays = seen_by.unproject(np.stack(np.meshgrid(u, v), -1))
    back = cam_from_board.inverse()
    direction = rays @ back.rotation.T
    xy = (back.translation + (-back.translation[2] / direction[..., 2])[..., None] * direction)[..., :2]
    pattern = target.pattern()
    x0, y0, x1, y1 = pattern.extent
    paper = ((xy > [x0, y0]) & (xy < [x1, y1])).all(-1)
    black = np.zeros(xy.shape[:2], bool)
    for polygon in pattern.polygons:
        low, high = polygon.min(0), polygon.max(0)
        black |= ((xy > low) & (xy < high)).all(-1)
    for x, y, radius in np.reshape(pattern.circles, (-1, 3)):
        black |= np.hypot(xy[..., 0] - x, xy[..., 1] - y) < radius
    grey = np.where(paper, np.where(black, 0.0, 255.0), 128.0)
    return grey.reshape(height, samples, width, samples).mean((1, 3))


@pytest.mark.parametrize("spec", ["checkerboard:4x3:20mm", "aprilgrid:2x2:30mm:0.3", "circles:4x3:20mm"])
def test_agrees_with_brute_force(spec):
    target = make(spec)
    seen_by = camera((64, 48))
    cam_from_board = pose([0.35, -0.45, 0.3], [-28.0, -18.0, 150.0])
    exact = exposure(target.pattern(), seen_by, cam_from_board, PLAIN)
    counted = brute_force(target, seen_by, cam_from_board, 20)
    # counting 20 x 20 samples errs by up to 1/20 where an edge runs along the samples: 13 of 255 levels
    assert np.abs(exact - counted).max() < 13.0
    assert np.abs(exact - counted).mean() < 0.2


def test_area_of_discs():
    target = make("circles:3x3:20mm:12mm")
    seen_by, cam_from_board = straight_camera(), pose([0, 0, 0], [-20.3, -20.1, 200.0])
    dark = 255.0 - exposure(
        target.pattern(), seen_by, cam_from_board, Look(blur=0, black=0, white=255, background=255)
    )
    # 1 px is 1 mm here; the outline is taken for straight within a quarter of a px: 1e-4 of the area
    assert dark.sum() / 255 == pytest.approx(9 * np.pi * 6**2, rel=2e-4)


def test_corners_without_bias():
    """Blur and no noise: the corners of rendered boards are where they are projected to.

    Seen from the front by a pinhole the fitted model is exact, so nothing but the rendering is measured.
    """
    target = make("checkerboard:5x4:20mm")
    seen_by, rng = straight_camera((240, 200)), np.random.default_rng(0)
    for _ in range(4):
        turn = [0, 0, rng.uniform(0, np.pi)]
        middle = pose(turn, [0, 0, 0]).apply(target.points.mean(0))
        cam_from_board = pose(turn, [*(rng.uniform(-0.5, 0.5, 2) - middle[:2]), 200.0])
        gray = render(target.pattern(), seen_by, cam_from_board, Look(blur=0.8, bits=16))
        truth = seen_by.project(cam_from_board.apply(target.points))
        sides = np.broadcast_to((cam_from_board.rotation[:2, :2] * 20.0).T, (len(truth), 2, 2))
        found = saddle.refine(gray, truth + rng.uniform(-0.3, 0.3, truth.shape), sides)
        assert found.good.all()
        # a thousandth: a pixel's square is not quite the Gaussian that the fit takes it for
        assert np.abs(found.uv - truth).max() < 0.002
        assert np.abs((found.uv - truth).mean(0)).max() < 0.0005


def test_blur_and_noise_are_as_asked():
    target, rng = make("checkerboard:2x2:400mm"), np.random.default_rng(1)
    seen_by, cam_from_board = straight_camera((200, 160)), pose([0, 0, 0], [0.0, 0.0, 400.0])
    look = Look(blur=1.7, black=20.0, white=220.0)
    profile = exposure(target.pattern(), seen_by, cam_from_board, look)[40]
    edge = np.abs(np.diff(profile))
    column = int(np.argmax(edge))
    part = slice(column - 12, column + 13)
    x = np.arange(200)[:-1][part]
    mean = (x * edge[part]).sum() / edge[part].sum()
    variance = ((x - mean) ** 2 * edge[part]).sum() / edge[part].sum()
    # the blur, a pixel's own width once for its area and once for the difference
    assert variance == pytest.approx(1.7**2 + 2 / 12, rel=1e-2)
    clean = exposure(target.pattern(), seen_by, cam_from_board, look)
    noisy = render(target.pattern(), seen_by, cam_from_board, Look(**{**look.__dict__, "noise": 3.0}), rng)
    # 32000 pixels: the standard deviation is known to 0.4 %; rounding adds a variance of 1/12
    assert np.std(noisy - clean) == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.02)


def test_light_and_bits():
    target, seen_by = make("checkerboard:3x3:5mm"), straight_camera()
    cam_from_board = pose([0, 0, 0], [-5, -5, 300.0])
    even = render(target.pattern(), seen_by, cam_from_board, Look(blur=0))
    sloped = render(target.pattern(), seen_by, cam_from_board, Look(blur=0, gradient=0.4, vignetting=0.2))
    deep = render(target.pattern(), seen_by, cam_from_board, Look(blur=0, bits=16))
    assert even.dtype == np.uint8 and deep.dtype == np.uint16
    assert np.abs(deep / 257.0 - even).max() <= 0.51
    assert sloped[60, 5] < even[60, 5] and sloped[60, 155] > sloped[60, 5]


def test_bowed_sheet_meets_its_points():
    """The corner of a bowed sheet is seen where the raised point projects to."""
    target, seen_by = make("checkerboard:5x4:20mm"), straight_camera((240, 200))

    def height(xy):
        return -0.003 * (xy[..., 0] - 40.0) ** 2

    cam_from_board = pose([0.1, 0.25, 0.05], [-40.0, -30.0, 190.0])
    gray = render(target.pattern(), seen_by, cam_from_board, Look(blur=0.8, bits=16), surface=height)
    points = target.points.copy()
    points[:, 2] = height(points[:, :2])
    truth = seen_by.project(cam_from_board.apply(points))
    flat = seen_by.project(cam_from_board.apply(target.points))
    sides = np.broadcast_to(np.diag([20.0, 20.0]), (len(truth), 2, 2))
    found = saddle.refine(gray, truth, sides)
    # edges are slightly curved now, which the fit does not know
    assert np.abs(found.uv - truth)[found.good].max() < 0.05 < np.abs(flat - truth).max()


def test_back_and_horizon():
    """A sheet seen from behind is blank; one that passes beside the camera is drawn as far as it is seen."""
    target, seen_by = make("checkerboard:5x4:20mm"), straight_camera()
    behind = render(target.pattern(), seen_by, pose([0, np.pi, 0], [40.0, -30.0, 250.0]), Look(blur=0))
    assert behind.max() == 215 and behind.min() >= 110
    wide = Pattern(target.pattern().polygons, np.zeros((0, 3)), (-1e4, -1e4, 1e4, 1e4))
    grazing = render(wide, seen_by, pose([0.05 - np.pi / 2, 0, 0], [-40.0, 15.0, 180.0]), Look(blur=0.5))
    assert len(np.unique(grazing)) > 20


def test_rays_between_the_nodes():
    """The interpolated rays are those of the lens to 1e-5 px."""
    seen_by = camera((320, 240))
    u, v = np.meshgrid(np.arange(-3.0, 323), np.arange(-3.0, 243))
    direct = seen_by.unproject(np.stack([u, v], -1))
    assert np.abs(pixel_rays(seen_by, 320, 240, 3) - direct).max() * seen_by.params[0] < 1e-5


def test_ink_is_exact():
    """Mean blackness of boxes over rectangles and over a polygon of another shape."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    black = BlackArea(Pattern((square, square + 1.0), np.zeros((0, 3)), (-1, -1, 3, 3)))
    boxes = np.array([[0.5, 0.5], [1.0, 1.0], [1.0, 0.5], [2.0, 2.5], [0.9, 0.3]])
    assert black.mean(boxes, np.full((5, 2), 0.5)) == pytest.approx([1, 0.5, 0.5, 0, 0.7])
    triangle = BlackArea(Pattern((np.array([[0.0, 0], [4, 0], [0, 4]]),), np.zeros((0, 3)), (0, 0, 4, 4)))
    x, y = np.meshgrid((np.arange(200) + 0.5) / 50, (np.arange(200) + 0.5) / 50)
    area = triangle.mean(np.stack([x, y], -1), np.full((200, 200, 2), 0.02)).sum() / 2500
    assert area == pytest.approx(8.0, rel=1e-3)
