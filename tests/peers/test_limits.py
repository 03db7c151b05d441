"""Bounds of single comparisons with cv2: how far camcal and cv2 may be apart, each just below and just above."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.data.observations import Observations
from camcal.geometry import projective, rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.peers import (
    hand_eye,
    project_points,
    register_cameras,
    rodrigues,
    solve_pnp,
    stereo_calibrate,
    two_views,
    undistort_points,
)
from camcal.peers.base import NotComparableError
from tests.sides import LESS, MORE
from tests.solved import solved

CAMERA = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), (1000, 800))


@pytest.fixture(scope="module")
def good():
    return solved(views=4)


# ------------------------------------------------------------------------------------ rounding
def test_projections_of_points(good, monkeypatch):
    found = cv2.projectPoints
    for share, status in ((0.9, "pass"), (1.1, "fail")):  # of 1e-8 px; rounding of both is 1e-12 px

        def moved(*args, share=share):
            uv, more = found(*args)
            return uv + share * project_points.BOUND_PX, more

        monkeypatch.setattr(cv2, "projectPoints", moved)
        assert project_points.of_solution(good)["status"] == status


def test_projections_by_a_matrix(monkeypatch):
    """What is allowed grows with the condition of the matrix, beyond that of a focal length of 1000 px."""
    view = SimpleNamespace(xyz=np.random.default_rng(0).normal(size=(9, 3)), uv=np.zeros((9, 2)))
    monkeypatch.setattr(project_points, "judge", lambda _, bound, __: (bound, None))
    for condition in (
        LESS * project_points.ORDINARY,
        MORE * project_points.ORDINARY,
        5 * project_points.ORDINARY,
    ):
        monkeypatch.setattr(np.linalg, "cond", lambda _, c=condition: c)
        matrix = CAMERA.matrix @ np.c_[np.eye(3), [0, 0, 9.0]]
        bound = project_points.of_matrix("dlt", matrix, view)["status"]
        assert bound == pytest.approx(project_points.BOUND_PX * max(1.0, condition / project_points.ORDINARY))


def test_undistorted_points(monkeypatch):
    uv = np.random.default_rng(0).uniform(100, 700, (20, 2))
    found = cv2.undistortPoints
    for share, status in ((0.9, "pass"), (1.1, "fail")):  # of 1e-6 px; rounding is 1e-13 px

        def moved(*args, share=share):
            return found(*args) + [share * undistort_points.BOUND_PX / 800, 0]

        monkeypatch.setattr(cv2, "undistortPoints", moved)
        assert undistort_points.against_cv2("refine", CAMERA, uv)["status"] == status


@pytest.mark.parametrize(("share", "status"), [(0.9, "pass"), (1.1, "fail")])
def test_rotations(monkeypatch, share, status):
    found = cv2.Rodrigues

    def moved(value):
        out, more = found(value)
        return (out + share * rodrigues.BOUND if value.ndim == 1 else out), more

    monkeypatch.setattr(cv2, "Rodrigues", moved)
    poses = Poses(rotations.exp(np.array([[0.1, 0.2, 0.3]])), np.zeros((1, 3)))
    assert rodrigues.against_cv2(poses, "refine")["status"] == status


def test_rotations_that_cv2_rounds(monkeypatch):
    """Near 0 the vector of a matrix is not compared."""
    found = cv2.Rodrigues
    asked = []
    monkeypatch.setattr(cv2, "Rodrigues", lambda v: asked.append(v.ndim) or found(v))
    for share, compared in ((LESS, 0), (MORE, 1)):
        asked.clear()
        turn = rotations.exp(np.array([[share * rodrigues.SNAPS, 0, 0]]))
        rodrigues.against_cv2(Poses(turn, np.zeros((1, 3))), "refine")
        assert asked.count(2) == compared


# ------------------------------------------------------------------------------------ two views
@pytest.mark.parametrize(
    ("ours", "theirs", "status"),
    [
        (LESS * (1 + two_views.WORSE), 1.0, "pass"),
        (MORE * (1 + two_views.WORSE), 1.0, "fail"),
        (LESS * two_views.EXACT, 0.0, "pass"),
        (MORE * two_views.EXACT, 0.0, "fail"),
    ],
)
def test_fundamental_matrices(monkeypatch, ours, theirs, status):
    monkeypatch.setattr(cv2, "findFundamentalMat", lambda *_: (np.eye(3), None))
    rms = iter((ours, theirs))
    monkeypatch.setattr(two_views, "_sampson_rms", lambda *_: next(rms))
    found = two_views.fundamental(np.zeros((9, 2)), np.zeros((9, 2)), np.eye(3))
    assert found["status"] == status


@pytest.mark.parametrize(("share", "status"), [(LESS, "pass"), (MORE, "fail")])
def test_the_motion_of_two_views(monkeypatch, share, status):
    theirs = rotations.exp(np.radians([share * two_views.TURN, 0, 0]))
    monkeypatch.setattr(cv2, "findEssentialMat", lambda *_: (np.eye(3), None))
    monkeypatch.setattr(cv2, "recoverPose", lambda *_, **__: (0, theirs, np.zeros(3), None))
    uv = np.full((9, 2), 450.0)
    found = two_views.motion(CAMERA, uv, uv, Pose(np.eye(3), np.zeros(3)))
    assert found["status"] == status


# ------------------------------------------------------------------------------------ hand-eye, planes, pairs
@pytest.mark.parametrize("name", ["tsai", "park"])
def test_closed_forms_of_hand_eye(monkeypatch, name):
    """Some weigh the motions in another way; exact data have standard deviations of 0."""
    function, method = hand_eye.METHODS[name]
    monkeypatch.setattr(cv2, function, None, raising=False)
    monkeypatch.setattr(cv2, method, 0, raising=False)
    bound = hand_eye.SIGMAS if name in hand_eye.WEIGHED else hand_eye.ROUNDING
    for sigma in (0.01, 0.0):
        for share, status in ((LESS, "pass"), (MORE, "fail")):
            limit = share * bound * (sigma + hand_eye.LEAST_SIGMA * np.array([1.0, 2.0]))
            turned = Pose(rotations.exp(np.array([limit[0], 0, 0])), np.zeros(3))
            moved = Pose(np.eye(3), np.array([limit[1], 0, 0]))
            for theirs in (turned, moved) if limit[0] > 1e-6 else (moved,):  # smaller angles are rounding
                monkeypatch.setattr(hand_eye, "_theirs", lambda *_, p=theirs: p)
                here = Pose(np.eye(3), np.zeros(3))
                found = hand_eye._entry(name, None, None, 2.0, here, (sigma, sigma))
                assert found["status"] == status
    for share, status in ((LESS, "pass"), (MORE, "fail")):
        monkeypatch.setattr(hand_eye, "_theirs", lambda *_: here)
        monkeypatch.setattr(
            hand_eye.rotations, "angle_between", lambda *_, s=share: s * bound * hand_eye.LEAST_SIGMA
        )
        assert hand_eye._entry(name, None, None, 2.0, here, (0.0, 0.0))["status"] == status


def test_points_that_count_as_a_plane():
    """Each point above and below the plane."""
    xy = np.random.default_rng(0).normal(size=(20, 2))
    xyz = np.r_[np.c_[xy, np.ones(20)], np.c_[xy, -np.ones(20)]]
    spread = projective.fit_plane(xyz * [1, 1, 1e-3])[2]
    for share, planar in ((LESS, True), (MORE, False)):
        flat = xyz * [1, 1, 1e-3 * share * solve_pnp.PLANE * spread[0] / spread[2]]
        assert bool(solve_pnp._in_own_frame(flat)[0]) == planar


def test_instants_of_a_pair(monkeypatch):
    monkeypatch.setattr(cv2, "registerCameras", None, raising=False)
    monkeypatch.setattr(register_cameras, "_model", lambda _: None)

    class Enough(Exception):
        pass

    def with_reference(_):
        raise Enough

    rig = SimpleNamespace(cameras={"a": None, "b": None}, with_reference=with_reference)
    least = stereo_calibrate.LEAST_INSTANTS
    for count, error in ((least, Enough), (least - 1, NotComparableError)):
        monkeypatch.setattr(register_cameras, "_of_pair", lambda *_, n=count: (None, np.arange(n)))
        with pytest.raises(error):
            register_cameras.registered(SimpleNamespace(rig=rig), "a", "b", least)


def test_points_of_an_instant_of_a_pair():
    """A picture of fewer points has no pose in cv2, so that its instant is left out."""
    least = register_cameras.LEAST_POINTS
    for count, instants in ((least, [0, 1]), (least - 1, [1])):
        camera = np.r_[np.zeros(count, int), np.ones(9, int), np.zeros(9, int), np.ones(9, int)]
        view = np.r_[np.zeros(count + 9, int), np.ones(18, int)]
        rows = len(view)
        data = Observations(
            xyz=np.zeros((rows, 3)),
            uv=np.zeros((rows, 2)),
            view=view,
            view_ids=("a", "b"),
            camera=camera,
            cameras=("left", "right"),
            image_sizes=((9, 9), (9, 9)),
        )
        found = register_cameras._of_pair(SimpleNamespace(observations=data), "left", "right")[1]
        assert found.tolist() == instants
