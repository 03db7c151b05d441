"""One battery for every target of the table: a new one is tested by a spec in `SPECS`."""

import pickle

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from camcal.detect.targets import SUMMARIES, TARGETS
from camcal.detect.targets.base import Detection, Miss
from camcal.errors import UsageError
from tests.detect.scenes import SPECS, errors, make, picture, random_view

#: What a picture of the property test may be like, and what then must hold. The views are those of a person
#: with a board: tilted by up to 50 degrees, upside down or not, filling 60 to 95 % of a picture of 640x480.
MOST_ERROR = (
    0.30  #: px; a wrong corner is off by at least the width of a cell, 2 px; noise of 4 levels gives 0.1
)
LEAST_FOUND = (
    0.85  #: share of the points; a few lie too near the rim, or are too small where the board is far
)


@pytest.mark.parametrize("spec", SPECS)
def test_states_itself(spec):
    target = make(spec)
    assert target.kind == spec.split(":")[0] and target.kind in TARGETS and target.kind in SUMMARIES
    assert (
        target == make(spec) and hash(target) == hash(make(spec)) and target != make("checkerboard:3x4:1mm")
    )
    described = target.describe()
    assert {"kind", "columns", "rows", "square", "unit"} <= set(described)
    assert pickle.loads(pickle.dumps(target)) == target
    assert target.points.shape[1] == 3 and not target.points[:, 2].any()
    assert len(np.unique(target.points, axis=0)) == len(target.points)


@pytest.mark.parametrize("spec", SPECS)
def test_pattern_holds_the_points(spec):
    """The points lie on the sheet with room to its rim; the shapes are on the sheet and do not overlap."""
    target = make(spec)
    pattern = target.pattern()
    x0, y0, x1, y1 = pattern.extent
    xy = target.points[:, :2]
    assert (xy > [x0, y0]).all() and (xy < [x1, y1]).all()
    for polygon in pattern.polygons:
        assert (polygon > [x0 - 1e-9, y0 - 1e-9]).all() and (polygon < [x1 + 1e-9, y1 + 1e-9]).all()
    boxes = np.array([[*p.min(0), *p.max(0)] for p in pattern.polygons]).reshape(-1, 4)
    width = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:]) - np.maximum(
        boxes[:, None, :2], boxes[None, :, :2]
    )
    overlap = (width > 1e-9).all(-1)
    np.fill_diagonal(overlap, False)
    assert not overlap.any()


@pytest.mark.parametrize("spec", SPECS)
def test_nothing_there(spec):
    """Pictures without the target are a miss with a reason, whatever is in them."""
    target, rng = make(spec), np.random.default_rng(0)
    noise = rng.integers(0, 256, (240, 320), np.uint8)
    stripes = np.tile(np.arange(320, dtype=np.uint8) % 16 * 15, (240, 1))
    for gray in (
        noise,
        stripes,
        np.zeros((240, 320), np.uint8),
        np.full((9, 7), 200, np.uint8),
        noise[:1, :1],
    ):
        found = target.find(gray)
        assert isinstance(found, Miss) and found.reason and found.message


@pytest.mark.parametrize("spec", SPECS)
@settings(max_examples=4, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    seed=st.integers(0, 2**32 - 1),
    blur=st.floats(0.4, 0.9),
    noise=st.floats(0.0, 4.0),
    gradient=st.floats(0.0, 0.6),
    bits=st.sampled_from([8, 16]),
)
def test_drawn_and_found_again(spec, seed, blur, noise, gradient, bits):
    """A target at any pose is found again, every point where it belongs."""
    rng = np.random.default_rng(seed)
    target = make(spec)
    seen_by, cam_from_board = random_view(target, rng)
    look = {"blur": blur, "noise": noise, "gradient": gradient, "vignetting": 0.2, "bits": bits}
    found = target.find(picture(target, seen_by, cam_from_board, rng, **look), seconds=60.0)
    off = errors(target, found, seen_by, cam_from_board)
    assert off.max() < MOST_ERROR
    assert len(found) >= LEAST_FOUND * len(target.points)
    assert (np.diff(found.point_ids) > 0).all()
    assert found.sigma.shape == (len(found),) and (found.sigma > 0).all()


@pytest.mark.parametrize("spec", SPECS)
def test_found_at_any_size(spec):
    """The search is coarse to fine: a picture of 2.4 megapixels is searched at half its size."""
    target, rng = make(spec), np.random.default_rng(3)
    seen_by, cam_from_board = random_view(target, rng, size=(1800, 1350), tilt=(10.0, 40.0))
    found = target.find(picture(target, seen_by, cam_from_board, rng, blur=1.5, noise=2.0), seconds=60.0)
    off = errors(target, found, seen_by, cam_from_board)
    assert off.max() < MOST_ERROR and len(found) >= LEAST_FOUND * len(target.points)


@pytest.mark.parametrize("kind", list(TARGETS))
@pytest.mark.parametrize(
    "rest", ["", ":banana", ":0x3:20mm", ":9x7:-3mm", ":9x7:20mm:9mm:1mm:2mm:3mm", ":a=b"]
)
def test_wrong_specs_are_usage_errors(kind, rest):
    said = "takes|is given by|is not the size of a board|is not a length|cannot be used|has no argument"
    with pytest.raises(UsageError, match=said) as error:
        make(kind + rest)
    assert error.value.hint


# what each kind needs after its size and its first length, without which it refuses a spec for being incomplete
REST = {"charuco": ":1mm:4X4_50", "aruco-grid": ":5mm:4X4_50", "aprilgrid": ":0.3", "squares": ":0.3"}


@pytest.mark.parametrize("kind", list(TARGETS))
@pytest.mark.parametrize(
    ("size", "said"),
    [
        ("banana:20mm", "'banana' is not the size of a board"),
        ("0x3:20mm", "a board of 0x3 cannot be used"),
        ("9x7:-3mm", "'-3mm' is not a length"),
    ],
)
def test_a_complete_spec_with_a_wrong_size_or_length_names_it(kind, size, said):
    with pytest.raises(UsageError, match=said):
        make(f"{kind}:{size}{REST.get(kind, '')}")


def test_partial_boards_of_identified_corners():
    """Half a board, the other half outside the picture: every corner that is seen, under its own number."""
    for spec in ("charuco:9x7:40mm:20mm:4X4_100", "aprilgrid:6x6:22mm:0.3"):
        target, rng = make(spec), np.random.default_rng(5)
        seen_by, cam_from_board = random_view(target, rng, size=(1280, 960), tilt=(20.0, 21.0), roll=10.0)
        gray = picture(target, seen_by, cam_from_board, rng, blur=0.8, noise=2.0)
        uv = seen_by.project(cam_from_board.apply(target.points))
        cut = int(uv[:, 0].mean())
        found = target.find(np.ascontiguousarray(gray[:, :cut]))
        assert isinstance(found, Detection)
        assert np.linalg.norm(found.uv - uv[found.point_ids], axis=1).max() < MOST_ERROR
        well_inside = np.flatnonzero(uv[:, 0] < cut - 25)
        assert np.isin(well_inside, found.point_ids).mean() > LEAST_FOUND
