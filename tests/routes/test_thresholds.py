"""More numbers that decide something in the routes, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import (
    bundle_outliers,
    lines,
    picture_tracks,
    projective_views,
    reconstruct,
    scene,
    scene_bend,
    scene_vote,
    triangulate,
)
from camcal.routes import pose as poses
from camcal.routes.hand_eye import horaud, remarks, views
from camcal.routes.hand_eye import offset as offsets
from camcal.solve.outliers import f_bound
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ several views
def test_depths_near_the_plane_of_the_camera():
    least = projective_views.LEAST_DEPTH
    depths = np.array([-2.0, 2.0, 2.0, MORE * least * 2, LESS * least * 2])
    assert projective_views.bounded_depths(depths).tolist() == [2, 2, 2, MORE * least * 2, least * 2]


def test_images_that_are_never_left_out(monkeypatch):
    monkeypatch.setattr(bundle_outliers, "_seen", lambda *_: np.array([2, 3]))
    for reach, expected in (
        (LESS * bundle_outliers.LEAST_FAR, [bundle_outliers.LEAST_FAR] * 2),
        (2.0, [np.sqrt(2.0), 2.0]),  # an image of a point in two views has half of its variance
    ):
        monkeypatch.setattr(bundle_outliers, "reach", lambda *_, r=reach: r)
        assert bundle_outliers.farthest(None, range(2), 1.0, 9.0) == pytest.approx(expected)


def test_pairs_of_many_pictures(monkeypatch):
    """Up to a dozen pictures all pairs; of more, neighbours and those that look alike."""
    points = SimpleNamespace(largest=lambda _: None)
    monkeypatch.setattr(picture_tracks, "matched", lambda *_: [])
    most = picture_tracks.ALL_PAIRS
    assert len(picture_tracks._pairs([points] * most)) == most * (most - 1) // 2
    assert len(picture_tracks._pairs([points] * (most + 1))) < most * (most - 1) // 2


def test_adjustments_while_views_are_added():
    """Each of the first eight, then every fourth, then every fifth of those known."""
    every = reconstruct.EVERY
    assert reconstruct._due(1, 2 * every) and not reconstruct._due(1, 2 * every + 1)
    assert reconstruct._due(every, 3 * every) and not reconstruct._due(every - 1, 3 * every)
    share = int(100 * reconstruct.EVERY_SHARE)
    assert reconstruct._due(share, 100) and not reconstruct._due(share - 1, 100)


@pytest.mark.parametrize(("share", "shown"), [(LESS, False), (MORE, True)])
def test_distortion_that_the_segments_of_a_picture_show(monkeypatch, share, shown):
    """The coefficient in standard deviations; the focal length is far off."""
    other = SimpleNamespace(
        camera=SimpleNamespace(params=np.array([600.0, 600, 320, 240, share * scene_bend.BENT * 0.01])),
        covariance=np.diag([1.0, 1, 1, 1, 0.01**2]),
    )
    monkeypatch.setattr(scene_bend, "estimate", lambda *_: other)
    plain = SimpleNamespace(camera=SimpleNamespace(params=np.array([500.0])), covariance=np.eye(1))
    assert (scene_bend.with_distortion(plain, None, {}, 0, True) is other) == shown


class Images(SimpleNamespace):
    def __len__(self):
        return len(self.uv)


def test_rays_that_place_a_point():
    """The least eigenvalue of Σ (I - d dᵀ) for two rays at an angle a is 1 - cos a: a² / 2."""
    for share, known in ((0.5, False), (2.0, True)):
        angle = np.sqrt(2 * share * triangulate.PARALLEL)
        rays = np.array([[0.0, 0, 1], [-np.sin(angle), 0, np.cos(angle)]])
        placed = [
            SimpleNamespace(centre=c, rays=lambda uv, r=r: np.tile(r, (len(uv), 1)))
            for c, r in zip(np.array([[0.0, 0, 0], [1e-6, 0, 0]]), rays, strict=True)
        ]
        images = Images(camera=np.arange(2), point=np.zeros(2, int), uv=np.zeros((2, 2)))
        found = triangulate._linear(placed, images, np.ones(2, bool), 1)
        assert found[1][0] == known and np.isfinite(found[0]).all() == known


# ------------------------------------------------------------------------------------ poses
def test_poses_that_are_one():
    at = Pose(np.eye(3), np.array([0.0, 0.0, 5.0]))
    for share, same in ((LESS, True), (MORE, False)):
        turned = Pose(rotations.exp(np.array([share * poses.SAME, 0, 0])), at.translation)
        moved = Pose(np.eye(3), at.translation + [share * poses.SAME * 5, 0, 0])
        assert poses._same(turned, at) == same and poses._same(moved, at) == same


def test_a_second_minimum_that_could_be_the_pose():
    best = SimpleNamespace(cost=3.0)
    freedom = 2 * 8 - 6
    bound = f_bound(1 - poses.LEVEL, freedom, freedom)
    for share, could in ((LESS, True), (MORE, False)):
        assert poses._could_be(SimpleNamespace(cost=share * bound * 3), best, 8) == could
    assert poses._could_be(SimpleNamespace(cost=1e9), best, 3)  # nothing is left to test with three points


def test_a_pose_that_the_points_leave_undetermined():
    """Two parameters with the correlation c: the eigenvalues are 1 ± c, and rounding is a hundredth of the limit."""
    view = SimpleNamespace(id="a")
    for share, known in ((1.1, True), (0.9, False)):
        ratio = (share * poses.UNDETERMINED) ** 2
        normal = np.eye(6)
        normal[0, 1] = normal[1, 0] = (1 - ratio) / (1 + ratio)
        if known:
            poses._require_determined(view, normal)
        else:
            with pytest.raises(EstimationError, match="undetermined"):
                poses._require_determined(view, normal)


# ------------------------------------------------------------------------------------ lines and scenes
def test_distances_that_look_gaussian():
    """Half of the distances at 1, the others so that the root mean square is at the bound."""
    count = 1001
    sigma = 1 / 0.6744897501960817
    bound = sigma * (1 + lines.HEAVIER / np.sqrt(count))
    for share, heavy in ((LESS, False), (MORE, True)):
        off = np.ones(count)
        far = np.sqrt((share**2 * bound**2 * count - 501) / 500)
        off[:500] = far
        weights = lines._weights(off)
        assert (weights.min() < 1) == (heavy and far > lines.HUBER * sigma)


def test_where_a_point_loses_weight():
    off = np.r_[np.full(600, 1.0), np.full(400, 30.0), 0.0, 0.0]
    sigma = 1 / 0.6744897501960817
    off[-2:] = LESS * lines.HUBER * sigma, MORE * lines.HUBER * sigma
    weights = lines._weights(off)
    assert weights[-2] == 1 and weights[-1] == pytest.approx(1 / MORE, rel=1e-6)


def test_a_direction_at_infinity():
    camera = SimpleNamespace(params=np.array([800.0]))
    for share, far in ((LESS, True), (MORE, False)):
        slope = share * 800.0 / (scene.INFINITY * 1000)
        direction = np.array([1.0, 0.0, slope])
        found = SimpleNamespace(rotation=np.c_[direction, direction, direction], camera=camera)
        assert scene.at_infinity(found, 0, 1000) == far


def test_lines_of_a_direction():
    """Two lines meet in any case; the third says that they have a direction."""
    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), (1000, 800))
    rotation = rotations.exp(np.array([0.3, 0.5, 0.1]))
    point = rotation[:2, 0] / rotation[2, 0] * 800 + (500, 400)
    for count in (scene_vote.LEAST_LINES, scene_vote.LEAST_LINES - 1):
        middle = np.random.default_rng(1).uniform((100, 100), (900, 700), (count, 2))
        step = (point - middle) / np.linalg.norm(point - middle, axis=1, keepdims=True)
        ends = np.stack([middle - 60 * step, middle + 60 * step], 1)
        seen = scene_vote.Seen(ends, np.full(count, 0.3), np.full(count, 120.0))
        used = (scene_vote.families(seen, camera, rotation).family >= 0).sum()
        assert used == (count if count >= scene_vote.LEAST_LINES else 0)


# ------------------------------------------------------------------------------------ hand-eye
def test_a_turn_that_has_an_axis():
    for share, known in ((LESS, 0.0), (MORE, 1.0)):
        turn = rotations.exp(np.array([[share * horaud.SMALLEST_TURN, 0, 0]]))
        large = rotations.exp(np.array([[0.5, 0, 0]]))
        assert horaud._axes(turn, large)[2].tolist() == [known]


def test_pairs_of_views():
    """All pairs of 64 views are taken, and of more those of the views farthest apart in the list."""
    for count, pairs in ((64, 64 * 63 // 2), (65, views.MOST_MOTIONS)):
        stack = [None] * count
        found = views.Views(stack, stack)
        later, earlier = found.pairs
        assert len(later) == pairs
    assert later.max() == 64 and (later - earlier).min() > 1


def test_offsets_that_are_tried():
    asked = []

    def covers(times):
        asked.append(float(times[0]))
        return np.zeros(1, bool)

    for interval, count in ((0.01, 2 * 100 + 1), (1e-6, 2 * offsets.MOST_STEPS + 1)):
        asked.clear()
        stream = SimpleNamespace(times=np.arange(4) * interval, covers=covers)
        with pytest.raises(Exception, match="lie outside"):
            offsets.search("in-hand", stream, np.zeros(1), None, 1.0)
        assert len(asked) == pytest.approx(count, abs=1)


def said(iterator):
    return [(w.code, w.severity) for w in iterator]


def test_outlying_poses_and_few_poses():
    def of(used, names):
        return said(
            remarks._poses(SimpleNamespace(used=np.arange(used)), [str(i) for i in range(names)], (0, 0))
        )

    most = int(12 * remarks.MOST_OUTLIERS)
    assert of(12 - most, 12) == [("hand-eye-outliers", "doubtful")]
    assert of(12 - most - 1, 12) == [("hand-eye-outliers", "wrong")]
    few = remarks.LEAST_TO_TEST
    assert of(few, few) == [] and of(few - 1, few - 1)[0][0] == "hand-eye-few-poses"


def test_a_robot_that_has_nothing_to_do_with_the_pictures():
    places = np.random.default_rng(0).normal(size=(9, 3))
    extent = np.sqrt(np.square(places - places.mean(0)).sum(1).mean())
    turned = SimpleNamespace(
        inverse=lambda: SimpleNamespace(rotation=np.tile(np.eye(3), (9, 1, 1)), translation=places)
    )
    for share, wrong in ((LESS, False), (MORE, True)):
        made = SimpleNamespace(
            measured=SimpleNamespace(translation=places),
            poses=turned,
            translation_rms=share * remarks.UNRELATED * extent,
        )
        assert bool(said(remarks._unrelated(made))) == wrong


def test_a_weak_direction():
    for ratio, weak in ((LESS * remarks.UNEVEN, False), (MORE * remarks.UNEVEN, True)):
        covariance = np.diag([1, 1, 1, 1, 1, ratio**2])
        motions = SimpleNamespace(turns_deg=(30.0, 20.0))
        made = SimpleNamespace(covariance=covariance, setup="in-hand", motions=motions)
        assert bool(said(remarks._directions(made))) == weak


def test_another_scale():
    view = SimpleNamespace(xyz=np.zeros((4, 3)))
    stack = SimpleNamespace(rotation=np.tile(np.eye(3), (5, 1, 1)), translation=np.tile([0, 0, 2.0], (5, 1)))
    made = SimpleNamespace(pictures=SimpleNamespace(views=[view]), poses=stack, sigma=np.full(6, 0.01))

    def of(factor, sigma):
        return said(remarks._scale(made, factor, sigma, None))

    assert of(1.01, 0.01 / (LESS * remarks.DIFFERENT)) == [] and of(1.01, np.inf) == []
    off = remarks.OFF * 0.01 / 2.0  # of a board 2 away
    assert of(1 + LESS * off, 1e-4) == [("hand-eye-scale", "doubtful")]
    assert of(1 + MORE * off, 1e-4) == [("hand-eye-scale", "wrong")]
