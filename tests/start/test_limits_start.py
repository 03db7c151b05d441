"""Limits of the closed forms, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective, rotations
from camcal.model.pose import Pose, Poses
from camcal.start import (
    absolute_pose,
    assumptions,
    central,
    claus,
    dlt,
    five_points,
    known_pose,
    pose,
    radial,
    shape,
    zhang,
)
from tests.sides import LESS, MORE

from . import scenes


def view_of(xyz, uv=None):
    return View("a", xyz, np.zeros((len(xyz), 2)) if uv is None else uv)


# ------------------------------------------------------------------------------------ poses
@pytest.mark.parametrize(("share", "count"), [(LESS, 1), (MORE, 2)])
def test_minima_that_are_one(share, count):
    r = np.stack([np.eye(3), rotations.exp(np.array([0, share * absolute_pose.SAME, 0]))])
    assert len(absolute_pose._distinct(r, np.arange(2))) == count


def test_rotations_from_which_minima_are_searched(monkeypatch):
    """Of four points, poses that are reached from no rotation of the cube are from those near the eigenvectors."""
    rng = np.random.default_rng(12)
    xyz = rng.normal(size=(4, 3))
    rays = xyz @ rotations.exp(rng.normal(size=3) * 2).T + (0, 0, 3.0)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    assert len(absolute_pose.candidates(xyz, rays)) == 9
    monkeypatch.setattr(absolute_pose, "_starts", lambda _: absolute_pose._CUBE)
    assert len(absolute_pose.candidates(xyz, rays)) == 4


def test_points_behind_the_camera_of_a_pose():
    """The rays of so many of twenty points point the other way."""
    xyz = scenes.rig(20)
    truth = Pose(rotations.exp(np.array([0.2, -0.3, 0.1])), np.array([0.02, 0.05, 0.8]))
    rays = truth.apply(xyz)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    for behind, found in ((10, True), (11, False)):
        assert (behind / 20 <= absolute_pose.BEHIND) == found
        turned = rays * np.where(np.arange(20) < behind, -1, 1)[:, None]
        poses = absolute_pose.candidates(xyz, turned)
        errors = [rotations.angle_between(p.rotation[None], truth.rotation[None])[0] for p in poses]
        assert (min(errors, default=9.0) < 1e-6) == found


def test_rays_almost_at_right_angles_to_the_axis():
    """They have no part in a pose from normalised coordinates."""
    camera = SimpleNamespace()
    xyz = scenes.board()
    rays = xyz @ rotations.exp(np.array([0.3, 0.2, 0.0])).T + (0.0, 0.0, 0.6)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    for share, counts in ((LESS, False), (MORE, True)):
        depth = share * projective.FLAT_RAY
        wrong = rays.copy()
        wrong[7] = np.sqrt(1 - depth**2), 0, depth
        camera.unproject = lambda _, d=wrong: d
        (found,) = known_pose.start_poses(camera, [view_of(xyz)])
        exact = (
            np.abs(found.apply(xyz) / np.linalg.norm(found.apply(xyz), axis=1)[:, None] - rays).max() < 1e-6
        )
        assert exact != counts


@pytest.mark.parametrize(("count", "enough"), [(known_pose.LEAST, True), (known_pose.LEAST - 1, False)])
def test_points_of_a_pose_in_space(count, enough):
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.4, 1]])[:count]
    assert known_pose.few_in_space([view_of(xyz)])[0] == enough
    full = scenes.rig(shape.LEAST_3D)
    assert not known_pose.few_in_space([view_of(full)])[0]
    assert known_pose.few_in_space([view_of(full[:-1])])[0]


@pytest.mark.parametrize(("share", "tried"), [(LESS, True), (MORE, False)])
def test_shallow_points_are_also_tried_as_a_plane(monkeypatch, share, tried):
    xyz = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    xyz[:, 2] *= share * pose.SHALLOW
    asked = []
    planar = pose.from_homographies
    monkeypatch.setattr(pose, "from_homographies", lambda *a: asked.append(1) or planar(*a))
    at = xyz + (0.1, 0.2, 6)
    pose.initial_poses([xyz], [at[:, :2] / at[:, 2:]], [None])
    assert bool(asked) == tried


def test_a_second_pose_that_may_be_better(monkeypatch):
    poses = Poses(np.eye(3)[None], np.array([[0.0, 0, 5]]))
    best = pose.Polished(poses, np.ones(1))
    for share, again in ((LESS, True), (MORE, False)):
        asked = []

        def polished(*a, s=share, seen=asked):
            seen.append(a[-1])
            return pose.Polished(poses, np.array([s * pose.RIVAL]))

        monkeypatch.setattr(pose, "polish", polished)
        pose._against_second(best, np.zeros((1, 4, 3)), np.zeros((1, 4, 2)), np.ones((1, 4)), 20)
        assert asked == [3, 20][: 1 + again]


# ------------------------------------------------------------------------------------ assumptions
def test_a_focal_length_that_is_certain_enough(monkeypatch):
    """Otherwise more is assumed."""
    made = scenes.scene(scenes.board(), scenes.tilts(8), scenes.K_NO_SKEW)
    (planes,) = zhang._planes([(made.observations, made.observations.shapes)])
    to_unit, where = assumptions.unit_coordinates(made.observations)
    h = to_unit @ planes.h
    for share, more in ((LESS, False), (MORE, True)):
        asked = []

        def uncertainty(*_, s=share, seen=asked):
            seen.append(1)
            return s * assumptions.UNCERTAIN

        monkeypatch.setattr(assumptions.conic, "focal_uncertainty", uncertainty)
        assumptions.climb(h, planes.covariances, False, where)
        assert (len(asked) > 1) == more


@pytest.mark.parametrize(("share", "parallel"), [(0.99, True), (1.01, False)])
def test_planes_that_are_parallel(share, parallel):
    angle = np.radians(share * zhang.PARALLEL)
    first = rotations.exp(np.array([0.4, 0.5, 0.0]))
    across = np.cross(first[:, 2], [1.0, 0, 0])
    second = rotations.exp(angle * across / np.linalg.norm(across)) @ first
    turns = rotations.log(np.stack([first, second]))
    made = scenes.scene(scenes.board(), turns, scenes.SQUARE)
    said = zhang.estimate(made.observations).info.get("degenerate")
    assert (isinstance(said, str) and "parallel to each other" in said) == parallel


def test_noise_without_redundancy():
    """Four points of a plane leave no residuals: a noise is assumed; a fifth shows it."""
    xyz = scenes.board(2, 2)
    uv = 1000 * xyz[:, :2] + 300
    (planes,) = zhang._planes(
        [(data := Observations.from_views([View("a", xyz, uv)], scenes.SIZE), data.shapes)]
    )
    assert zhang._variance(data, 0.0) == zhang.UNKNOWN_NOISE**2
    assert (np.diag(planes.covariances[0]) > 0).any()
    known = replace(data.views[0], sigma=np.full(4, 0.3))
    assert zhang._variance(Observations.from_views([known], scenes.SIZE), 0.0) == 1.0
    more = scenes.board(5, 1)
    assert zhang._variance(Observations.from_views([View("a", more, more[:, :2])]), 0.5) == 0.5 / 2


@pytest.mark.parametrize(("share", "determined"), [(LESS, False), (MORE, True)])
def test_points_that_determine_a_homography(monkeypatch, share, determined):
    made = scenes.scene(scenes.board(), scenes.tilts(2)).observations
    solve = zhang.homography.Equations.solve

    def weak(self, **how):
        h, gap, cost = solve(self, **how)
        return h, np.where(np.arange(len(gap)) == 1, share * zhang.UNDETERMINED, gap), cost

    monkeypatch.setattr(zhang.homography.Equations, "solve", weak)
    (found,) = zhang._planes([(made, made.shapes)])
    assert isinstance(found, EstimationError) != determined


# ------------------------------------------------------------------------------------ projection matrices
@pytest.mark.parametrize(("share", "determined"), [(MORE, True), (LESS, False)])
def test_points_that_determine_a_projection_matrix(monkeypatch, share, determined):
    made = scenes.scene(scenes.rig(), [[0.1, 0.2, 0.3]])
    solve = dlt.solve

    def weak(*a):
        found, singular = solve(*a)
        singular[:, 10] = share * dlt.UNDETERMINED * singular[:, 0]
        return found, singular

    monkeypatch.setattr(dlt, "solve", weak)
    if determined:
        assert dlt._matrices(made.observations.views)[0].shape == (1, 3, 4)
    else:
        with pytest.raises(EstimationError, match="do not determine the projection matrix"):
            dlt._matrices(made.observations.views)


def origin_at(depth, noise):
    """A view whose world origin lies at a depth, beside the points' depths of about 0.6."""
    xyz = scenes.rig() + (0, 0, 0.6)
    uv = xyz[:, :2] / xyz[:, 2:] * 1000 + (640, 400)
    uv = uv + noise * np.random.default_rng(0).normal(size=uv.shape)
    return View("a", xyz - (0, 0, depth), uv)


def refused(depth, noise):
    try:
        central._require_m34(origin_at(depth, noise))
    except EstimationError as error:
        ratio, sigma = error.message.partition("(")[2].partition(" of")[0].split(" ± ")
        return float(ratio), float(sigma)
    return None


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_depth_of_the_origin_beside_that_of_the_points(noise):
    """At least what rounding makes, and three standard deviations of it."""
    low, high = 1e-12, 0.3
    assert refused(low, noise) and not refused(high, noise)
    for _ in range(50):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if refused(middle, noise) else (low, middle)
    ratio, sigma = refused(low, noise)
    assert ratio == pytest.approx(max(central.NO_DEPTH, central.SIGNIFICANT * sigma), rel=0.06)


# ------------------------------------------------------------------------------------ distortion
def test_points_of_a_lifted_homography():
    for count in (claus.LEAST_POINTS, claus.LEAST_POINTS - 1):
        xyz = scenes.board()[np.random.default_rng(0).permutation(54)[:count]]
        data = Observations.from_views([View("a", xyz, 900 * xyz[:, :2] + 100)], scenes.SIZE)
        if count == claus.LEAST_POINTS:
            assert len(claus._prepared(data.views[0], data.shapes, 0, np.zeros(2), 1.0).points) == count
        else:
            with pytest.raises(DataError, match=f"holds {count} points"):
                claus._prepared(data.views[0], data.shapes, 0, np.zeros(2), 1.0)


def test_rays_too_far_from_the_axis():
    """Their depth beside that at the centre, 1 - u², is below the limit."""
    a = np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 0, 0, 1, 0], [-1, 0, 0, 0, 0, 1]])
    for share, kept in ((MORE, 9), (LESS, 8)):
        uv = np.c_[np.linspace(-0.5, 0.5, 9), np.linspace(-0.3, 0.3, 9) ** 2]
        uv[8, 0] = np.sqrt(1 - share * claus.FLATTEST)
        data = Observations.from_views([View("a", np.c_[uv, np.zeros(9)], uv)])
        made = claus._undistorted(data, a, np.zeros(2), 1.0)
        assert len(made.views[0]) == kept


def test_a_fold_of_a_map(monkeypatch):
    """Points at which the scale of the map is a part of the median one have no weight in the next round."""
    view = claus._View(scenes.board()[:, :2], scenes.board()[:, :2], np.ones(54))
    rows = []
    least = claus._least
    monkeypatch.setattr(claus, "_least", lambda r, q: rows.append(np.abs(r[:54]).sum(1)) or least(r, q))
    for share, used in ((MORE, True), (LESS, False)):
        rows.clear()
        area = np.ones(54)
        area[7] = (share * claus.FOLD) ** 2
        by_u = np.zeros((54, 6))
        by_u[:, 3] = area
        by_v = np.zeros((54, 6))
        by_v[:, 4] = 1.0
        monkeypatch.setattr(claus, "derivatives", lambda _, u=by_u, v=by_v: (u, v))
        claus._map(view)
        assert (rows[1][7] > 0) == used and (np.delete(rows[1], 7) > 0).all()


def test_points_that_agree_on_a_distortion():
    """Squared distances, of which one is at the limit."""
    usual = np.random.default_rng(0).chisquare(2, 101)
    variance = np.median(np.r_[usual, 1e9]) / (2 * np.log(2))
    for share, near in ((LESS, True), (MORE, False)):
        squares = np.r_[usual, share * five_points.FAR**2 * 2 * variance]
        assert five_points._near(squares)[-1] == near
        exact = np.r_[np.zeros(20), share * five_points.LEAST_FAR**2]
        assert five_points._near(exact)[-1] == near


def test_the_strongest_distortion_of_five_points():
    """D1 h = -λ D2 h with a λ at the limit."""
    for share, found in ((LESS, True), (MORE, False)):
        rng = np.random.default_rng(0)
        x = np.c_[rng.uniform(-1, 1, (12, 2)), np.ones(12)]
        h = np.eye(3) + 0.1 * rng.normal(size=(3, 3))
        d2 = rng.normal(size=(12, 3, 9))
        d1 = rng.normal(size=(12, 3, 9))
        value = -share * five_points.STRONGEST
        off = (d1 + value * d2) @ h.ravel()
        d1 -= off[..., None] * h.ravel() / (h**2).sum()
        view = five_points.Equations(x, x[:, :2], d1, d2)
        values, _ = five_points._solutions(view, np.arange(12)[None])
        assert bool(np.isclose(values, value, rtol=1e-6).any()) == found


@pytest.mark.parametrize(
    ("points", "least"), [(scenes.board(), radial.LEAST_PLANAR), (scenes.rig(), radial.LEAST_3D)]
)
def test_points_of_the_radial_constraint(points, least):
    chosen = np.random.default_rng(0).permutation(len(points))
    for count in (least, least - 1):
        xyz = points[chosen[:count]]
        data = Observations.from_views([View("a", xyz, 900 * xyz[:, :2] + 100)], scenes.SIZE)
        if count == least:
            assert len(radial.prepared(data, data.shapes, np.zeros(2), 1.0)[0]) == 1
        else:
            with pytest.raises(DataError, match=f"needs {least}"):
                radial.prepared(data, data.shapes, np.zeros(2), 1.0)


@pytest.mark.parametrize(("share", "counts"), [(LESS, False), (MORE, True)])
def test_a_point_in_the_centre_of_the_camera(share, counts):
    """Of two points the first is so near that its direction is rounding; both rays have the same length."""
    points = np.array([[0.0, 0, share * 1e-12], [0.0, 0.6, 0.8]])
    view = SimpleNamespace(points=points, uv=np.array([[30.0, 40], [0, 50]]), roots=np.ones(2))
    rows, *_ = radial._system(view, (np.eye(3), np.zeros(2)), np.zeros(2), (0, 2), np.array([800.0, 0]), 0.0)
    # with the depth eliminated, one equation alone is 0
    assert bool(np.abs(rows).max() > 1e-9) == counts


@pytest.mark.parametrize(("share", "certain"), [(LESS, True), (MORE, False)])
def test_a_focal_length_of_the_radial_constraint(monkeypatch, share, certain):
    view = SimpleNamespace(uv=np.array([[0.5, 0.5], [-0.5, 0.2]]))
    asked = []

    def depths(_, __, ___, exponents):
        asked.append(exponents)
        coefficients = np.r_[1.2, np.zeros(len(exponents) - 1)]
        return SimpleNamespace(coefficients=coefficients, uncertainty=share * radial.UNCERTAIN)

    monkeypatch.setattr(radial, "depths", depths)
    arguments = [view], [], np.zeros(2), np.array([320.0, 240]), 400.0, SimpleNamespace(image_size=(640, 480))
    if certain:
        assert radial._monotone(*arguments)[1].params[0] == pytest.approx(480) and asked == [radial.SERIES[0]]
    else:
        with pytest.raises(EstimationError, match="does not determine the focal length"):
            radial._monotone(*arguments)
        assert asked == list(radial.SERIES)
