"""ChArUco boards: OpenCV's layout and ids, every dictionary, markers too small to read, real pictures."""

import cv2
import numpy as np
import pytest

from camcal.detect.targets import dictionaries
from camcal.detect.targets.base import Detection
from camcal.detect.targets.charuco import Charuco
from camcal.errors import UsageError
from tests.detect.scenes import camera, errors, make, picture, random_view, straight_camera
from tests.shared_data import DATA, needs_data


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("size", [(5, 8), (6, 5), (4, 4)])
def test_layout_is_that_of_opencv(size, legacy):
    """The drawn board is the one that cv2 draws, pixel by pixel, and its corners have cv2's ids."""
    target = Charuco(*size, 40.0, 20.0, "5X5_100", "mm", legacy)
    board = cv2.aruco.CharucoBoard(size, 40.0, 20.0, dictionaries.dictionary("5X5_100"))
    board.setLegacyPattern(legacy)
    assert target.points == pytest.approx(board.getChessboardCorners())
    # the marker's 7 cells of 20 / 7 mm each cover whole pixels at 7 px to 2.5 mm
    width, height = 112 * size[0], 112 * size[1]
    theirs = board.generateImage((width, height), marginSize=0, borderBits=1)
    from camcal.detect.black_area import BlackArea

    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    at = np.stack([x, y], -1) * 40.0 / 112
    ours = 255 * (1 - BlackArea(target.pattern()).mean(at, np.full_like(at, 40.0 / 112)))
    assert (np.abs(ours - theirs) > 1).mean() < 0.002


def test_every_dictionary_is_known_by_name():
    known = dictionaries.names()
    assert {"4X4_50", "5X5_100", "6X6_250", "7X7_1000", "APRILTAG_36h11", "ARUCO_ORIGINAL"} <= set(known)
    for name in known:
        assert dictionaries.find_name(name) == dictionaries.find_name(f"DICT_{name}".lower()) == name
        marker = dictionaries.black_cells(name, 3)
        assert marker[0].all() and marker[:, -1].all() and not marker.all()
    assert dictionaries.find_name("t36h11") == dictionaries.find_name("tag36h11") == "APRILTAG_36h11"


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("charuco:9x7:20mm:40mm:4X4_100", "a marker of 40 does not fit in a square of 20"),
        ("charuco:9x7:40mm:20mm:4X4_9", "unknown marker dictionary '4X4_9'"),
        ("charuco:30x30:40mm:20mm:4X4_100", "needs marker ids up to 449; 4X4_100 holds 100"),
        ("charuco:9x7:40mm:20in:4X4_100", "the square is in mm and the marker in in"),
    ],
)
def test_contradictions_are_named(spec, said):
    with pytest.raises(UsageError, match=said) as error:
        make(spec)
    assert error.value.hint


def test_cells_are_covered_once():
    cells = dictionaries.black_cells("7X7_250", 17)
    covered = np.zeros_like(cells, int)
    for box in dictionaries.rectangles(cells, np.zeros(2), float(len(cells))):
        (x0, y0), (x1, y1) = box.min(0).round().astype(int), box.max(0).round().astype(int)
        covered[y0:y1, x0:x1] += 1
    assert (covered == cells).all()


def test_markers_too_small_to_read():
    """Markers of 2.3 px a cell under a blur of 1.3 px: hardly one is read, all together they are."""
    target, rng = make("charuco:9x7:40mm:20mm:4X4_100"), np.random.default_rng(2)
    seen_by, cam_from_board = random_view(target, rng, tilt=(5.0, 15.0), fill=(0.64, 0.66))
    gray = picture(target, seen_by, cam_from_board, rng, blur=1.3, noise=2.0)
    assert len(dictionaries.detect(gray, "4X4_100")[0]) < 2
    found = target.find(gray)
    assert isinstance(found, Detection) and len(found) > 40
    assert errors(target, found, seen_by, cam_from_board).max() < 0.3


def test_wrong_board_of_the_same_dictionary():
    """The markers of another board are not taken for this one's."""
    shown, wanted = make("charuco:9x7:40mm:20mm:4X4_100"), make("charuco:9x7:40mm:20mm:6X6_100")
    rng = np.random.default_rng(4)
    seen_by, cam_from_board = random_view(shown, rng)
    assert not isinstance(wanted.find(picture(shown, seen_by, cam_from_board, rng)), Detection)


@needs_data
def test_real_pictures():
    """7 pictures in which OpenCV's detector finds 48 48 48 48 48 36 37; one of the first is scratched."""
    target = make("charuco:9x7:40mm:20mm:4X4_100")
    for path, least in zip(
        sorted((DATA / "charuco").glob("*.jpg")), (47, 48, 48, 48, 48, 43, 46), strict=True
    ):
        found = target.find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), seconds=20.0)
        assert isinstance(found, Detection) and len(found) >= least, path.name


def test_fisheye_view():
    """Nothing in the search assumes a pinhole: strong barrel distortion, a board over most of the picture."""
    target, rng = make("charuco:9x7:40mm:20mm:4X4_100"), np.random.default_rng(6)
    seen_by = camera((800, 600), fx=330.0, fy=330.0, k1=-0.30, k2=0.07, k3=0.0)
    from camcal.model.placement import Spread
    from camcal.study.pictures import board_poses

    cam_from_board = board_poses(target, seen_by, rng, 1, Spread(tilt=(5, 10), fill=(0.85, 0.9)))[0]
    found = target.find(picture(target, seen_by, cam_from_board, rng, noise=1.0))
    assert len(found) == 48 and errors(target, found, seen_by, cam_from_board).max() < 0.3


def test_no_lens_is_needed_for_a_straight_view():
    target = make("charuco:4x4:10mm:7mm:4X4_50")
    seen_by, rng = straight_camera((400, 400), 600.0), np.random.default_rng(0)
    from tests.detect.scenes import pose

    cam_from_board = pose([0, 0, 0], [-20.0, -20.0, 80.0])
    found = target.find(picture(target, seen_by, cam_from_board, rng, noise=0.0))
    assert len(found) == 9 and errors(target, found, seen_by, cam_from_board).max() < 0.01
