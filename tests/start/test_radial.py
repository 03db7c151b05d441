"""The start by the radial alignment constraint: wide lenses, real and simulated, from nothing."""

import numpy as np
import pytest

from camcal.data.observations import Correspondences
from camcal.data.points import read_points
from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.regress import regress
from camcal.solve.refine import How, refine, residuals
from camcal.start import radial
from tests.shared_data import DATA, needs_data

BOARD = np.stack(np.meshgrid(np.arange(12.0), np.arange(9.0)), -1).reshape(-1, 2) * 0.03


def views_of(camera, count=12, noise=0.0, tilt=35, seed=0, reach=0.45):
    """Views of a board, spread over the picture out to its corners by turning it about the camera."""
    rng = np.random.default_rng(seed)
    size = np.array(camera.image_size)
    made = []
    while len(made) < count:
        ray = camera.unproject(size / 2 + rng.uniform(-reach, reach, 2) * size)
        if not np.isfinite(ray).all():
            continue
        # the board faces the camera where it is, then is tilted
        turn = rotations.exp(np.deg2rad(tilt) * rng.normal(size=3) * [1, 1, 2])
        towards = np.cross([0.0, 0, 1], ray)
        sine = np.linalg.norm(towards)
        angle = np.arctan2(sine, ray[2])
        facing = rotations.exp(towards / max(sine, 1e-12) * angle)
        xyz = (np.c_[BOARD - BOARD.mean(0), np.zeros(len(BOARD))] @ turn.T + [0, 0, 0.35]) @ facing.T
        uv = camera.project(xyz)
        seen = np.isfinite(uv).all(1) & ((uv >= 0) & (uv < size)).all(1)
        if seen.sum() >= 40:
            xyz_board = np.c_[BOARD, np.zeros(len(BOARD))]
            made.append((xyz_board[seen], uv[seen] + noise * rng.normal(size=(int(seen.sum()), 2))))
    return Correspondences.from_views(made, image_size=camera.image_size)


def start(correspondences, model):
    """Radial start, regressed to the model and refined."""
    rough = radial.estimate(correspondences)
    uv = np.concatenate([v.uv for v in correspondences.views])
    rays = rough.camera.unproject(uv)
    seen = np.isfinite(rays).all(1)
    lens = lenses.make(model)
    params = regress(lens, rays[seen], uv[seen], correspondences.image_size).params
    camera = Camera(lens, params, correspondences.image_size)
    return rough, refine(camera, rough.poses, correspondences, How(dict.fromkeys(lens.default_fixed)))


def rms(camera, poses, correspondences):
    return float(np.sqrt((residuals(camera, poses, correspondences) ** 2).sum(1).mean()))


@pytest.mark.parametrize("model", ["kb4", "ucm", "eucm", "ds", "mei", "fov", "scaramuzza", "division:2"])
def test_lens_of_190_degrees(model):
    """True 190-degree lenses of each wide model, from noisy points, to their own noise."""
    lens = lenses.make(model)
    bend = {
        "kb4": {"k1": -0.015, "k2": 0.004, "k3": -0.003, "k4": 4e-4},
        "ucm": {"alpha": 0.62},
        "eucm": {"alpha": 0.62, "beta": 1.05},
        "ds": {"xi": -0.18, "alpha": 0.6},
        "mei": {"xi": 1.4, "k1": -0.1, "k2": 0.02, "p1": 1e-4, "p2": -1e-4},
        "fov": {"w": 0.95},
        "scaramuzza": {"c2": -0.27, "c3": 0.005, "c4": -0.02},
        "division:2": {"l1": -0.25, "l2": -0.02},
    }[model]
    unit = lens.from_values({"fx": 1.0, "fy": 1.0, **bend})
    edge = np.array([np.sin(np.deg2rad(95)), 0, np.cos(np.deg2rad(95))])
    f = 400 / float(lens.project(unit, edge)[0][0])  # 190 degrees over 800 px
    truth = Camera(lens, lens.from_values({"fx": f, "fy": f, "cx": 517.0, "cy": 392.0, **bend}), (1032, 778))
    correspondences = views_of(truth, noise=0.2, reach=0.36)
    rough, solution = start(correspondences, model)
    assert rough.info["half_field"] > 80
    # a start is good when it is nearer than what a board's squares are wide, some 20 px
    assert rms(rough.camera, rough.poses, correspondences) < 5
    assert solution.fit.converged
    # noise of .2 px in each coordinate; 3 % for its chance over 1000 points
    assert solution.rms_point < 0.2 * np.sqrt(2) * 1.03


def test_exact_points_give_exact_first_rows():
    lens = lenses.make("scaramuzza")
    values = {"fx": 300.0, "fy": 300.0, "cx": 511.5, "cy": 383.5, "c2": -0.3, "c3": 0.01, "c4": -0.01}
    truth = Camera(lens, lens.from_values(values), (1024, 768))
    correspondences = views_of(truth, reach=0.35)
    rough = radial.estimate(correspondences)
    # the centre is only sought to 1e-4 half diagonals, .06 px; all else follows it
    np.testing.assert_allclose(rough.camera.params, truth.params, rtol=2e-3, atol=2e-3)
    assert rms(rough.camera, rough.poses, correspondences) < 0.2


def test_pinhole_keeps_the_image_centre():
    """Without distortion nothing tells the centre: it stays where it was."""
    lens = lenses.make("pinhole")
    truth = Camera(lens, lens.pinhole(800, 800, 330, 236), (640, 480))
    rough = radial.estimate(views_of(truth, noise=0.1))
    assert np.hypot(*(np.array(rough.info["centre"]) - [319.5, 239.5])) < 20
    assert abs(rough.camera.params[0] / 800 - 1) < 0.03


def test_points_in_space():
    lens = lenses.make("kb4")
    truth = Camera(lens, lens.from_values({"fx": 300, "fy": 300, "cx": 510, "cy": 385}), (1024, 768))
    rng = np.random.default_rng(3)
    views = []
    for _ in range(3):
        xyz = rng.uniform(-1, 1, (150, 3)) * [1.5, 1.2, 1]
        cam = xyz @ rotations.exp(rng.normal(0, 0.3, 3)).T + [0, 0, 1.3]
        uv = truth.project(cam)
        seen = np.isfinite(uv).all(1) & ((uv > 0) & (uv < [1023, 767])).all(1)
        views.append((xyz[seen], uv[seen] + rng.normal(0, 0.2, (int(seen.sum()), 2))))
    rough = radial.estimate(Correspondences.from_views(views, image_size=(1024, 768)))
    assert rough.info["half_field"] > 70
    assert abs(rough.camera.params[0] / 300 - 1) < 0.02


@pytest.mark.parametrize("seed", range(5))
def test_fronto_parallel_views_are_refused(seed):
    lens = lenses.make("kb4")
    truth = Camera(lens, lens.from_values({"fx": 300, "fy": 300, "cx": 510, "cy": 385}), (1024, 768))
    rng = np.random.default_rng(seed)
    xyz = np.c_[BOARD, np.zeros(len(BOARD))]
    views = []
    for depth in (0.3, 0.4, 0.5, 0.35):
        uv = truth.project(xyz - [0.16, 0.12, -depth])
        views.append((xyz, uv + rng.normal(0, 0.1, uv.shape)))
    with pytest.raises(EstimationError, match="not determine the focal length"):
        radial.estimate(Correspondences.from_views(views, image_size=(1024, 768)))


@needs_data
@pytest.mark.parametrize(
    "name, model, wanted",
    [
        # reference optimum .4815
        ("ov_plane/train.csv", "kb4", 0.48154),
        # cv2's own reference .263783
        ("fisheye_jy/left.csv", "kb4", 0.263783),
        # as reached from Zhang's closed form
        ("mrcal_case/points.csv", "opencv5", 0.410593),
    ],
)
def test_real_lenses_from_nothing(name, model, wanted):
    size = (1920, 1080) if "mrcal" in name else (1280, 800)
    points = read_points(DATA / name)
    correspondences = Correspondences.from_views(points.views, size)
    _, solution = start(correspondences, model)
    assert solution.fit.converged
    assert solution.rms_point <= wanted * (1 + 1e-5)


def test_an_exact_view_square_to_the_camera_ends_with_an_error():
    # every equation of its depth is 0 = 0, the point on the axis has no direction: weights grow without bound
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    plane, seen = np.c_[x.ravel(), y.ravel(), 0 * x.ravel()], np.c_[100 + 10 * x.ravel(), 50 + 10 * y.ravel()]
    with pytest.raises(EstimationError, match="parallel to the image"):
        radial.estimate(Correspondences.from_views([(plane, seen)]))
