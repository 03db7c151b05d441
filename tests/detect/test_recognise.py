"""Which target it is, from rendered pictures of each kind and from the real ones."""

import cv2
import numpy as np
import pytest

from camcal.detect import local_contrast, targets
from camcal.detect.images import detect_images
from camcal.detect.local_contrast import with_second_look
from camcal.detect.recognition.decide import answers, board_size, contradiction, unread
from camcal.detect.recognition.families import FAMILIES, Marker, read_markers
from camcal.detect.recognition.layout import find_boards
from camcal.detect.recognition.look import Sight, look
from camcal.detect.recognition.measure import measured, rounded
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.dictionaries import detect, dictionary
from camcal.errors import DataError
from tests.detect.scenes import expected, make, picture, pose, random_view, straight_camera
from tests.shared_data import DATA, needs_data

#: what is shown, and what must be said of it: no picture shows a length
SHOWN = {
    "checkerboard:9x6:25mm": "checkerboard:9x6",
    "charuco:9x7:40mm:20mm:4X4_100": "charuco:9x7:1:0.5:4X4_50",  # its 31 markers are in the smaller one, too
    "charuco:6x8:30mm:24mm:5X5_250:legacy": "charuco:6x8:1:0.8:5X5_50:legacy",
    "charuco:7x6:30mm:24mm:6X6_250": "charuco:7x6:1:0.8:6X6_50",
    "charuco:5x7:30mm:22.5mm:APRILTAG_36h11": "charuco:5x7:1:0.75:APRILTAG_36h11",
    "charuco:6x5:30mm:22.5mm:4X4_250:start=40": "charuco:6x5:1:0.75:4X4_100:start=40",
    "aprilgrid:6x6:22mm:0.3": "aprilgrid:6x6:1:0.3",
    "aprilgrid:4x5:30mm:0.25:family=t25h9:border=1": "aprilgrid:4x5:1:0.25:family=APRILTAG_25h9:border=1",
    "circles:10x8:2.5mm": "circles:10x8",
    "aruco-grid:5x7:40mm:0.25:4X4_50": "aruco-grid:5x7:1:0.25:4X4_50",
    "aruco-grid:6x4:30mm:0.4:APRILTAG_36h11:start=7": "aruco-grid:6x4:1:0.4:APRILTAG_36h11:start=7",
    "squares:8x6:12mm:0.8": "squares:8x6:1:0.8",
    "asymmetric-circles:4x11:20mm": "asymmetric-circles:4x11",
}


def rendered(spec, count=3, size=(1000, 750), tilt=(5.0, 30.0)):
    target, rng = make(spec), np.random.default_rng(1)
    for _ in range(count):
        seen_by, pose = random_view(target, rng, size=size, tilt=tilt)
        yield picture(target, seen_by, pose, rng, blur=0.7, noise=1.5, gradient=0.2)


@pytest.mark.parametrize("shown", SHOWN)
def test_rendered(shown):
    target, pictures = make(shown), list(rendered(shown))
    sights = [look(gray, 1.0)[0] for gray in pictures]
    best = answers(sights)[0]
    found = best.target
    if sights[0].family or sights[0].squares:
        found = measured(found, pictures)
    if found.kind == "checkerboard":
        assert board_size(sights) == ((9, 6), True, 3)
    assert found.spec == SHOWN[shown] and best.pictures == (0, 1, 2)
    made = targets.make(found.spec)
    assert (made.kind, made.columns, made.rows) == (target.kind, target.columns, target.rows)
    if target.kind in ("charuco", "aprilgrid"):
        assert contradiction(target, sights, pictures) is None


@pytest.mark.parametrize("family", [FAMILIES[0], FAMILIES[1], FAMILIES[3]])
def test_markers_are_read_as_opencv_reads_them(family):
    spec = {"4": "charuco:5x4:30mm:22mm:4X4_50", "5": "charuco:5x4:30mm:22mm:5X5_50"}.get(family[0][0])
    gray = next(rendered(spec or "aprilgrid:3x2:30mm:0.3"))
    found, markers = read_markers(gray)
    assert found == family
    theirs = dict(zip(*detect(gray, *family), strict=True))
    assert {m.id for m in markers} == set(theirs)
    for m in markers:
        assert (
            np.abs(m.corners - theirs[m.id]).max() < 1.0
        )  # from the first corner on, not only the same square


@pytest.mark.parametrize(
    ("shown", "said", "right"),
    [
        ("charuco:9x7:40mm:20mm:4X4_100", "charuco:8x6:40mm:20mm:4X4_100", "charuco:9x7:40mm:20mm:4X4_50"),
        ("charuco:9x7:40mm:20mm:4X4_100", "charuco:7x9:40mm:20mm:4X4_100", "charuco:9x7:40mm:20mm:4X4_50"),
        ("charuco:9x7:40mm:20mm:4X4_100", "charuco:9x5:40mm:20mm:4X4_100", "charuco:9x7:40mm:20mm:4X4_50"),
        ("charuco:9x7:40mm:20mm:4X4_100", "charuco:9x7:40mm:30mm:4X4_100", "charuco:9x7:40mm:20mm:4X4_50"),
        ("charuco:9x7:40mm:20mm:4X4_100", "charuco:9x7:40mm:20mm:5X5_100", "charuco:9x7:40mm:20mm:4X4_50"),
        ("charuco:6x8:3cm:2.4cm:5X5_50:legacy", "charuco:6x8:3cm:2.4cm:5X5_50", "charuco:6x8:3cm:2.4cm:5X5_50:legacy"),
        ("aprilgrid:6x6:22mm:0.3", "aprilgrid:5x6:22mm:0.3", "aprilgrid:6x6:22mm:0.3"),
    ],
)  # fmt: skip
def test_a_wrong_spec_is_named_with_the_right_one(tmp_path, shown, said, right):
    for i, gray in enumerate(rendered(shown)):
        cv2.imwrite(str(tmp_path / f"{i}.png"), gray)
    with pytest.raises(DataError, match=r"the pictures show .*; .* was requested") as error:
        detect_images([tmp_path], target=said, cache=False)
    assert f"--target {right}" in error.value.hint and error.value.exit_code == 3
    assert len(detect_images([tmp_path], target=shown, cache=False).views) == 3


def test_a_part_of_a_board_is_no_other_board():
    """Half a board has fewer rows, but contradicts nothing; nor does a marker 10 % off."""
    pictures = [gray[: gray.shape[0] // 2] for gray in rendered("charuco:9x7:40mm:20mm:4X4_100", 4)]
    sights = [look(gray, 1.0)[0] for gray in pictures]
    assert contradiction(make("charuco:9x7:40mm:20mm:4X4_100"), sights, pictures) is None
    assert contradiction(make("charuco:9x7:40mm:22mm:4X4_250"), sights, pictures) is None
    assert contradiction(make("charuco:9x7:40mm:25mm:4X4_250"), sights, pictures) is not None


def test_boards_of_one_picture_are_told_apart_by_their_ids():
    left, right = (next(rendered(f"charuco:6x5:30mm:22mm:4X4_100:start={n}", 1)) for n in (0, 15))
    both = np.concatenate([left, right], axis=1)
    sight, _ = look(both, 1.0)
    found = answers([sight, sight])
    assert {a.target.spec.partition("4X4")[2] for a in found} == {"_50", "_50:start=15"}
    assert [a.pictures for a in found] == [(0, 1), (0, 1)]


def test_markers_too_small_to_read_are_no_checkerboard():
    spec = "charuco:12x9:40mm:20mm:6X6_250"
    sights = [look(cv2.GaussianBlur(g, (0, 0), 1.0), 1.0)[0] for g in rendered(spec, 3, (400, 300))]
    assert all(s.marked for s in sights) and not any(s.markers for s in sights)
    assert answers(sights) == [] and unread(sights, None) == 3


def test_a_checkerboard_with_a_tag_beside_it_is_a_checkerboard():
    gray = next(rendered("checkerboard:9x6:25mm"))
    corners = np.array([[0.0, 0], [20, 0], [20, 20], [0, 20]])
    sight = Sight(FAMILIES[0], tuple(Marker(i, corners + 100 * i) for i in range(4)), (9, 6), True)
    assert answers([sight])[0].target.kind == "checkerboard"
    assert not look(gray, 1.0)[0].marked


def test_a_size_that_no_picture_shows_whole():
    part, other = Sight(board=(7, 7)), Sight(board=(6, 5))
    assert board_size([part] * 3 + [other] * 2) == ((7, 7), False, 3)
    assert board_size([part] * 2 + [other] * 2) is None
    assert board_size([part]) is None
    whole = Sight(board=(8, 7), whole=True)
    assert board_size([part] * 5 + [whole] * 3) == ((8, 7), True, 3)
    assert board_size([part] * 4 + [whole] * 2) == ((7, 7), False, 4)  # a third of the pictures is too few


def test_a_misread_marker_does_not_make_the_board_longer():
    gray = next(rendered("charuco:9x7:40mm:20mm:4X4_100"))
    family, markers = read_markers(gray)
    markers[5] = Marker(990, markers[5].corners)
    (found,) = find_boards([markers], family)
    assert found.board.spec.startswith("charuco:9x7") and len(markers) - 3 < found.markers < len(markers)


def test_rounding():
    assert rounded(0.512, 0.05, 0.015) == 0.5 and rounded(0.52, 0.05, 0.015) == 0.52


def test_nothing():
    rng = np.random.default_rng(0)
    empty = [rng.integers(0, 256, (200, 300), np.uint8), np.zeros((100, 100), np.uint8)]
    assert answers([look(gray, 1.0)[0] for gray in empty]) == []
    assert answers([]) == [] and find_boards([], FAMILIES[0]) == []


REAL = {
    "charuco": ("charuco:9x7:1:0.5:4X4_50", 7),
    "cases/charuco_photon": ("charuco:8x8:1:0.75:4X4_50", 17),
    "cases/charuco_small": ("charuco:9x7:1:0.5:4X4_50", 8),
    "cases/charuco_partial": ("charuco:9x7:1:0.5:4X4_50", 8),
    "aprilgrid": ("aprilgrid:6x6:1:0.3", 4),
    "circles": ("circles:10x8", 6),
    "zhang1998": ("squares:8x8:1:0.8", 5),  # of nominally 0.778; the printed squares are a hundredth smaller
    "circles_asymmetric": ("asymmetric-circles:7x13", 3),
    "opencv_left": ("checkerboard:9x6", 13),
    "cases/picam_border": ("checkerboard:7x7", 17),
}


@needs_data
@pytest.mark.parametrize("place", REAL)
def test_real(place):
    said = {}
    found = detect_images([DATA / place], on_event=lambda name, d: said.update({name: d}))
    assert (said["target"]["spec"], len(found.views)) == REAL[place]
    if place == "circles_asymmetric":
        assert {"5x5", "3x9"} <= {word for o in said["target"]["others"] for word in o.split()}


@needs_data
def test_pictures_without_a_board():
    with pytest.raises(DataError, match="no target was found in 3 pictures"):
        detect_images([DATA / "no_board"])


def test_the_grid_of_markers_is_that_of_cv2():
    """Ids, corners and print of cv2.aruco.GridBoard."""
    grid = make("aruco-grid:5x3:40mm:0.25:4X4_50:start=4")
    ids = np.arange(4, 19)
    theirs = cv2.aruco.GridBoard((5, 3), 40.0, 10.0, dictionary("4X4_50"), ids)
    assert (grid.tag_ids == np.asarray(theirs.getIds()).ravel()).all()
    corners = np.asarray(theirs.getObjPoints()).reshape(-1, 3)
    np.testing.assert_allclose(grid.points, corners, atol=1e-4)  # cv2 keeps float32
    printed = theirs.generateImage((1300, 800), marginSize=50)
    found = grid.find(printed)
    assert len(found) == 60
    step = np.linalg.norm(found.uv[4] - found.uv[0]) / 50
    np.testing.assert_allclose(
        found.uv, 49.5 + grid.points[:, :2] * step, atol=0.6
    )  # whole pixels in the print


def test_mirror_images_of_markers_are_named(tmp_path):
    for i, gray in enumerate(rendered("charuco:7x5:30mm:22mm:4X4_50", size=(640, 480))):
        cv2.imwrite(str(tmp_path / f"v{i}.png"), gray[:, ::-1])
    with pytest.raises(DataError, match="3 of 3 pictures are mirror images"):
        detect_images([tmp_path], jobs=1)


WEAKLY = ("checkerboard:9x6", "charuco:9x7:1:0.6:4X4_50", "aprilgrid:6x6:1:0.3", "circles:9x7",
          "asymmetric-circles:4x11", "squares:8x6:1:0.8", "aruco-grid:5x7:1:0.25:5X5_50")  # fmt: skip


@pytest.mark.parametrize("shown", WEAKLY)
@pytest.mark.parametrize(
    "look_like",
    [
        {"black": 120, "white": 124, "background": 121, "noise": 0.5},
        {"black": 2, "white": 12, "background": 5, "noise": 0.7},
        {"noise": 15.0},
    ],
    ids=["four levels", "dark", "noise"],
)
def test_every_target_of_little_contrast_or_much_noise(shown, look_like):
    target, rng = make(shown), np.random.default_rng(7)
    seen_by, pose = random_view(target, rng, tilt=(5.0, 40.0), fill=(0.8, 0.95), roll=30.0)
    gray = picture(target, seen_by, pose, rng, blur=0.7, **look_like)
    best = answers([look(gray, 1.0)[0]])[0].target
    assert (best.kind, best.columns, best.rows) == (target.kind, target.columns, target.rows)
    found = target.find(gray)
    assert len(found) > 0.8 * len(target.points)
    error = np.linalg.norm(found.uv - expected(target, seen_by, pose, found.point_ids), axis=1)
    assert np.median(error / found.sigma) < 2.5  # 1.18 of Gaussian errors; corners of squares are up to 1.3


@pytest.mark.parametrize("shown", WEAKLY)
def test_every_target_of_four_grey_levels_beside_a_lamp(shown):
    """A stretch of the whole picture ends at the lamp; the second look takes each region's own range."""
    target, rng = make(shown), np.random.default_rng(7)
    seen_by, pose = random_view(target, rng, tilt=(5.0, 40.0), fill=(0.8, 0.9), roll=15.0)
    weak = {"black": 120, "white": 124, "background": 121, "noise": 0.5, "blur": 0.7}
    gray = picture(target, seen_by, pose, rng, **weak)
    gray = np.pad(gray, ((0, 60), (0, 120)), constant_values=121)
    gray[300:, -110:] = 250
    seen = with_second_look(gray, lambda: look(gray, 1.0)[0], lambda sight: sight.undecided)
    best = answers([seen])[0].target
    assert (best.kind, best.columns, best.rows) == (target.kind, target.columns, target.rows)
    found = targets.find(target, gray, 1.0)
    assert len(found) > 0.8 * len(target.points)
    error = np.linalg.norm(found.uv - expected(target, seen_by, pose, found.point_ids), axis=1)
    assert (
        np.median(error / found.sigma) < 2.5
    )  # as without a lamp: the points are fitted in the picture itself
    if not shown.startswith(("checkerboard", "charuco")):  # whose saddles are found at any contrast
        assert isinstance(target.find(gray), Miss)


def test_a_picture_in_which_something_is_found_is_not_searched_again(monkeypatch):
    target, rng = make("circles:9x7"), np.random.default_rng(7)
    seen_by, pose = random_view(target, rng)
    gray = picture(target, seen_by, pose, rng, noise=1.0)
    looks = []
    monkeypatch.setattr(local_contrast, "evened", lambda gray: looks.append(1) or gray)
    assert isinstance(targets.find(target, gray, 1.0), Detection) and not looks
    assert targets.find(make("circles:6x4"), gray, 1.0).reason == "other-size" and not looks
    assert targets.find(target, gray[:, :200].copy(), 1.0).reason in {"none", "other-size", "cut-off"}
    assert isinstance(targets.find(target, np.full_like(gray, 90), 1.0), Miss) and looks == [1]


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize(
    "step, raised", [(2, 32), (4, 64), (40, 110)]
)  # of 40 by 64, and over the edges' grey
def test_the_contrast_of_a_region_is_raised_by_the_largest_gain_beside_a_lamp(step, raised, noise):
    checks = (np.indices((240, 320)) // 20).sum(0) % 2
    gray = np.rint(100 + step * checks + np.random.default_rng(0).normal(0, noise, checks.shape))
    gray[:50, :70] = 250  # nearly the whole region
    made = local_contrast.evened(gray.astype(np.uint8)).astype(float)
    for part in np.s_[125:235, 85:315], np.s_[62:115, 85:150]:  # far from the lamp, and beside it
        white, black = (np.median(made[part][checks[part] == k]) for k in (1, 0))
        assert white - black == pytest.approx(raised, rel=0.2)


def test_a_picture_of_sixteen_bits_is_evened_as_one_of_eight():
    gray = (100 + 4 * ((np.indices((120, 160)) // 20).sum(0) % 2)).astype(np.uint8)
    gray[:30, :40], gray[-30:, -40:] = 0, 255
    wide = gray.astype(np.uint16) * 50 + 7000
    np.testing.assert_allclose(local_contrast.evened(wide).astype(int), local_contrast.evened(gray), atol=1)


@pytest.mark.parametrize("shown", WEAKLY[1:])
def test_black_and_white_exchanged(shown, tmp_path):
    target = make(shown)
    for i, gray in enumerate(rendered(shown, count=1, size=(640, 480))):
        cv2.imwrite(str(tmp_path / f"v{i}.png"), ~gray)
    events = {}
    found = detect_images(
        [tmp_path], jobs=1, cache=False, on_event=lambda name, said: events.update({name: said})
    )
    assert events["target"]["spec"].endswith(":negative") and "exchanged" in events["target"]["words"]
    assert found.target["negative"] and found.target["kind"] == target.kind
    assert (found.target["columns"], found.target["rows"]) == (target.columns, target.rows)


def test_a_target_is_found_in_negative_where_its_spec_does_not_say_so(tmp_path):
    target = make("circles:9x7:20mm:12mm")
    for i, gray in enumerate(rendered("circles:9x7:20mm:12mm", count=2, size=(640, 480))):
        cv2.imwrite(str(tmp_path / f"v{i}.png"), ~gray)
        plain = target.find(gray)
        np.testing.assert_array_equal(targets.find(target.as_negative(), ~gray, 1.0).uv, plain.uv)
    events = {}
    detect_images([tmp_path], "circles:9x7:20mm:12mm", jobs=1, cache=False,
                  on_event=lambda name, said: events.update({name: said}))  # fmt: skip
    made = targets.make(events["negative"]["spec"])
    assert (
        made == target.as_negative()
        and made.scaled(1.0, "m").negative
        and made.scaled(1.0, "m").diameter == 0.6
    )


@pytest.mark.parametrize(
    ("shown", "marked"), [("charuco:6x5:40mm:24mm:4X4_50", True), ("checkerboard:5x4:40mm", False)]
)
def test_a_checkerboard_that_was_asked_for_and_holds_markers_is_named(tmp_path, shown, marked):
    (gray,) = rendered(shown, count=1, size=(640, 480))
    cv2.imwrite(str(tmp_path / "v.png"), gray)
    events = {}
    found = detect_images([tmp_path], board="5x4", square="40mm", jobs=1, cache=False,
                          on_event=lambda name, said: events.update({name: said}))  # fmt: skip
    assert len(found.views[0]) == 20 and ("marked" in events) is marked
    if marked:
        assert events["marked"]["spec"] == shown and "ChArUco board of 6x5" in events["marked"]["words"]


def covered(folder, sides, depth=1.0):
    """Pictures of a checkerboard of which something covers outer corners, on one side each; "" = none."""
    from tests.detect import drawing

    size = (8, 5)
    for i, side in enumerate(sides):
        h = drawing.homography(size, (160, 120), 26, turn=0.1 * i, tilt=0.4, about=float(i))
        gray = drawing.picture(h, size, (320, 240), seed=i)
        ends = {"left": (-3, depth - 0.5), "right": (7.5 - depth, 11), "middle": (2.6, 3.7)}.get(side)
        if ends:
            rows = (0.7, 2.2) if side == "middle" else (-4, 9)
            box = np.array([[x, y] for x, y in zip((*ends, *ends[::-1]), np.repeat(rows, 2), strict=True)])
            cv2.fillPoly(gray, [np.int32(np.rint(drawing.project(h, box)))], 150)
        cv2.imwrite(str(folder / f"v{i}.png"), gray)
    return folder


def test_corners_inside_a_board_may_be_covered(tmp_path):
    found = detect_images([covered(tmp_path, ["", "middle", "middle", "middle"])], jobs=1, cache=False)
    assert (found.target["columns"], found.target["rows"]) == (8, 5)
    assert len(found.views[0]) == 40 and {len(v) for v in found.views[1:]} <= set(range(32, 40))


def test_pictures_with_a_covered_row_are_left_out_with_the_reason(tmp_path):
    found = detect_images([covered(tmp_path, ["", "left", "", ""])], jobs=1, cache=False)
    assert (found.target["columns"], found.target["rows"]) == (8, 5) and len(found.views) == 3
    assert [s.id for s in found.skipped] == ["v1.png"]
    assert "board of 7x5 corners, not 8x5, or its outer rows are covered" in found.skipped[0].reason


def test_different_parts_of_a_board_are_not_taken_for_boards(tmp_path):
    parts = [("left", 1.0), ("right", 1.0), ("left", 2.0), ("right", 3.0)]
    for i, (side, depth) in enumerate(parts):
        (tmp_path / str(i)).mkdir()
        covered(tmp_path / str(i), [side], depth)
    folders = sorted(tmp_path.iterdir())
    with pytest.raises(DataError, match="do not agree on its size: 7x5") as error:
        detect_images(folders[1:], jobs=1, cache=False)
    assert "a hand" in error.value.hint and "--board" in error.value.hint
    with pytest.raises(DataError, match="no 8x5 checkerboard") as error:
        detect_images(folders, board="8x5", jobs=1, cache=False)
    assert "2 of the pictures show a checkerboard of 7x5" in error.value.hint


def leaving(shown, columns):
    """A picture that a grid leaves to the right by so many columns."""
    target, rng = make(shown), np.random.default_rng(2)
    seen_by = straight_camera((640, 480), 600.0)
    x, y = target.points[:, :2].max(0) / 2
    step, depth = 2 * x / (target.columns - 0.5), 1.6 * 2 * max(x, y * 4 / 3)
    turned = pose((0.1, -0.2, 0.1), (0, 0, 0)).rotation
    centre = np.array([320 / 600 * depth - x + (columns - 0.4) * step, 0, depth])
    at = pose((0.1, -0.2, 0.1), centre - turned @ [x, y, 0])
    return target, picture(target, seen_by, at, rng, blur=0.7, noise=1.0)


@pytest.mark.parametrize("shown", ["circles:9x7", "squares:8x6:1:0.8"])
def test_grids_that_leave_the_picture(shown, tmp_path):
    """A part is no other board if another picture shows the end; otherwise it is used, and that is said."""
    (target, whole), (_, cut) = (leaving(shown, columns) for columns in (-1.0, 2.0))
    sights = [look(gray, 1.0)[0] for gray in (whole, cut)]
    assert [s.whole for s in sights] == [True, False]
    best, *others = answers(sights)
    assert (best.target.columns, best.pictures, best.whole, others) == (target.columns, (0,), True, [])
    (part,) = answers(sights[1:])
    assert part.target.columns == target.columns - 1 and not part.whole
    missed = target.find(cut)
    assert (
        missed.reason == "cut-off" and f"extends beyond the picture: {target.columns - 1}x" in missed.message
    )
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"v{i}.png"), cut)
    events = {}
    detect_images([tmp_path], jobs=1, cache=False, on_event=lambda name, said: events.update({name: said}))
    assert events["target"]["whole"] is False
