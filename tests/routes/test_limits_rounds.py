"""Rounds at which the searches of the routes end, and the sizes that end them, each from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import (
    bundle_outliers,
    focal_interval,
    line_start,
    lines,
    outliers,
    projective_views,
    scene,
    scene_start,
)
from camcal.routes.bundle import Tracks
from camcal.routes.hand_eye import variance
from tests.routes import test_lines
from tests.sides import LESS, MORE

SIZE = (1000, 800)
PINHOLE = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), SIZE)


def changing(first, second):
    """A function that returns one, the other, the first one again and so on, and how often it was asked."""
    asked = []

    def found(*_, **__):
        asked.append(1)
        return (first, second)[(len(asked) - 1) % 2]

    return found, asked


# ------------------------------------------------------------------------------------ variances of a robot
def scored(monkeypatch, moved=0.0, logs=0.0, inside=False):
    """How many steps the variances take that move by so much, or whether they are inside from there."""
    asked = []
    here = SimpleNamespace(score=np.zeros(3), information=np.eye(3))

    def uphill(*_):
        asked.append(1)
        return np.full(3, logs), here, moved

    model = SimpleNamespace(
        floors=lambda _: np.zeros(3) - 99.0 * (not inside), at=lambda _: here, uphill=uphill
    )
    monkeypatch.setattr(variance._Model, "of", lambda *_: model)
    monkeypatch.setattr(variance, "_components", lambda *args: args[-1].all())
    found = variance.estimate(None, np.full(3, np.e), 1.0)
    return found if inside else len(asked)


@pytest.mark.parametrize(("moved", "steps"), [(LESS * 1e-9, 1), (MORE * 1e-9, 60)])
def test_steps_of_variances(monkeypatch, moved, steps):
    assert scored(monkeypatch, moved) == steps


@pytest.mark.parametrize(("above", "inside"), [(LESS * 1e-12, False), (MORE * 1e-12, True)])
def test_a_variance_above_its_bound(monkeypatch, above, inside):
    assert scored(monkeypatch, logs=above, inside=True) == inside


# ------------------------------------------------------------------------------------ points of one pose
class Points:
    """A view of points at 0."""

    def __init__(self, count):
        self.xyz, self.uv, self.count = np.zeros((count, 3)), np.zeros((count, 2)), count

    def __len__(self):
        return self.count


def settled(monkeypatch, squares, variance=1.0):
    """How many of 20 points each fit is to, by the squares that are found before it; the fits are exact."""
    fitted = []

    def fit(_, xyz, *__):
        fitted.append(len(xyz))
        return SimpleNamespace(state=Pose.identity(), normal=SimpleNamespace(cost=0.0))

    monkeypatch.setattr(outliers, "refine_pose", fit)
    monkeypatch.setattr(outliers, "_squares", squares)
    outliers._settled(None, Points(20), np.ones(20), Pose.identity(), variance)
    return fitted


def test_rounds_of_the_points_of_a_pose(monkeypatch):
    """One point changes sides in each."""
    squares, _ = changing(np.r_[np.zeros(19), 1e9], np.zeros(20))
    assert settled(monkeypatch, squares) == [19, 20] * 5


@pytest.mark.parametrize(("share", "kept"), [(LESS, 20), (MORE, 19)])
def test_a_point_that_does_not_agree_with_a_pose(monkeypatch, share, kept):
    """By what one view in a hundred exceeds in one of its 20 points; the noise is known with 20 degrees of freedom."""
    squares = np.r_[np.zeros(19), share * 2 * stats.f.isf(0.01 / 20, 2, 20)]
    assert settled(monkeypatch, lambda *_: squares)[0] == kept


@pytest.mark.parametrize(("share", "fits"), [(LESS, [20]), (MORE, [20, 19])])
def test_the_least_noise_of_the_points_of_a_pose(monkeypatch, share, fits):
    """After an exact fit to 20 points, with 34 degrees of freedom."""
    bound = 2 * stats.f.isf(0.01 / 20, 2, 34) * 1e-18
    assert settled(monkeypatch, lambda *_: np.r_[np.zeros(19), share * bound])[:2] == fits


def test_rounds_of_the_images_of_a_bundle(monkeypatch):
    """One image changes sides in each."""
    usable, _ = changing(np.arange(20), np.arange(19))
    fit = SimpleNamespace(state=None, normal=SimpleNamespace(cost=1.0), iterations=1)
    for name, given in {
        "free_matrix": None, "_first_sigma": 1.0, "farthest": 1.0, "freedom": 9.0, "adjust": fit, "_placed_again": None
    }.items():  # fmt: skip
        monkeypatch.setattr(bundle_outliers, name, lambda *_, g=given: g)
    monkeypatch.setattr(bundle_outliers, "usable", usable)
    bundle = SimpleNamespace(camera=PINHOLE)
    assert bundle_outliers.adjusted(bundle, SimpleNamespace(take=lambda _: None), {})[2] == 6


@pytest.mark.parametrize(("median", "bound"), [(1.0, 3.5 * 1.482602218505602), (0.09, 0.5)])
def test_images_that_are_inliers(median, bound):
    """Within 3.5 robust standard deviations, or half a px."""
    assert projective_views._bound(np.array([0.0, median, 9.0]), 0.5) == pytest.approx(bound, rel=1e-12)


def test_the_least_bound_of_inliers_in_px(monkeypatch):
    class Begun(Exception):
        pass

    def begin(_, __, least, ___):
        assert least == pytest.approx(0.5 / 800)
        raise Begun

    monkeypatch.setattr(projective_views, "_off_plane", lambda *_: 0.0)
    monkeypatch.setattr(projective_views, "_State", begin)
    tracks = Tracks(np.zeros(9, int), np.arange(9), np.zeros((9, 2)))
    with pytest.raises(Begun):
        projective_views.of_pairs([None], tracks, np.zeros(2), 800.0)


# ------------------------------------------------------------------------------------ the interval of a focal length
@pytest.mark.parametrize(
    ("off", "tries"), [(LESS * 0.02, 1), (MORE * 0.02, 8), (-LESS * 0.02, 1), (-MORE * 0.02, 8)]
)
def test_steps_to_an_end_of_an_interval(monkeypatch, off, tries):
    """It is found where t² of 95 % and 30 degrees of freedom is met to 2 %, and given up after eight steps."""
    asked, t = [], stats.t.isf(0.025, 30)

    def with_focal(at, *_):
        asked.append(1)
        return at, 1.0 + (1 + off) * t**2 / 30

    bundle = SimpleNamespace(camera=PINHOLE, residuals=lambda _: np.ones(1))
    monkeypatch.setattr(focal_interval, "freedom", lambda *_: 30)
    monkeypatch.setattr(focal_interval, "_with_focal", with_focal)
    focal_interval.focal_interval(bundle, None, np.eye(4), 40.0)
    assert len(asked) == 2 * tries


# ------------------------------------------------------------------------------------ lines
def rounds_of_lines(monkeypatch, change=0.0, moved=0.0):
    """The rounds of a fit in which all weights change by so much in each, and the lens by so many sigmas."""
    made = test_lines.Lines.of([np.c_[np.arange(9.0), np.full(9, 9.0 * i)] for i in range(4)], "abcd", SIZE)
    params = np.array([800.0, 800, 500, 400, 0.0])
    weights, _ = changing(np.full(36, 1 - change), np.ones(36))
    lens, asked = changing(params + moved, params)
    normal = SimpleNamespace(cost=len(made.uv) / 2, reduced=lambda: None)

    def fitted(*_):
        return SimpleNamespace(state=SimpleNamespace(params=lens()), normal=normal, iterations=1)

    monkeypatch.setattr(lines, "_weights", weights)
    monkeypatch.setattr(lines, "_round", fitted)
    monkeypatch.setattr(lines, "_moving", lambda *_: np.arange(1))
    monkeypatch.setattr(lines, "_covariance", lambda *_: (np.eye(5), None))
    monkeypatch.setattr(lines, "_finished", lambda *_: None)
    lines.fit(
        made, Camera(lenses.make("division:1"), params, SIZE), dict.fromkeys(("fx", "fy", "cx", "cy")), True
    )
    return len(asked)


@pytest.mark.parametrize(("share", "rounds"), [(LESS, 1), (MORE, 12)])
def test_rounds_of_the_weights_of_points(monkeypatch, share, rounds):
    """They end where no weight changes by more than a hundredth, and the lens by no thousandth of a sigma."""
    assert rounds_of_lines(monkeypatch, change=share * 0.01) == rounds
    assert rounds_of_lines(monkeypatch, moved=share * 0.001) == rounds


def test_rounds_of_choosing_lines(monkeypatch):
    """One line changes sides in each: six for the division model, and six for the model that was asked for."""
    made = test_lines.lines_of(test_lines.DIVISION, count=8, points=8)
    straight, _ = changing(np.ones(8, bool), np.arange(8) < 7)
    fits = {"fit_centred": [], "_of_model": []}
    found = SimpleNamespace(camera=test_lines.DIVISION, used=None)

    for name, asked in fits.items():
        monkeypatch.setattr(line_start, name, lambda *_, a=asked, **__: a.append(1) or found)
    monkeypatch.setattr(line_start, "_straight", straight)
    monkeypatch.setattr(line_start, "_shaped", lambda *_: test_lines.DIVISION)
    monkeypatch.setattr(line_start, "with_doubt", lambda *_: found)
    monkeypatch.setattr(line_start, "replace", lambda found, used: found)
    line_start.estimate(made, test_lines.DIVISION.lens, {}, robust=True)
    assert [len(asked) for asked in fits.values()] == [6 + 1, 1 + 6]


# ------------------------------------------------------------------------------------ scenes
def test_rounds_of_choosing_the_lines_of_a_scene(monkeypatch):
    """One line changes sides in each, and the last four have the noise itself as their scale."""
    wide = []
    family = np.repeat([0, 1], 5)
    votes, _ = changing(SimpleNamespace(family=family), SimpleNamespace(family=np.r_[family[:-1], 0]))

    def families(_, __, ___, wider):
        wide.append(wider)
        return votes()

    monkeypatch.setattr(scene, "families", families)
    monkeypatch.setattr(scene, "fit_scene", lambda *_: SimpleNamespace(camera=PINHOLE, rotation=np.eye(3)))
    scene._followed(None, PINHOLE, {}, 800.0, np.eye(3), None)
    assert wide == [2.0, 1.5, 1.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(("count", "voters"), [(250, 250), (251, 250)])
def test_lines_that_vote_for_a_frame(monkeypatch, count, voters):
    """The first ones, which are the longest."""
    asked = []
    monkeypatch.setattr(
        scene_start, "_sampled", lambda own, *_: asked.append(own) or (np.zeros(0), np.zeros((0, 3, 3)))
    )
    ends = np.random.default_rng(0).uniform(0, 1000, (count, 2, 2))
    assert scene_start.frames(ends, np.zeros(2), 1.0) == []
    np.testing.assert_array_equal(asked[0], ends[:voters])
