"""Rectified pairs: rows agree, disparities are positive, Q gives the depth back, cv2 finds the same rotations."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.errors import EstimationError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rectification import LATITUDE_LONGITUDE, PERSPECTIVE, WIDE, aligned, rectify

SIZE = (640, 480)


def camera(spec="opencv5", f=530.0, size=SIZE, **more):
    lens = lenses.make(spec)
    middle = {"cx": size[0] / 2 - 3.0, "cy": size[1] / 2 + 4.0}
    return Camera(lens, lens.from_values({"fx": f, "fy": f + 2, **middle, **more}), size)


LEFT, RIGHT = camera(k1=-0.28, k2=0.05), camera(f=540.0, k1=-0.3, k2=0.1, p1=0.001)
FISHEYE = camera("kb4", 180.0, (640, 640), k1=0.01, k2=-0.002)

turns = st.tuples(*[st.floats(-0.25, 0.25)] * 3).map(np.array)
#: the other camera on the right or below, up to 30 degrees beside the axis, with some shift in depth
shifts = st.tuples(st.floats(0.5, 80), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.booleans()).map(
    lambda v: -v[0] * np.array([v[1], 1.0, v[2]] if v[3] else [1.0, v[1], v[2]])
)


def points(count=200, seed=0):
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-1.5, 1.5, (count, 2)), np.ones(count)] * rng.uniform(200, 5000, (count, 1))


def seen(pair, pose, xyz):
    """Images of points of the first camera's frame in both pictures, and those in them."""
    uv = pair.cameras[0].project(xyz), pair.cameras[1].project(pose.apply(xyz))
    good = np.all([np.isfinite(p).all(1) & (p > 0).all(1) & (p < np.array(SIZE) - 1).all(1) for p in uv], 0)
    return uv[0][good], uv[1][good], xyz[good]


@settings(max_examples=60, deadline=None)
@given(turns, shifts)
def test_rows_agree_and_disparities_are_positive(turn, shift):
    pose = Pose.from_vector(turn, shift)
    try:
        pair = rectify(LEFT, RIGHT, pose, projection=PERSPECTIVE)
    except EstimationError:
        return  # such a turn leaves nothing that both show, or shows the other camera
    uv1, uv2, xyz = seen(pair, pose, points())
    along, across = pair.disparities(uv1, uv2)
    kept = np.isfinite(across)
    np.testing.assert_allclose(across[kept], 0, atol=1e-6)  # the inverse of the distortion ends at 1e-9 px
    assert (along[kept] > 0).all()
    own = pair.rectified(0, uv1)[kept]
    back = np.c_[own, along[kept], np.ones(kept.sum())] @ pair.matrices()["Q"].T
    expected = xyz[kept] @ pair.turns[0].T
    np.testing.assert_allclose(back[:, :3] / back[:, 3:], expected, rtol=1e-4)


@settings(max_examples=40, deadline=None)
@given(turns, shifts)
def test_the_rotations_are_those_of_cv2(turn, shift):
    compare_rotations(turn, shift, 2e-5)  # cv2.Rodrigues takes 1e-5 rad for 0


@pytest.mark.parametrize("shift", [[-60.0, 3, 2], [3.0, -60, 2], [60.0, 3, -2], [3.0, 60, 2]])
def test_the_rotations_are_those_of_cv2_to_all_digits(shift):
    compare_rotations(np.array([0.02, 0.05, -0.01]), np.array(shift), 1e-14)


def compare_rotations(turn, shift, tolerance):
    pose = Pose.from_vector(turn, shift)
    ours, along, axis = aligned(pose)
    k, d = LEFT.opencv()
    r1, r2, _, p2, *_ = cv2.stereoRectify(k, d, k, d, SIZE, pose.rotation, pose.translation.reshape(3, 1))
    np.testing.assert_allclose(ours, [r1, r2], rtol=0, atol=tolerance)
    assert p2[axis, 3] / p2[0, 0] == pytest.approx(along, rel=1e-12)
    assert np.linalg.norm(shift) == pytest.approx(abs(along), rel=1e-12)
    assert p2[1 - axis, 3] == 0


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_the_matrices_are_like_those_of_cv2(alpha):
    """Scale and centre are chosen a little differently: within 2 % and 10 px of a picture 640 px wide."""
    pose = Pose.from_vector(np.array([0.02, 0.05, -0.01]), np.array([-60.0, 3, 2]))
    made = rectify(LEFT, RIGHT, pose, alpha).matrices()
    k = [*LEFT.opencv(), *RIGHT.opencv()]
    theirs = cv2.stereoRectify(*k, SIZE, pose.rotation, pose.translation.reshape(3, 1), alpha=alpha)
    for ours, cv in zip((made["P1"], made["P2"], made["Q"]), theirs[2:5], strict=True):
        assert ours.shape == cv.shape
        np.testing.assert_array_equal(ours == 0, cv == 0)
        np.testing.assert_allclose(ours[0, 3], cv[0, 3], rtol=0.03)
    assert made["P1"][0, 0] == pytest.approx(theirs[2][0, 0], rel=0.03)
    np.testing.assert_allclose(made["P1"][:2, 2], theirs[2][:2, 2], atol=10)


def test_it_fits_on_a_line():
    pose = Pose.from_vector(np.zeros(3), np.array([-60.0, 0, 0]))
    said = repr(rectify(camera(), camera(), pose))
    assert said == "<Rectification horizontal, perspective, 531 px, 640x480>"


def test_alpha_says_what_is_black():
    pose = Pose.from_vector(np.array([0.02, 0.05, -0.01]), np.array([-60.0, 3, 2]))
    black = {}
    for alpha in (0, 1):
        pair = rectify(LEFT, RIGHT, pose, alpha)
        black[alpha] = [float((pair.maps(side)[0] == -1).mean()) for side in (0, 1)]
        if alpha == 1:
            for side, own in enumerate((LEFT, RIGHT)):
                corners = np.array([[0, 0], [639, 0], [0, 479], [639, 479], [320, 0], [0, 240.0]])
                there = pair.rectified(side, corners)
                assert (there > -0.5).all() and (there < np.array(own.image_size) - 0.5).all()
    assert black[0] == [0, 0] and min(black[1]) > 0.01


def test_the_scale_is_kept_by_default():
    pose = Pose.from_vector(np.zeros(3), np.array([-60.0, 0, 0]))
    pair = rectify(camera(), camera(f=600.0), pose)
    assert pair.focal == pytest.approx(np.sqrt(530 * 532))
    assert rectify(camera(), camera(f=600.0), pose, size=(320, 240)).focal == pytest.approx(pair.focal / 2)


def test_maps_lead_from_the_rectified_picture_to_the_one_taken():
    pose = Pose.from_vector(np.array([0.02, 0.05, -0.01]), np.array([-60.0, 3, 2]))
    pair = rectify(LEFT, RIGHT, pose)
    for side in (0, 1):
        u, v = pair.maps(side)
        assert u.dtype == np.float32 and u.shape == (480, 640)
        again = pair.rectified(side, np.array([u[200, 301], v[200, 301]], float))
        np.testing.assert_allclose(again, [301, 200], atol=1e-3)  # float32 of 640 px


def test_wide_lenses_are_rectified_by_latitude_and_longitude():
    pose = Pose.from_vector(np.array([0.02, -0.1, 0.03]), np.array([-60.0, 3, 2]))
    pair = rectify(FISHEYE, FISHEYE, pose)
    assert pair.projection == LATITUDE_LONGITUDE and set(pair.matrices()) == {"R1", "R2"}
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(500, 3))
    rays[:, 2] = np.abs(rays[:, 2]) - 0.1  # beside and a little behind the cameras, too
    xyz = rays / np.linalg.norm(rays, axis=1, keepdims=True) * rng.uniform(300, 3000, (500, 1))
    uv1, uv2 = FISHEYE.project(xyz), FISHEYE.project(pose.apply(xyz))
    along, across = pair.disparities(uv1, uv2)
    kept = np.isfinite(across)
    assert kept.sum() > 300
    np.testing.assert_allclose(across[kept], 0, atol=1e-6)
    assert (along[kept] > 0).all()
    # the law of sines of docs/stereo.md
    latitude = [
        (pair.rectified(i, uv)[kept, 0] - pair.centre[0]) / pair.focal for i, uv in enumerate((uv1, uv2))
    ]
    distance = -pair.shift * np.cos(latitude[1]) / np.sin(latitude[0] - latitude[1])
    np.testing.assert_allclose(distance, np.linalg.norm(xyz[kept], axis=1), rtol=1e-5)
    assert np.isfinite(pair.maps(0)[0]).all()


@pytest.mark.parametrize(("degrees", "projection"), [(-1, PERSPECTIVE), (1, LATITUDE_LONGITUDE)])
def test_auto_goes_by_the_angle(degrees, projection):
    half = WIDE + np.radians(degrees)
    lens = lenses.make("pinhole")
    f = np.hypot(319.5, 239.5) / np.tan(half)
    own = Camera(lens, lens.pinhole(f, f, 319.5, 239.5), SIZE)
    assert rectify(own, own, Pose(np.eye(3), np.array([-1.0, 0, 0]))).projection == projection


@pytest.mark.parametrize(
    ("shift", "turn", "words"),
    [
        ([0.0, 0, 0], [0.0, 0, 0], "same position"),
        ([0.02, 0, -1.0], [0.0, 0, 0], "behind the other"),
        ([-1.0, 0, 0], [0.0, 2.5, 0], "different directions"),
    ],
)
def test_what_cannot_be_rectified(shift, turn, words):
    with pytest.raises(EstimationError, match=words):
        rectify(LEFT, RIGHT, Pose.from_vector(np.array(turn), np.array(shift)), projection=PERSPECTIVE)


def test_the_size_of_the_pictures_is_needed():
    with pytest.raises(UsageError, match="no image size"):
        rectify(Camera(LEFT.lens, LEFT.params), RIGHT, Pose(np.eye(3), np.array([-1.0, 0, 0])))
