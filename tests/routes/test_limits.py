"""Limits of the routes, each just below and just above."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.routes import (
    epipolar,
    line_start,
    lines,
    picture_tracks,
    reconstruct,
    scene_vote,
    selfcalib,
    wand_start,
)
from camcal.routes.bundle import Tracks
from camcal.routes.hand_eye import estimate, pictures, recognise
from camcal.routes.wand_start import Link
from tests.sides import LESS, MORE


def pinhole(focal=800.0, size=(1000, 800)):
    return Camera(lenses.make("pinhole"), np.array([focal, focal, size[0] / 2, size[1] / 2]), size)


# ------------------------------------------------------------------------------------ two views
def two_views(points, angle, noise=0.0, off=0.0, seed=0):
    """Images (N, 2) of points at a distance of 10 in two views whose rays meet at an angle."""
    rng = np.random.default_rng(seed)
    xyz = np.c_[rng.uniform(-3, 3, (points, 2)), rng.uniform(9, 11, points)]
    other = xyz - (10 * np.tan(angle), 0.0, 0.0)
    camera = pinhole()
    return camera.project(xyz), camera.project(other) + rng.normal(0, noise, (points, 2))


def tracks_of(first, second):
    count = len(first)
    return Tracks(np.repeat([0, 1], count), np.tile(np.arange(count), 2), np.concatenate([first, second]))


def test_matches_of_two_views():
    least = epipolar.LEAST_MATCHES
    for count, pairs in ((least, 1), (least - 1, 0)):
        assert len(reconstruct.pairs(tracks_of(*two_views(count, 0.3)), 2)) == pairs


def one_pair(points, angle):
    """The points that the first pair places, 0 where it cannot begin."""
    first, second = two_views(points, angle)
    tracks = tracks_of(first, second)
    camera = pinhole()
    (pair,) = reconstruct.pairs(tracks_of(first, second), 2)
    made = reconstruct.first_pair([pair], camera, tracks, reconstruct.empty(camera, 2, points))
    return 0 if made is None else int(made[1].known_points.sum())


def test_rays_that_place_a_point_of_two_views(monkeypatch):
    """All points meet at an angle between two limits."""
    found = epipolar.two_view_points

    def flat(motion, first, second, angle):
        points, _ = found(motion, first, second)
        return points, np.full(len(points), angle)

    for share, placed in ((LESS, 0), (MORE, 20)):
        angle = share * epipolar.LEAST_ANGLE
        monkeypatch.setattr(epipolar, "two_view_points", lambda *a, at=angle: flat(*a, at))
        assert one_pair(20, 0.3) == placed


def test_points_of_the_first_pair(monkeypatch):
    found = epipolar.two_view_points
    least = reconstruct.LEAST_KNOWN
    for count, placed in ((least, least), (least - 1, 0)):

        def some(motion, first, second, n=count):
            points, _ = found(motion, first, second)
            return points, np.where(np.arange(len(points)) < n, 0.5, 0.0)

        monkeypatch.setattr(epipolar, "two_view_points", some)
        assert one_pair(20, 0.3) == placed


def test_points_that_are_placed_at_an_angle():
    camera = pinhole()
    for share, placed in ((0.99, False), (1.01, True)):
        angle = share * epipolar.LEAST_ANGLE
        point = np.array([[0.0, 0.0, 10.0]])
        side = np.array([-10 * np.tan(angle), 0.0, 0.0])
        bundle = reconstruct.empty(camera, 2, 1)
        bundle.translations[:] = (0.0, 0.0, 0.0), side
        made = reconstruct.with_points(bundle, tracks_of(camera.project(point), camera.project(point + side)))
        assert made.known_points[0] == placed


def test_complex_roots_of_noise(monkeypatch):
    """Kruppa's equations of an exact pair have a double root where both views turn about one point."""
    for share, known in ((LESS, True), (MORE, False)):
        roots = np.array(
            [0.64 * (1 + 1j * share * epipolar.COMPLEX), 0.64 * (1 - 1j * share * epipolar.COMPLEX)]
        )
        monkeypatch.setattr(np, "roots", lambda _, r=roots: r)
        matrix = np.array([[0, -1.0, 0.2], [1, 0, -0.5], [-0.1, 0.6, 0]])
        focal = epipolar.kruppa(matrix[None], np.array([0.0, 0.0]), 1000.0)
        assert np.isfinite(focal[0]) == known
        if known:
            assert focal[0] == pytest.approx(800.0)


def test_a_camera_that_only_turned():
    """The second view is moved by a part of a pixel: off a homography it is so many times as far as off F."""
    rng = np.random.default_rng(2)
    first = rng.uniform(100, 900, (60, 2))
    sign = np.where(np.arange(60) % 2, 1.0, -1.0)
    second = first + np.c_[2.0 * sign, np.zeros(60)]  # along the epipolar lines, u
    matrix = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # v' = v
    pair = SimpleNamespace(
        matches=np.stack([np.arange(60), 60 + np.arange(60)], 1), agree=np.ones(60, bool), matrix=matrix
    )

    def alone(across):
        moved = second + np.c_[np.zeros(60), across * np.where(np.arange(60) % 4 < 2, 1.0, -1.0)]
        return selfcalib._rotation_alone([pair], np.concatenate([first, moved]))

    # homography's distances are about hypot(2, d), Sampson's d / sqrt(2)
    limit = 2 / np.sqrt(selfcalib.PARALLAX**2 / 2 - 1)
    assert alone(1.1 * limit) and not alone(0.9 * limit)


# ------------------------------------------------------------------------------------ pictures
def test_the_number_of_pictures(monkeypatch):
    class Read(Exception):
        pass

    def points(_):
        raise Read

    monkeypatch.setattr(picture_tracks, "_points", points)
    monkeypatch.setattr(picture_tracks, "list_pictures", list)
    most = picture_tracks.MOST_PICTURES
    for count, error in ((2, Read), (most, Read), (1, DataError), (most + 1, DataError)):
        with pytest.raises(error):
            picture_tracks.of_pictures(["x"] * count)


@pytest.mark.parametrize("given", ["matches", "agreeing"])
def test_matches_that_two_pictures_share(monkeypatch, given):
    least = picture_tracks.LEAST_MATCHES
    monkeypatch.setattr(picture_tracks, "list_pictures", list)
    for count, enough in ((least, True), (least - 1, False)):
        total = count if given == "matches" else 2 * least
        first, second = two_views(2 * least, 0.3)
        seen = [picture_tracks.Points(uv, np.zeros((len(uv), 1)), np.ones(len(uv))) for uv in (first, second)]
        monkeypatch.setattr(picture_tracks, "_points", lambda _, s=seen: (s, (1000, 800)))
        monkeypatch.setattr(picture_tracks, "_pairs", lambda _: [(0, 1)])
        monkeypatch.setattr(
            picture_tracks, "matched", lambda *_, n=total: np.repeat(np.arange(n)[:, None], 2, 1)
        )
        agree = np.arange(total) < count
        monkeypatch.setattr(epipolar, "fundamental", lambda *_, a=agree: (np.eye(3), a))
        if enough:
            assert picture_tracks.of_pictures([Path("a"), Path("b")])[2] == count
        else:
            with pytest.raises(DataError, match="share"):
                picture_tracks.of_pictures([Path("a"), Path("b")])


# ------------------------------------------------------------------------------------ wands
def linked(monkeypatch, angle, bars):
    """Whether two cameras are placed by bars at an angle."""
    first, second = two_views(2 * bars, 0.3)
    camera = pinhole()
    made = epipolar.fundamental(first, second)
    assert made is not None
    count = 2 * bars
    seen = SimpleNamespace()
    monkeypatch.setattr(
        wand_start, "_lengths", lambda _, rows, xyz: np.ones(int(np.isfinite(xyz).all(1).sum()) // 2)
    )
    found = epipolar.two_view_points
    monkeypatch.setattr(epipolar, "two_view_points", lambda *a: (found(*a)[0], np.full(count, angle)))
    rows = np.stack([np.arange(count), np.arange(count)], 1)
    made = wand_start.placed(
        Link(0, 1, rows, (first, second), made[0], np.ones(count, bool)), [camera, camera], seen
    )
    monkeypatch.undo()
    return made is not None


def test_bars_that_place_two_cameras(monkeypatch):
    assert linked(monkeypatch, MORE * epipolar.LEAST_ANGLE, 10)
    assert not linked(monkeypatch, LESS * epipolar.LEAST_ANGLE, 10)
    least = wand_start.LEAST_BARS
    assert linked(monkeypatch, 0.3, least) and not linked(monkeypatch, 0.3, least - 1)


# ------------------------------------------------------------------------------------ lines
def test_lines_that_are_straight_enough(monkeypatch):
    """Among lines without any noise one is kept up to so many px."""
    count = 9
    some = SimpleNamespace(__len__=lambda: count)
    for share, kept in ((LESS, count), (MORE, count - 1)):
        rms = np.zeros(count)
        rms[0] = share * line_start.FINE
        monkeypatch.setattr(line_start, "line_rms", lambda *_, r=rms: r)
        assert line_start._straight(None, some, np.zeros(count, bool)).sum() == kept
    for share, kept in ((LESS, count), (MORE, count - 1)):
        rms = np.ones(count)
        rms[0] = share * line_start.FAR
        monkeypatch.setattr(line_start, "line_rms", lambda *_, r=rms: r)
        assert line_start._straight(None, some, np.zeros(count, bool)).sum() == kept


def test_a_parameter_that_does_not_move_the_lines():
    """By its own effect, px a unit, of which the normal matrix has the squares."""
    points = 50
    for share, alive in ((LESS, 0), (MORE, 1)):
        reduced = np.diag([points, points * (share * lines.DEAD) ** 2])
        covariance, lost = lines._covariance(reduced, np.eye(2), points)
        assert (covariance[1, 1] > 0) == bool(alive) and lost.shape[1] == 1 - alive


# ------------------------------------------------------------------------------------ scenes
CAMERA, ROTATION = pinhole(), rotations.exp(np.array([0.3, 0.5, 0.1]))


def voted(off):
    """The vote for lines (L,) of one direction that miss it by so many deviations, and these as it finds them."""
    point = ROTATION[:2, 0] / ROTATION[2, 0] * 800 + (500, 400)
    middle = np.random.default_rng(1).uniform((100, 100), (900, 700), (len(off), 2))
    step = (point - middle) / np.linalg.norm(point - middle, axis=1, keepdims=True)
    across = np.stack([-step[:, 1], step[:, 0]], 1) * np.asarray(off)[:, None]
    ends = np.stack([middle - 60 * step - across, middle + 60 * step + across], 1)
    seen = scene_vote.Seen(ends, np.ones(len(off)), np.full(len(off), 120.0))
    found = scene_vote.misses(ends, np.array([500.0, 400]), 800.0, ROTATION)[:, 0]
    return scene_vote.families(seen, CAMERA, ROTATION), found


def test_a_line_that_probably_has_a_direction():
    """The probability follows from the weight; the miss at which it falls through the limit is searched for."""

    def used(miss):
        vote, off = voted(np.r_[miss, np.zeros(11)])
        chance = vote.roots[0] ** 2 * (scene_vote.TAIL + off[0] ** 2) / (scene_vote.TAIL + 1)
        return bool(vote.family[0] >= 0), float(chance)

    near, far = 0.1, 60.0
    assert used(near)[0] and not used(far)[0]
    for _ in range(12):
        middle = (near + far) / 2
        near, far = (middle, far) if used(middle)[0] else (near, middle)
    assert used(far)[1] < scene_vote.LIKELY < used(near)[1] < MORE * 1.02 * used(far)[1]


def test_scores_that_do_not_grow_with_the_residuals():
    """Of lines that all miss by as much: (t - x²) / (t + x²), t the degrees of freedom."""
    least, t = scene_vote.LEAST_GROWTH, scene_vote.TAIL
    limit = np.sqrt(t * (1 - least) / (1 + least))
    unit = np.abs(voted(np.full(12, 0.1))[1]).mean() / 0.1
    for share, floor in ((0.97, False), (1.03, True)):
        growth = voted(np.full(12, share * limit / unit))[0].growth
        assert (growth == least) == floor and growth >= least


# ------------------------------------------------------------------------------------ hand-eye
def reading(setup, misfit, shift=0.1, form="vector"):
    return recognise.Reading(setup, SimpleNamespace(name=form), misfit, shift)


def test_rotations_of_a_robot_that_do_not_match():
    robot = SimpleNamespace(certain=False, form=reading("in-hand", 1.0).form)
    for share, fits in ((LESS, True), (MORE, False)):
        found = [recognise.Reading("in-hand", robot.form, share * recognise.NO_ROBOT, 0.1)]
        if fits:
            assert recognise.choose(found, robot, "in-hand", 9) is found[0]
        else:
            with pytest.raises(EstimationError, match="do not match"):
                recognise.choose(found, robot, "in-hand", 9)


def test_a_reading_that_is_likelier_than_the_names_say():
    """The misfit of the other, so that the odds are at the limit for nine views."""
    named = SimpleNamespace(name="named")
    robot = SimpleNamespace(certain=False, form=named)
    views = 9
    for share, other in ((1.01, True), (0.99, False)):
        ratio = (share * recognise.ODDS) ** (1 / (3 * views - 6))
        first = recognise.Reading("in-hand", named, 0.05, 0.1)
        better = recognise.Reading("in-hand", SimpleNamespace(name="other"), 0.05 / ratio, 0.1)
        assert recognise.choose([first, better], robot, "in-hand", views) is (better if other else first)


def test_an_outlying_pose(monkeypatch):
    """Of nine poses, by the probability of the worst; and among enough of them."""
    count = 9
    everyone = np.arange(count)
    found = SimpleNamespace(offset=None, misfit=None)
    seen = SimpleNamespace(poses=[None] * count)
    for share, removed in ((LESS, True), (MORE, False)):
        chance = np.ones(count)
        chance[4] = share * estimate.OUTLIER / count
        monkeypatch.setattr(estimate.variance, "outlying", lambda *_, c=chance: c)
        used = estimate._tested(found, None, seen, None, everyone)
        assert (4 not in used) == removed and len(used) == count - removed
    few = SimpleNamespace(poses=[None] * (estimate.LEAST_TO_TEST - 1))
    monkeypatch.setattr(estimate.variance, "outlying", lambda *_: np.zeros(len(few.poses)))
    used = np.arange(len(few.poses))
    assert estimate._tested(found, None, few, None, used) is used


def test_directions_that_a_camera_s_covariance_lacks():
    """Two parameters of the correlation c: eigenvalues 1 + c and 1 - c."""
    for share, rank in ((0.9, 1), (1.1, 2)):
        ratio = share * pictures.RANK
        c = (1 - ratio) / (1 + ratio)
        self = SimpleNamespace(_scaled_covariance=np.array([[1.0, c], [c, 1]]), _camera_sigma=np.ones(2))
        root = pictures.Pictures.camera_root.func(self)
        assert root.shape == (2, rank)
