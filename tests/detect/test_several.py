"""Several boards of markers in the same pictures."""

import cv2
import numpy as np
import pytest

from camcal.detect import targets
from camcal.detect.images import detect_images
from camcal.errors import UsageError
from camcal.plan.calibrate import calibrate
from tests.detect.scenes import camera, expected, make, picture, pose

SPECS = ("charuco:6x5:40mm:30mm:4X4_100", "charuco:5x6:40mm:30mm:4X4_100:start=20")
SIZE = (960, 720)
#: where the boards stand, mm and radians: side by side, each tilted in its own way
TILTS = ((0.3, 0.2, 0.1), (-0.3, 0.3, -0.2), (0.2, -0.35, 0.3), (-0.25, -0.2, 1.5), (0.4, 0.0, -0.1))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return drawn(tmp_path_factory.mktemp("two"), SPECS)


def drawn(place, specs):
    """Five pictures of two boards that stand differently in each; the last one shows the second alone."""
    seen_by, rng = camera(SIZE), np.random.default_rng(1)
    boards = [make(s) for s in specs]
    for number, tilt in enumerate(TILTS):
        poses = [
            pose(np.multiply(tilt, side), np.array([140.0 * side - 115, -100.0, 560 + 40 * number]))
            for side in (-1, 1)
        ]
        image = picture(boards[0], seen_by, poses[0], rng, blur=0.6, noise=1.0)
        other = picture(boards[1], seen_by, poses[1], rng, blur=0.6, noise=1.0)
        x0, y0, x1, y1 = boards[1].pattern().extent
        rim = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
        mask = np.zeros(image.shape, np.uint8)
        outline = np.rint(seen_by.project(poses[1].apply(rim))).astype(np.int32)
        cv2.fillConvexPoly(mask, outline, 1)
        shown = np.where(mask == 1, other, image)
        cv2.imwrite(str(place / f"v{number}.png"), other if number == len(TILTS) - 1 else shown)
    return place


def test_each_board_is_a_view(folder):
    said = {}
    found = detect_images([folder], on_event=lambda name, details: said.update({name: details}))
    assert len(found.target["boards"]) == 2
    assert said["target"]["spec"] == "+".join(found.target["boards"])
    names = [f"v{k}.png board {n}" for k in range(4) for n in (1, 2)]
    assert list(found.view_ids) == [*names, "v4.png"]  # a picture with one board is the view
    ids = [set(v.point_ids.tolist()) for v in found.views]
    assert not ids[0] & ids[1] and ids[0] & ids[2] and ids[0] & ids[8]
    solution = calibrate(found, model="opencv5")
    truth = camera(SIZE)
    assert solution.camera.values["fx"] == pytest.approx(
        truth.values["fx"], rel=2e-3
    )  # some sigmas of 9 views
    assert solution.rms_point < 0.15


def test_the_boards_can_be_named(folder):
    spec = "+".join(SPECS)
    found = detect_images([folder], target=spec)
    assert len(found.views) == 9
    assert max(np.abs(v.xyz).max() for v in found.views) > 100  # mm, as the specs say


def test_a_misread_marker_makes_no_second_board():
    from camcal.detect.several import _apart

    rng = np.random.default_rng(0)
    first = rng.uniform(0, 600, (20, 2))
    again = first[:12] + rng.normal(0, 0.02, (12, 2))
    assert _apart([first, again]) == [0] and _apart([again, first]) == [1]
    assert _apart([first, None, rng.uniform(0, 600, (20, 2))]) == [0, 2]
    assert _apart([None, None]) == []


MIXED = ("charuco:6x5:40mm:30mm:4X4_50", "charuco:5x6:40mm:30mm:6X6_50")


def test_boards_of_two_dictionaries(tmp_path):
    place = drawn(tmp_path, MIXED)
    found = detect_images([place], jobs=1)
    assert sorted(b.split(":")[4] for b in found.target["boards"]) == ["4X4_50", "6X6_50"]
    assert len(found.views) == 9
    again = detect_images([place], jobs=1)  # from the cache
    assert again.target == found.target and len(again.views) == 9
    for spec in MIXED:  # one of them alone, without a word of the other
        assert len(detect_images([place], target=spec, jobs=1).views) in (4, 5)


def test_boards_must_differ():
    with pytest.raises(UsageError, match="different ids"):
        targets.make_all("charuco:6x5:40mm:30mm:4X4_100+charuco:5x6:40mm:30mm:4X4_100:start=3")
    with pytest.raises(UsageError, match="different ids"):
        targets.make_all("checkerboard:9x6+charuco:6x5:40mm:30mm:4X4_100")


def test_one_board_in_parts_is_one_board(tmp_path):
    """What hides the middle of a board does not make two of it."""
    board, seen_by, rng = make("charuco:9x7:40mm:20mm:4X4_100"), camera(SIZE), np.random.default_rng(2)
    for number, tilt in enumerate(TILTS[:3]):
        image = picture(board, seen_by, pose(tilt, (-180, -140, 520)), rng, blur=0.6, noise=1.0)
        middle = int(expected(board, seen_by, pose(tilt, (-180, -140, 520)), [20])[0, 0])
        image[:, middle - 30 : middle + 30] = 90
        cv2.imwrite(str(tmp_path / f"v{number}.png"), image)
    found = detect_images([tmp_path])
    assert "boards" not in found.target and len(found.views) == 3
