import pickle

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.detect import targets
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.checkerboard import Checkerboard, find_any
from camcal.errors import UsageError
from tests.detect import drawing
from tests.shared_data import DATA, needs_data


def seen(size=(6, 5), shape=(240, 200), noise=1.0, seed=0, look=None, **pose):
    h = drawing.homography(size, (shape[0] / 2, shape[1] / 2), **{"square": 22} | pose)
    return drawing.picture(h, size, shape, noise, seed, **look or {}), drawing.corners(size, h)


# a sigma is what noise does to a corner. In 220 poses of this space the error is .7 to 1.1 of it in the median, where
# there is noise. Without any, and with a blur of more than .15 of a foreshortened square, what is left is that the
# neighbouring edges reach into the window of a corner: .01 px, against sigmas of .004 px
NEIGHBOURS, REACHES = 0.01, 0.15


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    turn=st.floats(-np.pi, np.pi),
    tilt=st.floats(0, 0.9),
    about=st.floats(0, np.pi),
    square=st.floats(12, 22),
    noise=st.floats(0, 4),
    blur=st.floats(0.4, 1.6),
)
def test_every_pose_is_found_with_the_right_numbers(turn, tilt, about, square, noise, blur):
    """6x5 has one orientation: point 0 beside a black square, columns to rows clockwise, at any turn."""
    gray, true = seen(
        square=square, turn=turn, tilt=tilt, about=about, noise=noise, look={"blur": blur}, shape=(240, 240)
    )
    found = Checkerboard(6, 5).find(gray)
    assert isinstance(found, Detection), found
    assert len(found) >= 28
    error = np.linalg.norm(found.uv - true[found.point_ids], axis=1)
    # noise of 4 grey levels under a blur of 1.6 px on tilted squares of 12 px gives sigmas up to 0.1 px
    assert error.max() < 0.5
    # 1.2 for a Gaussian; 4 x 4 samples place a corner to 0.003 px
    exact = NEIGHBOURS if blur > REACHES * square * np.cos(tilt) else 0.003
    assert np.median(error / np.hypot(found.sigma, exact)) < 2.5


def test_a_board_that_looks_the_same_after_half_a_turn_is_read_from_the_left():
    for turn in (0.2, 0.2 + np.pi):
        gray, _ = seen((7, 5), turn=turn, shape=(300, 240))
        found = Checkerboard(7, 5).find(gray)
        uv = found.uv.reshape(5, 7, 2)
        assert (uv[:, -1, 0] > uv[:, 0, 0]).all()


def test_rows_and_columns_may_be_named_the_other_way_round():
    gray, _ = seen((6, 5))
    one, other = Checkerboard(6, 5).find(gray), Checkerboard(5, 6).find(gray)
    assert len(one) == len(other) == 30
    for uv in (one.uv.reshape(5, 6, 2), other.uv.reshape(6, 5, 2)):
        right, down = uv[0, 1] - uv[0, 0], uv[1, 0] - uv[0, 0]
        assert right[0] * down[1] - right[1] * down[0] > 0  # never mirrored


def test_a_larger_board_is_not_taken_for_a_smaller():
    gray, _ = seen((9, 6), shape=(320, 240))
    miss = Checkerboard(7, 5).find(gray)
    assert isinstance(miss, Miss) and miss.reason == "other-size" and miss.info["size"] == (9, 6)
    assert find_any(gray)[:2] == ((9, 6), True)


def test_a_board_that_leaves_the_picture_is_cut_off():
    gray, _ = seen((9, 6), shape=(320, 240))
    miss = Checkerboard(9, 6).find(np.ascontiguousarray(gray[:, 120:]))
    assert miss.reason == "cut-off"
    free = find_any(np.ascontiguousarray(gray[:, 120:]))
    assert free[:2] == (
        (6, 6),
        False,
    )  # the six columns that are visible, and not known to be the whole board


def test_a_covered_corner_is_left_out():
    gray, true = seen((6, 5))
    x, y = true[13].astype(int)
    cv2.circle(gray, (x, y), 9, 90, -1)
    found = Checkerboard(6, 5).find(gray)
    assert 13 not in found.point_ids and 13 in found.info["rejected"]
    assert np.linalg.norm(found.uv - true[found.point_ids], axis=1).max() < 0.3


@pytest.mark.parametrize(
    ("gray", "reason"),
    [
        (np.full((200, 240), 8, np.uint8), "too-dark"),
        (np.full((200, 240), 255, np.uint8), "too-bright"),
        (np.random.default_rng(0).integers(0, 255, (200, 240)).astype(np.uint8), "none"),
        (np.tile(np.linspace(0, 255, 240).astype(np.uint8), (200, 1)), "too-blurred"),
        (np.full((1, 1), 8, np.uint8), "too-small"),
        (np.full((3, 5000), 8, np.uint8), "too-small"),
    ],
    ids=["dark", "bright", "noise", "blurred", "one-pixel", "strip"],
)
def test_pictures_without_a_board_say_why(gray, reason):
    assert Checkerboard(6, 5).find(gray).reason == reason
    assert find_any(gray).reason == reason


def test_no_time_is_said_so():
    gray = np.random.default_rng(0).integers(0, 255, (600, 800)).astype(np.uint8)
    assert Checkerboard(6, 5).find(gray, seconds=0.0).reason == "time"


def test_sixteen_bits():
    gray, _ = seen()
    one, other = Checkerboard(6, 5).find(gray), Checkerboard(6, 5).find(gray.astype(np.uint16) * 100)
    assert (one.point_ids == other.point_ids).all() and np.abs(one.uv - other.uv).max() < 5e-3


def test_large_pictures_are_searched_small_and_measured_large():
    gray, true = seen(
        (6, 5), shape=(1700, 1400), square=150, turn=0.2, tilt=0.3, look={"blur": 1.0, "samples": 2}
    )
    found = Checkerboard(6, 5).find(gray)
    assert len(found) == 30
    assert np.linalg.norm(found.uv - true[found.point_ids], axis=1).max() < 0.05  # 2 x 2 samples


def test_spec_and_description():
    board = targets.make("checkerboard:9x6:25mm")
    assert board == Checkerboard(9, 6, 25.0, "mm") == pickle.loads(pickle.dumps(board))
    assert board.describe() == {"kind": "checkerboard", "columns": 9, "rows": 6, "square": 25.0, "unit": "mm"}
    assert board.points[10].tolist() == [25.0, 25.0, 0.0]
    for spec, said in (
        ("checkerboard", "given by its inner corners"),
        ("checkerboard:9", "'9' is not the size"),
        ("checkerboard:9x6:25parsec", "'25parsec' is not a length"),
        ("checkerboard:9x6:a=1", "given by its inner corners"),
        ("checkerbord:9x6", "unknown target 'checkerbord'"),
    ):
        with pytest.raises(UsageError, match=said):
            targets.make(spec)


def test_the_first_square_of_the_pattern_is_black():
    pattern = Checkerboard(4, 3, 10.0, "mm").pattern()
    corners = {tuple(p[0]) for p in pattern.polygons}
    assert (-10.0, -10.0) in corners and (0.0, -10.0) not in corners
    assert len(pattern.polygons) == 10  # of 5 x 4 squares


@needs_data
@pytest.mark.parametrize(
    ("name", "size", "least"),
    [
        ("opencv_left/left05.jpg", (9, 6), 54),
        ("opencv_left/left03.jpg", (9, 6), 54),  # a screen behind shows the board a second time
        ("bouguet/Image18.tif", (13, 12), 156),
        ("fisheye_ocam/Fisheye1_7.jpg", (8, 6), 46),
        ("udacity/calibration3.jpg", (9, 6), 54),
    ],
)
def test_real_pictures(name, size, least):
    gray = cv2.imread(str(DATA / name), cv2.IMREAD_GRAYSCALE)
    found = Checkerboard(*size).find(gray, seconds=10.0)
    assert isinstance(found, Detection) and len(found) >= least


@needs_data
@pytest.mark.parametrize("name", ["no_board/pic_a.jpg", "no_board/building.png"])
def test_real_pictures_without_a_board(name):
    gray = cv2.imread(str(DATA / name), cv2.IMREAD_GRAYSCALE)
    assert find_any(gray, seconds=10.0).reason == "none"


@needs_data
def test_a_board_of_another_size_is_no_reason_to_take_what_a_screen_shows_behind_it():
    # asked for 7x5, some of these pictures gave a grid of 4 px a square, on a screen behind the 9x6 board
    for path in sorted((DATA / "opencv_left").glob("*.jpg")):
        missed = Checkerboard(7, 5).find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), seconds=10.0)
        assert not isinstance(missed, Detection) and missed.info["size"] == (9, 6)
