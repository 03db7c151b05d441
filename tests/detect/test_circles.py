"""Circle grids: centres without bias, the shift of a disc, orientation, hidden discs, real pictures."""

import cv2
import numpy as np
import pytest

from camcal.detect.disc_fit import fit_discs
from camcal.detect.discs import Discs
from camcal.detect.targets import circles
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.circles import AsymmetricCircles, Circles, centroid
from tests.detect.scenes import camera, errors, expected, make, picture, pose, random_view, straight_camera
from tests.shared_data import DATA, needs_data


def conic_centre(target, seen_by, cam_from_board, radius):
    """Centre of the picture of each disc by the conic of a pinhole, C' = H^-T C H^-1: an independent way."""
    h = seen_by.matrix @ np.c_[cam_from_board.rotation[:, :2], cam_from_board.translation]
    inverse, out = np.linalg.inv(h), []
    for x, y, _ in target.points:
        circle = np.array([[1, 0, -x], [0, 1, -y], [-x, -y, x * x + y * y - radius**2]])
        conic = inverse.T @ circle @ inverse
        out.append(np.linalg.solve(conic[:2, :2], -conic[:2, 2]))
    return np.array(out)


def test_shift_agrees_with_the_conic():
    target = Circles(5, 4, 20.0, "mm", 12.0)
    seen_by, cam_from_board = (
        straight_camera((640, 480), 500.0),
        pose([0.7, -0.4, 0.2], [-40.0, -30.0, 200.0]),
    )
    centre = seen_by.project(cam_from_board.apply(target.points))
    by_conic = conic_centre(target, seen_by, cam_from_board, 6.0) - centre
    shift = target.apparent_shift(seen_by, cam_from_board, np.arange(20))
    assert np.abs(by_conic).max() > 0.2  # there is something to correct
    # the centroid of a polygon of 64 corners: its area, and so the shift, is too small by 1.6e-3
    assert np.abs(shift - by_conic).max() < 2e-3 * np.abs(by_conic).max()


def test_centroid_of_a_polygon():
    triangle = np.array([[[0.0, 0], [6, 0], [0, 3]]])
    assert centroid(triangle) == pytest.approx(np.array([[2.0, 1.0]]))


@pytest.mark.parametrize("blur", [0.5, 1.5])
def test_centres_without_bias(blur):
    """Through perspective and distortion, what is measured is the centre with its shift."""
    target, rng = Circles(7, 6, 20.0, "mm", 13.0), np.random.default_rng(0)
    seen_by, cam_from_board = camera(), pose([0.65, -0.35, 0.1], [-60.0, -45.0, 220.0])
    gray = picture(target, seen_by, cam_from_board, rng, blur=blur, bits=16)
    found = target.find(gray)
    assert isinstance(found, Detection) and len(found) == 42
    centre = seen_by.project(cam_from_board.apply(target.points))
    assert np.abs(found.uv - centre).max() > 0.15
    off = found.uv - expected(target, seen_by, cam_from_board, found.point_ids)
    # distortion makes the outline no ellipse, which the fit takes it for: a hundredth of a px at most
    assert np.abs(off).max() < 0.015 and np.abs(off.mean(0)).max() < 0.003


def test_covariance_is_true():
    """The scatter over noise is what the fit says of itself."""
    target, rng = Circles(7, 6, 20.0, "mm", 12.0), np.random.default_rng(1)
    seen_by, cam_from_board = camera(), pose([0.3, 0.2, 0.1], [-60.0, -50.0, 250.0])
    runs = [target.find(picture(target, seen_by, cam_from_board, rng, noise=4.0)) for _ in range(6)]
    uv = np.stack([r.uv for r in runs])
    said = np.sqrt(np.mean([r.sigma**2 for r in runs]))
    seen = np.sqrt(uv.var(0, ddof=1).mean())
    assert said == pytest.approx(seen, rel=0.12)  # 42 x 2 x 5 degrees of freedom: 3.5 %


def test_gradient_of_light_does_not_move_the_centre():
    target, rng = Circles(4, 4, 20.0, "mm", 12.0), np.random.default_rng(0)
    seen_by, cam_from_board = straight_camera((300, 300), 600.0), pose([0, 0, 0], [-30.0, -30.0, 160.0])
    gray = picture(target, seen_by, cam_from_board, rng, blur=1.0, gradient=1.0, bits=16)
    found = target.find(gray)
    truth = seen_by.project(cam_from_board.apply(target.points))
    assert np.abs(found.uv - truth[found.point_ids]).max() < 0.02


def test_radius_is_measured():
    for spec, radius in (("circles:7x5:20mm:11mm", 5.5), ("asymmetric-circles:4x9:20mm:15mm", 7.5)):
        target, rng = make(spec), np.random.default_rng(3)
        seen_by, cam_from_board = random_view(target, rng, tilt=(30.0, 40.0))
        found = target.find(picture(target, seen_by, cam_from_board, rng))
        assert found.info["radius"] == pytest.approx(radius, rel=0.02)


def test_staggered_board_stands_one_way_only():
    """A staggered grid of an odd number of rows looks different upside down, and is numbered the same."""
    target, rng = AsymmetricCircles(4, 11, 20.0, "mm"), np.random.default_rng(0)
    seen_by = camera()
    for angle in (0.0, np.pi / 2, np.pi, -np.pi / 2):
        turn = pose([0, 0, angle], [0, 0, 0])
        middle = turn.apply(target.points.mean(0))
        cam_from_board = pose([0, 0, angle], [*-middle[:2], 420.0])
        found = target.find(picture(target, seen_by, cam_from_board, rng))
        truth = expected(target, seen_by, cam_from_board, found.point_ids)
        assert np.abs(found.uv - truth).max() < 0.1


def test_hidden_discs():
    target, rng = make("circles:10x8:20mm"), np.random.default_rng(2)
    seen_by, cam_from_board = random_view(target, rng, tilt=(10.0, 20.0), roll=10.0)
    gray = picture(target, seen_by, cam_from_board, rng)
    uv = seen_by.project(cam_from_board.apply(target.points))
    for k in (0, 33, 34, 44, 79):
        cv2.circle(gray, tuple(np.rint(uv[k]).astype(int).tolist()), 16, 210, -1)
    found = target.find(gray)
    assert isinstance(found, Detection) and len(found) == 75
    assert errors(target, found, seen_by, cam_from_board).max() < 0.2


def test_other_size_is_said():
    shown, wanted = make("circles:7x5:20mm"), make("circles:10x8:20mm")
    rng = np.random.default_rng(0)
    seen_by, cam_from_board = random_view(shown, rng)
    missed = wanted.find(picture(shown, seen_by, cam_from_board, rng))
    assert isinstance(missed, Miss) and missed.reason == "other-size" and missed.info["size"] == (7, 5)


def test_discs_at_the_border_are_rejected():
    gray = np.full((60, 60), 200, np.uint8)
    cv2.circle(gray, (30, 30), 9, 40, -1)
    cv2.circle(gray, (1, 30), 9, 40, -1)
    shape = np.stack([np.eye(2) * 9.0] * 2)
    fitted = fit_discs(gray, Discs(np.array([[30.3, 29.8], [1.0, 30.0]]), shape))
    assert fitted.good.tolist() == [True, False] and "border" in fitted.reasons[1]
    assert np.abs(fitted.discs.centre[0] - 30).max() < 0.02


@needs_data
def test_real_pictures():
    target = make("circles:10x8:2.5mm")
    for path in sorted((DATA / "circles").glob("*.jpg")):
        found = target.find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), seconds=20.0)
        assert isinstance(found, Detection) and len(found) == 80, path.name
        assert found.info["radius"] == pytest.approx(0.75, rel=0.03)
    staggered = make("asymmetric-circles:7x13:1cm")
    for path in sorted((DATA / "circles_asymmetric").glob("*.png"))[:3]:
        found = staggered.find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), seconds=20.0)
        assert isinstance(found, Detection) and len(found) == 91, path.name


def grid_of_shapes(draw, step=36, columns=8, rows=6):
    gray = np.full((rows * step + 40, columns * step + 40), 200, np.uint8)
    for row in range(rows):
        for column in range(columns):
            draw(gray, 20 + column * step + step // 2, 20 + row * step + step // 2)
    return np.clip(
        cv2.GaussianBlur(gray, (0, 0), 1.0) + np.random.default_rng(0).normal(0, 1, gray.shape), 0, 255
    ).astype(np.uint8)


def test_what_stands_in_rows_but_is_no_printed_disc_is_not_taken_unasked():
    def disc(gray, x, y):
        cv2.circle(gray, (x, y), 10, 40, -1)

    def window(gray, x, y):
        cv2.rectangle(gray, (x - 6, y - 9), (x + 6, y + 9), 40, -1)

    def between_tags(gray, x, y):
        cv2.rectangle(gray, (x - 4, y - 4), (x + 4, y + 4), 40, -1)
        cv2.rectangle(gray, (x + 8, y + 8), (x + 28, y + 28), 40, -1)

    found = circles.find_any(grid_of_shapes(disc), 5.0)
    assert found is not None and (found.columns, found.rows) == (8, 6)
    assert circles.find_any(grid_of_shapes(window), 5.0) is None
    assert circles.find_any(grid_of_shapes(between_tags), 5.0) is None
    assert circles.find_any(grid_of_shapes(disc, columns=4, rows=3), 5.0) is not None
    assert (
        circles.find_any(grid_of_shapes(disc, columns=3, rows=3), 5.0) is None
    )  # too few to be believed unasked
    for scatter, taken in (
        (4, True),
        (30, False),
    ):  # of their greys: 1 and 14 % of the contrast from their neighbours
        greys = iter(np.random.default_rng(0).normal(60, scatter, 48))
        found = circles.find_any(
            grid_of_shapes(lambda g, x, y, n=greys: cv2.circle(g, (x, y), 10, next(n), -1)), 5.0
        )
        assert (found is not None) == taken
    y, x = np.mgrid[0:300, 0:400]
    mesh = (128 + 55 * np.sin(x / 3) + 55 * np.sin(y / 3)).astype(np.uint8)
    assert circles.find_any(mesh, 5.0) is None
