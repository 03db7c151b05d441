"""Accuracies at which iterations end, and further rounds: finer ones change less than the tolerance, coarser ones more.

The tolerance is a part of what noise does to the result. Limits of rounds and steps are in `test_limits_of_work`,
numbers of the detection in `tests/detect/test_accuracy_limits.py`.
"""

import importlib
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import candidate_views
from camcal.assess.causes import effect
from camcal.assess.covariance import covariance
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.model.rectification import rectify
from camcal.routes import lines, natural
from camcal.solve.poses import refine_poses
from camcal.start import dlt_distorted, fitzgibbon, mdlt, radial
from camcal.start import pose as start_pose
from tests.contracts import test_limits_of_work as work
from tests.routes import test_lines, test_natural
from tests.sides import same_with_finer_and_not_with_coarser
from tests.solved import solved
from tests.start import scenes


def initial_poses():
    rng = np.random.default_rng(0)
    views = scenes.scene(scenes.board(), scenes.tilts(4), noise=0.0).observations.views
    ab = [(v.uv - scenes.K[:2, 2]) / 1000 + 2e-3 * rng.normal(size=v.uv.shape) for v in views]
    found = start_pose.initial_poses([v.xyz for v in views], ab, [None] * 4)
    return np.r_[rotations.log(found.rotations).ravel(), found.translations.ravel()]


def radial_focal():
    made = work.noisy(scenes.board(), scenes.tilts(6), 0.3, scenes.K_NO_SKEW, bend=-0.2)
    return np.array([radial.estimate(made).camera.params[0]])


def left_of_a_turn():
    """Pixels, of a camera that is turned by 9 degrees."""
    camera = Camera(lenses.make("opencv4"), np.array([800.0, 800, 640, 480, -0.3, 0.1, 0, 0]), (1280, 960))
    rays = np.c_[np.random.default_rng(0).uniform(-0.5, 0.5, (30, 2)), np.ones(30)]
    pixels = camera.project(rays @ rotations.exp(np.array([0.1, -0.08, 0.1])).T)
    warp = SimpleNamespace(field=lambda uv: (np.zeros((0, 2, uv.shape[1])), None))
    return effect._left(camera, warp, np.zeros(0), rays, pixels)


def scatter_by_noise():
    """The mean square, px², by a covariance of a calibration of six views."""
    good = solved(views=6)
    rays = np.c_[np.random.default_rng(0).uniform(-0.5, 0.5, (30, 2)), np.ones(30)]
    warp = SimpleNamespace(field=lambda uv: (np.zeros((0, 2, uv.shape[1])), None), fields=())
    trial = SimpleNamespace(camera=good.camera, warp=warp, covariance=covariance(good).free)
    return np.array([effect._by_noise(good, trial, rays, None)])


def placed_targets():
    """Positions, in squares of the board; some have to be moved far into the picture."""
    candidates = candidate_views.Candidates(solved(views=4), True)
    rng = np.random.default_rng(0)
    turned = rotations.exp(rng.normal(0, 0.4, (60, 3)))
    return candidates._placed(turned, rng.uniform(0, 400, (60, 2)), rng.uniform(0.25, 0.9, 60)).translations


def turn_of_a_pair():
    """Of 4 degrees, rad."""
    one = test_natural.camera()
    uv = [q[:160] for q in test_natural.matched(one, one, test_natural.POSE, wrong=20)]
    wrong = Pose(rotations.exp(np.array([0.05, 0.03, 0.04])), np.zeros(3)) @ test_natural.POSE
    return natural.turn_of(rectify(one, one, wrong), *uv).vector


def straight_lines():
    lens = lenses.make("division:1")
    start = Camera(lens, lens.pinhole(1280, 1280, 639.5, 479.5), test_lines.SIZE)
    made = test_lines.lines_of(test_lines.DIVISION, count=15, noise_px=0.1, points=12)
    return lines.fit(made, start, {"fx": 1280.0, "fy": 1280.0}).camera.params


def poses_of_views():
    """Translations in standard deviations, about .002 of a square."""
    good = solved(views=3)
    turned = rotations.exp(np.full((3, 3), 0.02)) @ good.poses.rotations
    off = Poses(turned, good.poses.translations * 1.02)
    return refine_poses(good.camera, good.observations.kept().views, off)[0].translations / 0.002


#: module.NAME: (coarse, fine, tolerance, example)
ACCURACIES = {
    "solve.condition._ACCURACY": (0.5, 1e-9, 1e-2, work.condition_number),
    "solve.noise._SETTLED": (1e4, 1e-9, 1e-2, work.noise_parts),
    "solve.outliers._SETTLED": (0.9, 1e-12, 1e-6, work.scale_of_view),
    "start.absolute_pose.SETTLED": (10.0, 1e-14, 1e-4, work.pose),
    "start.mdlt.SETTLED": (
        1e3, 1e-14, 1e-3, work.closed_form(mdlt.estimate, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.5),
    ),
    "start.dlt_distorted.SETTLED": (
        1.0, 1e-13, 1e-3,
        work.closed_form(dlt_distorted.estimate12, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.3, bend=-0.2),
    ),
    "start.fitzgibbon.SETTLED": (
        1.0, 1e-15, 0.1,
        work.closed_form(fitzgibbon.estimate, scenes.board(), scenes.tilts(8), noise=0.3, bend=-0.2),
    ),
    "start.pose.SETTLED": (1e9, 1e-9, 1e-4, initial_poses),
    "start.radial.ROUNDS": (1, 40, 1.0, radial_focal),
    "start.radial.LEAST_ROUNDS": (0, 6, 1.0, radial_focal),
    "start.radial.CENTRE_SPREAD": (1e-4, 0.07, 1.5, radial_focal),
    "solve.poses._TOLERANCE": (1e-2, 1e-16, 1e-3, poses_of_views),
    "assess.causes.effect._STEPS": (1, 10, 1e-9, left_of_a_turn),
    "assess.causes.effect._STILL": (1e-2, 1e-15, 1e-9, left_of_a_turn),
    "assess.causes.effect._SMALL": (30.0, 1e-4, 1e-2, scatter_by_noise),
    "model.lenses.direct.SETTLED": (10.0, 1e-15, 1e-9, work.moved_zero),
    "routes.dual_quadric.SETTLED": (0.1, 1e-13, 1e-6, work.quadric),
    "routes.lifted.SETTLED": (0.1, 1e-10, 1e-4, work.rays_of_lens),
    "assess.candidate_views._FITS": (6, 50, 1e-3, placed_targets),
    "routes.natural.TURN_STEPS": (1, 16, 1e-6, turn_of_a_pair),
    "routes.lines.ROUNDS": (1, 24, 1e-5, straight_lines),
}  # fmt: skip


@pytest.mark.parametrize("name", ACCURACIES)
def test_finer_is_the_same_and_coarser_is_not(monkeypatch, name):
    module, _, constant = name.rpartition(".")
    owner = importlib.import_module(f"camcal.{module}")
    same_with_finer_and_not_with_coarser(monkeypatch, owner, constant, *ACCURACIES[name])
