"""Pairs judged on pictures of anything: a right calibration is found right, and a wrong one cannot hide."""

import numpy as np
import pytest

from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rectification import rectify
from camcal.routes.natural import NEAR, judge, turn_of

SIZE = (640, 480)
LENS = lenses.make("opencv5")
POSE = Pose.from_vector(np.array([0.01, 0.03, -0.02]), np.array([-60.0, 1, 2]))


def camera(**changed):
    values = {"fx": 530.0, "fy": 530.0, "cx": 322.0, "cy": 238.0, "k1": -0.28, "k2": 0.08}
    return Camera(LENS, LENS.from_values(values | changed), SIZE)


def matched(left, right, pose, wrong=60, noise=0.1, seed=0):
    """400 matches of a scene with depth, some of them wrong."""
    rng = np.random.default_rng(seed)
    xyz = np.c_[rng.uniform(-0.6, 0.6, 3000), rng.uniform(-0.45, 0.45, 3000), np.ones(3000)]
    xyz *= rng.uniform(500, 4000, (3000, 1))
    uv1, uv2 = left.project(xyz), right.project(pose.apply(xyz))
    good = np.all([(p > 0).all(1) & (p < np.array(SIZE) - 1).all(1) for p in (uv1, uv2)], 0)
    uv1, uv2 = (p[good][:400] + rng.normal(0, noise, (400, 2)) for p in (uv1, uv2))
    uv2[:wrong] = rng.uniform(0, 1, (wrong, 2)) * SIZE
    return uv1, uv2


def medians(found):
    return [float(np.median(np.abs(x[found.good]))) for x in (found.vertical, found.noise)]


def test_a_right_calibration():
    found = judge(rectify(camera(), camera(), POSE), *matched(camera(), camera(), POSE))
    assert 330 <= found.good.sum() <= 350 and not found.good[:60].sum() > 8
    off, noise = medians(found)
    # 0.6745 sqrt(2) 0.1 px of two points with 0.1 px each; removing the distortion stretches pictures by up to 1.3
    assert off == pytest.approx(0.105, rel=0.15) and noise == pytest.approx(off, rel=0.15)


@pytest.mark.parametrize(
    ("turn", "shift", "changed"),
    [
        ([0.01, 0, 0], [0, 0, 0], {}),
        ([0, 0, 0.02], [0, 0, 0], {}),
        ([0, 0, 0], [0, 3.0, 0], {}),
        ([0, 0, 0], [0, 0, 0], {"cy": 244.0}),
        ([0, 0, 0], [0, 0, 0], {"fx": 545.0, "fy": 545.0}),
        ([0, 0, 0], [0, 0, 0], {"k1": -0.23}),
    ],
)
def test_a_wrong_calibration_keeps_its_matches_and_shows_its_error(turn, shift, changed):
    """A turn, a shift, a principal point, a focal length, a distortion of the right camera that is not so."""
    truth = matched(camera(), camera(), POSE, wrong=60)
    wrong = Pose.from_vector(np.array(turn, float), np.array(shift, float)) @ POSE
    found = judge(rectify(camera(), camera(**changed), wrong), *truth)
    exact = rectify(camera(), camera(**changed), wrong)
    expected = np.median(np.abs(exact.disparities(*(p[60:] for p in truth))[1]))
    assert found.good[60:].sum() > 0.93 * 340
    off, noise = medians(found)
    assert off == pytest.approx(expected, rel=0.1) and off > 2 * noise


def test_what_agrees():
    """On both sides of the limit, where the matches are exact."""
    pair = rectify(camera(), camera(), POSE)
    first, second = matched(camera(), camera(), POSE, wrong=0, noise=0.0)
    for row, size in ((0, 1.0), (1, 2.0)):
        second[row, 1] += size * NEAR  # of the distance, which both points share, 0.7
    found = judge(pair, first, second)
    assert found.good[0] and not found.good[1] and found.good[2:].all()


def test_a_wide_pair():
    lens = lenses.make("kb4")
    wide = Camera(lens, lens.from_values({"fx": 180.0, "fy": 180.0, "cx": 319.5, "cy": 319.5}), (640, 640))
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(400, 3))
    xyz[:, 2] = np.abs(xyz[:, 2])
    xyz *= rng.uniform(300, 2000, (400, 1)) / np.linalg.norm(xyz, axis=1, keepdims=True)
    uv1, uv2 = wide.project(xyz), wide.project(POSE.apply(xyz))
    seen = np.isfinite(uv1).all(1) & np.isfinite(uv2).all(1)
    pair = rectify(wide, wide, POSE)
    found = judge(pair, uv1[seen], uv2[seen])
    assert found.good.all() and np.abs(found.vertical).max() < 1e-6
    turned = Pose.from_vector(np.array([0.02, 0, 0]), np.zeros(3)) @ POSE
    found = judge(rectify(wide, wide, turned), uv1[seen], uv2[seen])
    assert found.good.mean() > 0.97 and medians(found)[0] > 1


def test_too_few_matches():
    pair = rectify(camera(), camera(), POSE)
    with pytest.raises(DataError, match="7 points were found in both pictures; 8 are needed"):
        judge(pair, *(p[:7] for p in matched(camera(), camera(), POSE, wrong=0)))


@pytest.mark.parametrize("turn", [(0.005, 0, 0), (0.0, 0.01, 0.004), (-0.003, 0.002, 0.02), (0, 0, 0)])
def test_the_turn_of_a_knocked_camera_is_found(turn):
    moved = Pose(rotations.exp(np.array(turn)), np.zeros(3)) @ POSE  # about its own centre
    truth = matched(camera(), camera(), moved, wrong=0)
    found = turn_of(rectify(camera(), camera(), POSE), *truth)
    assert np.abs((found.vector - turn) / found.sigma).max() < 4
    assert found.sigma.max() < 0.01 and found.left < 0.13
