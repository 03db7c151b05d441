"""Limits of rounds and steps: more of them change nothing that counts, and a few of them are not enough.

Each limit is tested from both sides on one example: its result is that of twice as many rounds within the tolerance,
which is a part of what noise does to it, and that of too few rounds is not.
"""

import importlib
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from camcal.assess import curvature, difference
from camcal.assess.checks import fit as fit_check
from camcal.assess.checks.facts import Facts
from camcal.assess.covariance import covariance
from camcal.data.formats import foreign, lensfun
from camcal.data.observations import Correspondences, View
from camcal.detect import disc_fit, saddle, segment_fit, shading
from camcal.detect import lines as detected_lines
from camcal.detect.discs import Discs
from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses import direct, rational
from camcal.model.lenses.regress import regress
from camcal.routes import dual_quadric, epipolar, lifted, projective_views, reconstruct, scene_fit, scene_vote
from camcal.solve import condition, noise, outliers, ransac
from camcal.solve.refine import How, refine
from camcal.solve.square_root import SquareRoot
from camcal.start import absolute_pose, claus, dlt_distorted, fitzgibbon, mdlt
from tests.assess.test_curvature import needless
from tests.routes import test_scene
from tests.routes.test_selfcalib import bent_tracks, tracks_of, walk
from tests.solve.problems import problem_of
from tests.solved import solved
from tests.start import scenes


@cache
def two_views(noise=0.5, wrong=40, count=120):
    """Pixels (N, 2) of both views, the last ones wrong."""
    rng = np.random.default_rng(3)
    points = rng.uniform((-1, -1, 3), (1, 1, 5), (count, 3))
    motion = rotations.exp(np.array([0.05, 0.2, 0.1]))
    uv = [900 * p[:, :2] / p[:, 2:] + (640, 480) for p in (points, points @ motion.T + (0.6, 0.1, 0.2))]
    uv = [q + noise * rng.normal(size=q.shape) for q in uv]
    uv[1][count - wrong :] = rng.uniform((0, 0), (1280, 960), (wrong, 2))
    return uv


def agreeing_matches():
    """With few matches the first matrix is rough, and wrong ones are near."""
    rng = np.random.default_rng(7)
    points = rng.uniform((-1, -1, 3), (1, 1, 5), (30, 3))
    motion = rotations.exp(np.array([0.05, 0.2, 0.1]))
    uv = [900 * p[:, :2] / p[:, 2:] + (640, 480) for p in (points, points @ motion.T + (0.6, 0.1, 0.2))]
    uv = [q + 1.0 * rng.normal(size=q.shape) for q in uv]
    uv[1][23:] += rng.uniform(-12, 12, (7, 2))
    return epipolar.fundamental(*uv)[1].astype(float)


def fundamental():
    f = epipolar.fundamental(*two_views())[0]
    return f / np.linalg.norm(f)


@cache
def projective_cameras():
    """Cameras (5, 3, 4) in any frame, each with a scale of its own, and noise."""
    rng = np.random.default_rng(0)
    cameras = np.stack([np.diag([0.7, 0.7, 1.0]) @ np.c_[p.rotation, p.translation] for p in walk(5, 2)])
    cameras = cameras @ (np.eye(4) + 0.3 * rng.normal(size=(4, 4)))
    return (cameras + 1e-3 * rng.normal(size=cameras.shape)) * rng.uniform(0.2, 5, (5, 1, 1))


def quadric():
    return dual_quadric.constant(projective_cameras())


def quadric_linear():
    found = dual_quadric.linear(projective_cameras())
    return found / np.linalg.norm(found)


def rays_of_lens():
    tracks = bent_tracks(2)[1]
    shared = np.intersect1d(*(tracks.point[tracks.view == v] for v in (0, 1)))[:60]
    pair = [tracks.uv[tracks.view == v][np.isin(tracks.point[tracks.view == v], shared)] for v in (0, 1)]
    unit = [lifted._unit(uv, (1000, 800)) for uv in pair]
    return lifted._least_squares(lifted.division(0.0), lifted.division(1.0)[None, :, :3], [tuple(unit)])


def pose():
    rng = np.random.default_rng(1)
    xyz = rng.normal(size=(6, 3))
    rays = xyz @ rotations.exp(rng.normal(size=3)).T + (0, 0, 5) + 0.02 * rng.normal(size=(6, 3))
    return absolute_pose.candidates(xyz, rays / np.linalg.norm(rays, axis=1, keepdims=True)).rotations[0]


def noisy(points, turns, noise, matrix=scenes.K, bend=0.0):
    """A scene whose points a lens moves outwards by `bend` times the squared distance in focal lengths."""
    made = scenes.scene(points, turns, matrix, noise)
    views = []
    for view in made.observations.views:
        q = (view.uv - matrix[:2, 2]) / 1000
        views.append((view.xyz, matrix[:2, 2] + 1000 * q * (1 + bend * np.square(q).sum(1, keepdims=True))))
    return Correspondences.from_views(views, image_size=scenes.SIZE)


def closed_form(estimate, points, turns, **more):
    def of():
        try:
            return estimate(noisy(points, turns, **more)).matrix
        except EstimationError:
            return np.zeros((3, 3))

    return of


def family_weights():
    rng = np.random.default_rng(0)
    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), (1000, 800))
    rotation = rotations.exp(np.array([0.3, 0.5, 0.1]))
    middle, which = rng.uniform((100, 100), (900, 700), (60, 2)), rng.integers(0, 3, 60)
    to = rotation[:, which].T
    point = to[:, :2] / to[:, 2:] * 800 + (500, 400)
    step = (point - middle) / np.linalg.norm(point - middle, axis=1, keepdims=True)
    step[:20] = rng.normal(size=(20, 2))  # clutter
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    ends = np.stack([middle - 40 * step, middle + 40 * step], 1) + 0.3 * rng.normal(size=(60, 2, 2))
    seen = scene_vote.Seen(ends, np.full(60, 0.3), np.full(60, 80.0))
    return scene_vote.families(seen, camera, rotation).roots


def agreement():
    rng = np.random.default_rng(2)
    xy = rng.uniform(-1, 1, (60, 2))
    uv = 400 * xy / (1 + 0.2 * xy[:, :1]) + (640, 480) + 0.5 * rng.normal(size=xy.shape)
    uv[:18] += rng.uniform(-60, 60, (18, 2))
    view = View("a", np.c_[xy, np.zeros(60)], uv)
    return ransac.of_maps([view], [True])[0].mask.astype(float)


def scale_of_view():
    lengths = np.r_[np.random.default_rng(0).rayleigh(0.2, 40), np.linspace(0.5, 30, 38)]
    return np.array([outliers._scale_of_view(lengths, 8.0, 8.0, 3.0, 0.1)])


def condition_number():
    problem, state = problem_of("opencv5")
    return np.array([np.log(condition.condition(SquareRoot.of(problem, state)))])


def line_through_points():
    rng = np.random.default_rng(4)
    place = np.linspace(-50, 50, 101)
    off = 0.3 + 0.002 * place + 0.05 * rng.normal(size=101)
    off[60:] += np.linspace(0, 3, 41)  # another edge
    return np.array(segment_fit._line(place, off, np.ones(101)))


def segment():
    gray = np.zeros((200, 200), np.float32)
    v, u = np.mgrid[:200, :200]
    gray = (128 + 80 * np.tanh((0.3 * (u - 100) - (v - 100)) / 1.5)).astype(np.uint8)
    return segment_fit.refined(gray, np.array([[[40.0, 74.0], [160.0, 125.0]]]))


def surface():
    rng = np.random.default_rng(5)
    x = rng.uniform(-0.5, 0.5, (60, 2))
    design = np.c_[np.ones(60), x, x[:, :1] ** 2, x[:, :1] * x[:, 1:], x[:, 1:] ** 2]
    values = design @ np.array([100, 20, -10, 5, 3, 8.0]) + rng.normal(size=60)
    values[:6] += 15  # a glare
    return shading._robust_fits(design, values[:, None])


def regressed():
    rng = np.random.default_rng(0)
    rays = np.c_[rng.uniform(-0.6, 0.6, (200, 2)), np.ones(200)]
    camera = Camera(lenses.make("opencv5"), np.array([800.0, 810, 640, 480, -0.3, 0.1, 1e-3, 5e-4, -0.01]))
    return regress(lenses.make("opencv5"), rays, camera.project(rays), (1280, 960)).params


def moved_zero():
    rng = np.random.default_rng(0)
    rays = np.c_[rng.uniform(-0.5, 0.5, (200, 2)), np.ones(200)]
    camera = Camera(lenses.make("opencv5"), np.array([800.0, 810, 640, 480, -0.3, 0.1, 1e-2, 5e-3, 0]))
    return np.array(direct.polynomial(rays, camera.project(rays), 3)[1])


def apart():
    cameras = [
        Camera(lenses.make("opencv5"), np.array([f, f, 640 + d, 480, -0.3, 0.1, 0, 0, 0]), (1280, 960))
        for f, d in ((800, 0), (830, 40))
    ]
    return difference.difference(*cameras).b_from_a.rotation


def inverted():
    def bent(w):
        return w * (1 - 0.3 * np.square(w).sum(1, keepdims=True))

    target = bent(np.random.default_rng(0).uniform(-0.6, 0.6, (30, 2)))
    return foreign.inverse(bent, target)[0]


def ptlens():
    uv = np.random.default_rng(0).uniform((0, 0), (1280, 960), (30, 2))
    return lensfun._rays(uv, (900.0, 900.0, 640.0, 480.0), 480.0, [0.01, -0.05, 0.02])[0]


def smooth_line():
    """Another line crosses the points of a line."""
    rng = np.random.default_rng(6)
    x = np.linspace(0, 400, 201)
    y = 0.05 * rng.normal(size=201) + np.where(np.arange(201) % 7 == 0, 0.02 * (x - 150), 0.0)
    found = detected_lines._smooth(np.c_[x, y])
    return np.zeros(2) if found is None else np.array([len(found[0]), found[1]])


def noise_parts():
    rng = np.random.default_rng(7)
    s = rng.uniform(0.05, 1.0, 400)
    squares = 2 * (0.1**2 + (0.5 * s) ** 2) * rng.exponential(size=400)
    return noise._likeliest(np.log([2.0, 0.01]), s, squares)[1]


def rendered_corner():
    gray = np.full((80, 80), 60.0)
    gray[:40, :40] = gray[40:, 40:] = 190
    gray = cv2.GaussianBlur(gray, (0, 0), 1.3) + np.random.default_rng(8).normal(size=gray.shape)
    sides = np.array([[[25.0, 0], [0, 25.0]]])
    return saddle.refine(gray.astype(np.float32), np.array([[40.4, 38.7]]), sides).uv


def rendered_disc():
    v, u = np.mgrid[:80, :80]
    gray = 60 + 130 / (1 + np.exp(-(np.hypot((u - 40.2) / 1.3, v - 39.6) - 14) / 0.8))
    shape = 15.0 * np.eye(2)[None]
    return disc_fit.fit_discs(gray.astype(np.float32), Discs(np.array([[41.0, 39.0]]), shape)).discs.centre


@cache
def projective_pairs():
    tracks = tracks_of(walk(4), 0.5)
    return reconstruct.pairs(tracks, 4), tracks


def focal_length_of_projective_views():
    pairs, tracks = projective_pairs()
    return dual_quadric.constant(projective_views.of_pairs(pairs, tracks, np.array([500.0, 400]), 1000.0))


def scene():
    """From a tenth of the focal length and two degrees off."""
    lines, size = test_scene.room(test_scene.CORNER), test_scene.SIZE
    start = Camera(test_scene.PINHOLE.lens, np.array([700.0, 700, 319.5, 239.5]), size)
    rotation = rotations.exp(np.array([0.02, -0.03, 0.02])) @ test_scene.CORNER
    vote = scene_vote.families(scene_vote.seen_lines(lines, False), start, rotation, 4.0)
    return scene_fit.fit_scene(lines, start, rotation, vote, {"aspect": None}, start).camera.params


def curve_of_a_fisheye():
    """Radii, in focal lengths, of rays up to 75 degrees."""
    r = np.tan(np.radians(np.linspace(1, 75, 60)))
    k, m = rational.fit_rational(r, 2 * np.sin(np.arctan(r) / 2), 3, 3)
    powers = np.square(r)[:, None] ** (1, 2, 3)
    return r * (1 + powers @ k) / (1 + powers @ m)


def up_to_a_fold():
    """Of a polynomial with r (1 - .3 r²), r the radius of the pixel; -1000 px beyond."""
    lens = lenses.make("polynomial:3")
    params = lens.from_values(
        {
            "fx": 800.0,
            "fy": 800.0,
            "cx": 640.0,
            "cy": 480.0,
            "a30": -0.3,
            "a12": -0.3,
            "b03": -0.3,
            "b21": -0.3,
        }
    )
    radius = 0.9**-0.5 * (1 - 0.3 / 0.9) - np.logspace(-9, -1, 400)
    rays = np.c_[radius, np.zeros(400), np.ones(400)]
    return np.nan_to_num(Camera(lens, params, (1280, 960)).project(rays), nan=-1000.0)


@cache
def with_wrong_points():
    """A calibration of points of which some are off by up to 40 px; which these are."""
    good = solved(views=4)
    count, rng = len(good.observations.uv), np.random.default_rng(0)
    wrong = np.isin(np.arange(count), rng.choice(count, count // 12, replace=False))
    uv = good.observations.uv.copy()
    uv[wrong] += rng.uniform(-40, 40, (wrong.sum(), 2))
    return refine(good.camera, good.poses, replace(good.observations, uv=uv), How()), wrong


def moved_by_wrong_points():
    """The change of the projection without them, px."""
    bad, wrong = with_wrong_points()
    return np.array([fit_check.moved_without(Facts(bad), wrong)[0]])


@cache
def of_a_needless_model():
    found = needless()
    return found, covariance(found)


def model_inside():
    """Its parameters, in standard deviations of the larger model."""
    found, linear = of_a_needless_model()
    end, _ = curvature._inside(found, linear)
    return (end.params - found.camera.params) / np.sqrt(np.diag(linear.matrix))


LIMITS = {
    "routes.epipolar.WEIGHTINGS": (0, 1e-5, fundamental),
    "routes.epipolar.ROUNDS": (1, 0.5, agreeing_matches),
    "routes.dual_quadric.ITERATIONS": (1, 1e-6, quadric),
    "routes.dual_quadric.WEIGHTINGS": (1, 1e-3, quadric_linear),
    "routes.lifted.ITERATIONS": (1, 1e-4, rays_of_lens),
    "routes.scene_vote.STEPS": (3, 1e-3, family_weights),
    "start.absolute_pose.STEPS": (2, 1e-6, pose),
    "start.mdlt.STEPS": (1, 1e-6, closed_form(mdlt.estimate, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.5)),
    "start.dlt_distorted.ROUNDS": (
        2, 1e-6, closed_form(dlt_distorted.estimate12, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.3, bend=-0.2),
    ),
    "start.claus.WEIGHTINGS": (
        1, 0.5, closed_form(claus.estimate, scenes.board(), scenes.tilts(8), noise=0.3, bend=-0.2),
    ),
    "start.fitzgibbon.ROUNDS": (
        2, 0.5, closed_form(fitzgibbon.estimate, scenes.board(), scenes.tilts(8), noise=0.3, bend=-0.2),
    ),
    "solve.ransac._REFITS": (1, 0.0, agreement),
    "solve.outliers._ROUNDS": (1, 1e-9, scale_of_view),
    "solve.condition._STEPS": (2, 1e-2, condition_number),
    "routes.projective_views.ROUNDS": (4, 1e-5, focal_length_of_projective_views),
    "routes.scene_fit.STEPS": (5, 1e-3, scene),
    "model.lenses.rational.TURNS": (3, 2e-8, curve_of_a_fisheye),
    "model.lenses.inverse.ITERATIONS": (5, 1e-9, up_to_a_fold),
    "assess.checks.fit.STEPS": (3, 1e-2, moved_by_wrong_points),
    "assess.curvature.INSIDE_ITERATIONS": (2, 1e-3, model_inside),
    "detect.segment_fit.WEIGHTINGS": (1, 1e-3, line_through_points),
    "detect.segment_fit.ROUNDS": (1, 1e-3, segment),
    "detect.shading.ROUNDS": (1, 1.0, surface),
    "model.lenses.regress.LAST_STEPS": (1, 1e-6, regressed),
    "model.lenses.direct.ROUNDS": (1, 1e-9, moved_zero),
    "assess.difference._STEPS": (1, 1e-9, apart),
    "data.formats.foreign.STEPS": (2, 1e-12, inverted),
    "data.formats.lensfun.STEPS": (2, 1e-12, ptlens),
    "detect.lines.ROUNDS": (1, 0.01, smooth_line),
    "solve.noise._STEPS": (2, 1e-2, noise_parts),
    "detect.fit.ITERATIONS": (1, 1e-3, rendered_corner),
    "detect.disc_fit.ITERATIONS": (1, 1e-2, rendered_disc),
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_more_change_nothing_and_few_are_not_enough(monkeypatch, name):
    few, tolerance, example = LIMITS[name]
    module, _, constant = name.rpartition(".")
    owner = importlib.import_module(f"camcal.{module}")
    limit = getattr(owner, constant)
    found = {}
    for count in (few, limit, 2 * limit):
        monkeypatch.setattr(owner, constant, count)
        found[count] = np.nan_to_num(np.atleast_1d(np.asarray(example(), float)))
    np.testing.assert_allclose(found[limit], found[2 * limit], rtol=0, atol=tolerance)
    assert np.abs(found[few] - found[limit]).max() > tolerance
