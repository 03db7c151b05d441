"""Samples that robust searches of the routes draw, and the points and pairs that they use, each from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from camcal.data.observations import View
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import (
    epipolar,
    lifted,
    lines,
    natural,
    outliers,
    pose,
    scene_start,
    scene_vote,
    triangulate,
    wand,
)
from camcal.routes.hand_eye.estimate import Estimate
from camcal.routes.line_geometry import Lines
from tests.contracts.test_limits_of_work import two_views
from tests.routes import test_scene

SIZE = (1000, 800)
PINHOLE = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)


# ------------------------------------------------------------------------------------ samples
def points_of_a_pose():
    """In how many of ten views one of nine wrong points of twenty counts as right, or many right ones as wrong."""
    failed = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        xyz = rng.uniform(-1, 1, (20, 3))
        uv = PINHOLE.project(Pose(rotations.exp(rng.normal(size=3)), np.array([0, 0, 5.0])).apply(xyz))
        uv += rng.normal(0, 0.3, uv.shape)
        uv[:9] = rng.uniform(0, SIZE, (9, 2))
        found = outliers.consensus(PINHOLE, View("a", xyz, uv), PINHOLE.unproject(uv), seed)
        failed += bool(found[:9].any() or found[9:].sum() < 9)
    return failed


def points_of_two_views():
    """The same of ten searches for a fundamental matrix with a third of the matches wrong."""
    uv = [np.c_[q, np.ones(len(q))] for q in two_views()]
    a, b = (q / (1000, 1000, 1) for q in uv)
    found = [epipolar.agreeing(a, b, 0.5e-3, seed)[1] for seed in range(10)]
    return sum(bool(good[80:].mean() > 0.25 or good[:80].mean() < 0.8) for good in found)


def frames_of_a_room():
    """In how many of ten the best frame of a room with clutter is off by 15 % of the focal length."""
    made = test_scene.room(test_scene.CORNER, clutter=19)
    ends = scene_vote.seen_lines(made, False).ends
    ends = ends[np.argsort(-np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))]
    found = [scene_start.frames(ends, np.array([331.0, 236]), 640.0, seed) for seed in range(10)]
    return sum(not frames or abs(frames[0][0] / 800 - 1) > 0.15 for frames in found)


@pytest.mark.parametrize(
    ("failed", "module", "few"),
    [
        (points_of_a_pose, outliers, 4),
        (points_of_two_views, epipolar, 4),
        (frames_of_a_room, scene_start, 40),
    ],
)
def test_samples_of_which_one_is_free_of_wrong_ones(monkeypatch, failed, module, few):
    assert failed() == 0
    monkeypatch.setattr(module, "SAMPLES", few)
    assert failed() >= 3


# ------------------------------------------------------------------------------------ points and pairs that are used
@pytest.mark.parametrize(("count", "used"), [(2000, 2000), (2001, 1001)])
def test_points_that_select_the_pose(monkeypatch, count, used):
    class Asked(Exception):
        pass

    def candidates(xyz, *_):
        assert len(xyz) == used
        raise Asked

    xyz = np.random.default_rng(0).uniform(-1, 1, (count, 3)) + (0, 0, 5)
    view = View("a", xyz, PINHOLE.project(xyz))
    monkeypatch.setattr(pose.absolute_pose, "candidates", candidates)
    with pytest.raises(Asked):
        pose._solutions(PINHOLE, view, xyz, np.ones(count, bool))


@pytest.mark.parametrize(("pairs", "used"), [(6, 6), (7, 6)])
def test_pairs_that_tell_a_distortion(monkeypatch, pairs, used):
    asked = []
    monkeypatch.setattr(
        lifted, "_robust", lambda _, first, *__: asked.append(len(first)) or (1.0, np.ones(len(first), bool))
    )
    assert lifted.of_matches([(np.zeros((20 + i, 2)),) * 2 for i in range(pairs)], SIZE).kind == "pinhole"
    assert sorted(set(asked)) == list(range(20, 20 + used))


@pytest.mark.parametrize(("points", "enough"), [(4, True), (3, False)])
def test_points_of_a_line(points, enough):
    made = Lines.of([np.c_[np.arange(n), np.full(n, 50.0)] for n in (9, points)], "ab", SIZE)
    if enough:
        lines._check(made)
    else:
        with pytest.raises(DataError, match="2 lines of 4 points"):
            lines._check(made)


@pytest.mark.parametrize(("share", "lost"), [(0.8, 1), (1.25, 0)])
def test_directions_that_lines_leave_undetermined(share, lost):
    """Two parameters with the correlation c: the lines move by the root of (1 - c) / (1 + c) along their difference."""
    left = (share * 1e-7) ** 2
    c = (1 - left) / (1 + left)
    assert lines._basis(50 * np.array([[1.0, c], [c, 1.0]]), np.eye(2), 50)[1].shape == (2, lost)


def test_neighbours_that_tell_the_systematic_part():
    """Eight: a value that no other has is compared with their mean, and has 1 / 8 of a part in that of each."""
    places = np.c_[np.arange(40.0), np.zeros((40, 2))]
    found = natural.local_scatter(places, np.eye(40)[20]) * np.sqrt(1 + 1 / 8)
    assert found[20] == pytest.approx(1) and sorted(set(found.round(9))) == [-0.125, 0, 1]


def test_the_level_of_the_intervals_of_a_robot():
    made = SimpleNamespace(freedom=np.array([10.0]), sigma=np.array([2.0]))
    assert Estimate.half_width.fget(made) == pytest.approx(2 * stats.t.isf(0.025, 10))


# ------------------------------------------------------------------------------------ two views
@pytest.mark.parametrize(("share", "agrees"), [(0.999, True), (1.001, False)])
def test_matches_within_some_deviations(monkeypatch, share, agrees):
    """Of thirty, one is off by 3.5 robust standard deviations of the others; 1 + 5 / (n - p) corrects small samples."""
    off = np.r_[np.tile([0.5, 1.0, 1.5], 10)[:29], share * 3.5 * 1.482602218505602 * (1 + 5 / 23)]
    assert np.median(off) == 1
    monkeypatch.setattr(epipolar, "ROUNDS", 1)
    monkeypatch.setattr(epipolar, "sampson", lambda f, *_: np.tile(off, (len(f), 1)))
    monkeypatch.setattr(epipolar, "_weighted", lambda f, *_: f)
    points = np.random.default_rng(0).uniform(size=(30, 3))
    assert epipolar.agreeing(points, points, 0.0)[1].tolist() == [True] * 29 + [agrees]


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_matches_near_an_epipole(monkeypatch, share):
    """Their gradient is taken for a thousandth of the median at least."""
    roots = []
    matches = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 9, 2))
    monkeypatch.setattr(lifted, "_gradient", lambda *_: np.r_[np.ones(8), share * 1e-3])
    monkeypatch.setattr(
        lifted.epipolar,
        "linear",
        lambda _, __, given=None: np.eye(3) if given is None else roots.append(given) or np.eye(3),
    )
    lifted._off(lifted.division(0.0), [tuple(matches)])
    assert roots[0][-1] == pytest.approx(1e3 / max(share, 1.0), rel=1e-9)


# ------------------------------------------------------------------------------------ the first noise
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_the_least_noise_of_triangulated_points(share):
    """That of coordinates that are rounded in the ninth digit of a px."""
    costs = np.full(5, share * 1e-18 * stats.chi2.ppf(0.5, 3))
    assert triangulate._scale(costs, np.full(5, 3)) == pytest.approx(max(share, 1.0) * 1e-18, rel=1e-9)


def test_the_noise_that_bars_leave_in_the_residuals(monkeypatch):
    """Three of the eight coordinates of a bar in two cameras: residuals with the median of σ = 1 have √(8/3)."""

    class Asked(Exception):
        pass

    def reach(_, sigma, __):
        raise Asked(sigma)

    monkeypatch.setattr(wand, "replace", lambda found, **_: found)
    monkeypatch.setattr(wand, "_frees", lambda *_: None)
    monkeypatch.setattr(wand, "reach", reach)
    moving = SimpleNamespace(cameras=(), residuals=lambda _: np.tile([np.sqrt(2 * np.log(2)), 0.0], (9, 1)))
    with pytest.raises(Asked) as found:
        wand._result(moving, (), range(9), (), ())
    assert found.value.args[0] == pytest.approx(np.sqrt(8 / 3))
