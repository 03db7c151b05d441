"""Two cameras compared: px, sigmas of both, gates."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.comparison import Gate, Side, common_bounds, compare, described, gates, parameters
from camcal.errors import DataError
from camcal.report.comparison import sentence
from camcal.solve.refine import refine
from tests.solved import TRUTH, camera_of, grid, observe, solved, tilted_poses

BOX = np.zeros(2), np.array([639.0, 479.0])


@pytest.fixture(scope="module")
def pair():
    """Two calibrations of the same camera from other noise and other poses."""
    return [Side.of(f"seed {seed}", solved(views=15, seed=seed)) for seed in (1, 2)]


def test_two_calibrations_of_one_camera_differ_by_their_sigmas():
    rng, truth = np.random.default_rng(0), camera_of()
    ratios = []
    for _ in range(25):
        sides = []
        for _ in range(2):
            poses = tilted_poses(grid(), 12, rng)
            sides.append(Side.of("", refine(truth, poses, observe(truth, poses, grid(), 0.2, rng))))
        ratios.append(compare(*sides, BOX, 13.0).sigmas)
    # in one direction a Gaussian lies within two sigmas in 95 %; the fitted transformation only takes away
    within = np.mean(np.array(ratios) < 2.0)
    assert within > 0.93
    assert np.sqrt(np.mean(np.square(ratios))) > 0.4  # and the sigmas are not simply large


def test_a_changed_camera_shows_in_sigmas(pair):
    moved = camera_of(values=TRUTH | {"k1": -0.20})
    rng = np.random.default_rng(5)
    poses = tilted_poses(grid(), 15, rng)
    other = Side.of("moved", refine(moved, poses, observe(moved, poses, grid(), 0.2, rng)))
    same, changed = compare(*pair, BOX, 13.0), compare(pair[0], other, BOX, 13.0)
    assert same.max_sigma < 4 < changed.max_sigma
    assert changed.difference.max_px > 1


def test_without_data_there_are_no_sigmas():
    sides = Side("a", camera_of()), Side("b", camera_of(values=TRUTH | {"fx": 540.0}))
    found = compare(*sides, BOX)
    assert found.sigmas is None and found.max_sigma is None
    with pytest.raises(DataError, match="no uncertainty"):
        gates([found], [], max_sigma=3.0)


def test_one_uncertain_side_is_enough(pair):
    found = compare(pair[0], Side("exact", camera_of()), BOX, 13.0)
    assert 0 < found.max_sigma < 4


def test_the_same_camera_is_no_sigma_apart(pair):
    found = compare(pair[0], pair[0], BOX)
    assert found.difference.max_px < 1e-9 and found.max_sigma < 1e-9


def test_parameters_of_other_families_are_not_compared():
    a, b = Side("a", camera_of("opencv5")), Side("b", camera_of("kb4", {"fx": 530, "k1": 0.1}))
    assert [p.name for p in parameters(a, b)] == ["fx", "fy", "cx", "cy"]
    assert [p.name for p in parameters(a, Side("c", camera_of("opencv4")))] == [
        "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2",
    ]  # fmt: skip


def test_gates(pair):
    found, changes = [compare(*pair, BOX)], parameters(*pair)
    asked = gates(found, changes, max_px=1e-6, max_sigma=1e6, tolerances={"fx": 1e3})
    assert [g.passed for g in asked] == [False, True, True]
    said = described(*pair, found, changes, asked)
    assert said["verdict"] == "fail"
    assert said["parameters"]["fx"]["sigma"] > 0
    with pytest.raises(DataError, match="k9"):
        gates(found, changes, tolerances={"k9": 1.0})


def test_nan_falls():
    assert not Gate("x", float("nan"), 1.0).passed


def test_the_part_of_the_picture_that_is_compared(pair):
    a, b = Side("a", camera_of(size=(640, 480))), Side("b", camera_of(size=(1280, 960)))
    bare = Side("bare", camera_of(size=None))
    with pytest.raises(DataError, match="640x480 and 1280x960"):
        common_bounds(a, b)
    assert common_bounds(a, b, (100, 80))[1].tolist() == [99, 79]
    assert common_bounds(bare, a)[1].tolist() == [639, 479]
    with pytest.raises(DataError, match="image size"):
        common_bounds(bare, bare)
    seen = replace(pair[0], camera=bare.camera)
    low, high = common_bounds(seen, bare)
    assert np.all(low > 0) and np.all(high < [639, 479])


def beyond():
    """Two cameras that are the same where points were seen, and px apart in the rest of the picture."""
    a, b = camera_of(), camera_of()
    params = b.params.copy()
    params[b.lens.index("k3")] += 0.5
    seen = np.array([[220.0, 160], [420, 160], [420, 320], [220, 320]])
    return [Side(n, c, points=seen) for n, c in (("a", a), ("b", replace(b, params=params)))]


def test_gates_look_at_the_part_that_both_cameras_have_data_for():
    found = compare(*beyond(), BOX)
    inside = found.inside
    assert found.difference.max_px > 5 > 0.2 > inside.max_px >= inside.p95_px >= inside.rms_px > 0
    assert 220 <= inside.worst[0] <= 420 and 160 <= inside.worst[1] <= 320
    assert inside.pixels == found.supported.sum() < len(found.supported)
    names = [g.name for g in gates([found], [], max_px=0.2, max_rms_px=0.1, max_p95_px=0.2) if g.passed]
    assert names == [
        "projection at infinity",
        "rms of projection at infinity",
        "95th percentile of projection at infinity",
    ]


def test_a_gate_that_falls_names_the_pixel():
    (gate,) = gates([compare(*beyond(), BOX)], [], max_px=1e-9)
    assert gate.place == compare(*beyond(), BOX).inside.worst
    said = sentence(described(*beyond(), [compare(*beyond(), BOX)], [], [gate])["gates"][0])
    assert f"at pixel ({gate.place[0]:.0f}, {gate.place[1]:.0f})" in said


def test_no_common_part_falls():
    a, b = beyond()
    b = replace(b, points=np.array([[500.0, 400], [600, 400], [600, 460]]))
    (gate,) = gates([compare(a, b, BOX)], [], max_px=1e6)
    assert not gate.passed and gate.place is None
    assert "no part of the picture" in sentence(described(a, b, [], [], [gate])["gates"][0])
