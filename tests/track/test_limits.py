"""Numbers of single frames, windows and rigs of a track, each just below and just above, or beside finer ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.track import checkpoint, motion, physical_model, rig_changes, rig_matches, robust, window
from camcal.track.frames import Frame
from camcal.track.physical_model import Physical, PhysicalModel
from tests.sides import LESS, MORE, same_with_finer_and_not_with_coarser
from tests.track import test_natural_drift as natural

from .helpers import make, sequence


def model_of(lens="pinhole", params=None, **fixed):
    return PhysicalModel(lenses.make(lens), None if params is None else np.array(params), fixed)


# ------------------------------------------------------------------------------------ the pose of a first frame
def test_rays_too_far_from_the_axis_for_a_pose(monkeypatch):
    model = model_of(params=[800.0, 800, 500, 400])
    xyz = np.random.default_rng(0).normal(size=(4, 3))

    def spread(_):
        raise EstimationError("enough")

    monkeypatch.setattr(physical_model, "_check_spread", spread)
    for share, said in ((LESS, "0 points have a ray"), (MORE, "enough")):
        depth = share * physical_model.SHALLOW
        rays = np.c_[np.full(4, np.sqrt(1 - depth**2)), np.zeros(4), np.full(4, depth)]
        model.lens = SimpleNamespace(unproject=lambda _, uv, r=rays: (r, np.ones(len(uv), bool)))
        with pytest.raises(EstimationError, match=said):
            model.start(Frame(0, xyz, np.zeros((4, 2))))


@pytest.mark.parametrize(("given", "beliefs"), [(False, (3, 3, 0.3)), (True, (0.02, 0.02, 0.03))])
def test_what_is_believed_before_the_first_frame(given, beliefs):
    """In focal lengths; a camera that is given is known to hundredths, one that is not within its own size."""
    params = np.array([800.0, 810, 500, 400, -0.1, 0, 0, 0])
    model = PhysicalModel(lenses.make("opencv4"), params if given else None)
    prior = np.diag(model.prior(Physical(params, np.eye(3), np.array([0.0, 0, 2]))))
    focal, principal, distortion = beliefs
    assert prior[:8] == pytest.approx([focal * 800] * 2 + [principal * 800] * 2 + [distortion] * 4)
    assert prior[8:11].min() > np.pi and prior[11:] == pytest.approx(20)  # ten distances


def test_a_first_frame_is_hardly_pulled_by_what_is_believed(monkeypatch):
    """Ten times weaker beliefs move its focal length by less than a tenth of its sigma, much stronger ones by more."""
    frames, _ = sequence("static", 1, noise=0.3, image_size=None)
    found = {}
    for factor in (1.0, 10.0, 1e-3):
        monkeypatch.setattr(physical_model, "UNKNOWN", {k: factor * v for k, v in START.items()})
        estimator = make("iekf", sigma=0.3, motion="fixed")
        estimator.update(frames[0])
        found[factor] = estimator.x.params[0], np.sqrt((estimator.factor[0] ** 2).sum())
    focal, sigma = found[1.0]
    assert abs(found[10.0][0] - focal) < 0.1 * sigma < abs(found[1e-3][0] - focal)


START = dict(physical_model.UNKNOWN)


# ------------------------------------------------------------------------------------ motions
def test_the_thermal_walk_of_half_an_hour():
    """At 30 frames a second: focal length by 1e-3 and principal point by 2 px, as the square root of the frames."""
    walk = {k: v * np.sqrt(30 * 60 * 30) for k, v in motion.MOTIONS["thermal"].items()}
    assert walk["focal"] == pytest.approx(1e-3, rel=0.2) and walk["principal"] == pytest.approx(2, rel=0.2)


@pytest.mark.parametrize("name", ["zoom", "pan", "free"])
def test_motions_are_above_what_is_called_slow(name):
    """What a motion is named for is at least ten times the same figure of `thermal`."""
    of = {"zoom": ("focal", "rotation"), "pan": ("rotation",), "free": ("rotation", "translation")}[name]
    for group in of:
        assert motion.MOTIONS[name][group] >= 10 * motion.MOTIONS["thermal"][group]


def test_a_reset_is_far_beyond_every_motion():
    for figures in motion.MOTIONS.values():
        assert all(motion.RESET[group] >= 60 * value for group, value in figures.items())


# ------------------------------------------------------------------------------------ iterations
def single_frame():
    frames, _ = sequence("static", 1, noise=0.3, image_size=None)
    uv = frames[0].uv.copy()
    uv[:4] += 30.0
    frame = Frame(0, frames[0].xyz, uv)
    model = model_of()
    model.settle(frame)
    start = model.start(frame)
    return robust.fit(model, start, frame, 0.3, 13.8).estimate.params / 1000


def test_steps_of_reweighting(monkeypatch):
    """Forty are enough, and three say that they are not; a finer accuracy changes nothing."""
    usual = single_frame()
    monkeypatch.setattr(robust, "STEPS", 3)
    with pytest.raises(EstimationError, match="does not converge"):
        single_frame()
    monkeypatch.setattr(robust, "STEPS", 2 * 40)
    np.testing.assert_array_equal(single_frame(), usual)


def matched():
    uv = natural.scene(np.random.default_rng(0), "ab", 60)
    uv["b"][:6] += 5.0
    rays = tuple(rig_matches.rays_of(natural.CAMERA, uv[n], np.zeros((4, 0))) for n in "ab")
    turned = natural.PLACES["b"]
    places = [
        natural.PLACES["a"],
        type(turned)(rotations.exp(np.array([0.01, -0.02, 0.01])) @ turned.rotation, turned.translation),
    ]
    made = rig_matches.instant_of_matches(
        "0", [rig_matches.PairMatches(0, 1, rays)], places, np.zeros((2, 6, 0))
    )
    return np.concatenate(made.left)


@pytest.mark.parametrize(("name", "coarse", "fine"), [("STEPS", 1, 24), ("SETTLED", 1e3, 1e-9)])
def test_steps_of_matches(monkeypatch, name, coarse, fine):
    """What is left of the matches, px, is the same to a hundredth of their noise."""
    same_with_finer_and_not_with_coarser(monkeypatch, rig_matches, name, coarse, fine, 1e-3, matched)


def windowed():
    frames, _ = sequence("pan", 3, noise=0.3, image_size=None)
    estimator = make("window", sigma=0.3, motion="free", window=3, iterations=20)
    for frame in frames:
        estimator.update(frame)
    return estimator.x.params / 1000


def test_when_a_window_is_adjusted(monkeypatch):
    """To a thousandth of a standard deviation, which is a part of 1e-3 of the focal length."""
    same_with_finer_and_not_with_coarser(monkeypatch, window, "SETTLED", 1e9, 1e-9, 1e-6, windowed)


# ------------------------------------------------------------------------------------ rigs
@pytest.mark.parametrize(
    ("rank", "freedom"), [(rig_changes.POSE - 1, 6), (rig_changes.POSE, 6), (rig_changes.POSE + 1, 7)]
)
def test_the_least_degrees_of_freedom_of_a_scatter(monkeypatch, rank, freedom):
    """Of one known instant: those of a pose at least."""
    monkeypatch.setattr(rig_changes, "inverse", lambda _: (np.eye(1), rank))
    known = SimpleNamespace(normal=np.eye(1), right=np.zeros(1), cameras=())
    assert rig_changes.excess([], [known], np.eye(1))[1] == freedom


def test_states_that_are_read(tmp_path, monkeypatch):
    path = tmp_path / "state"
    checkpoint.save(path, {"a": 1})
    size = path.stat().st_size
    assert checkpoint.LARGEST > 10 << 20  # that of some hundred parameters with their window
    monkeypatch.setattr(checkpoint, "LARGEST", size)
    checkpoint.load(path)
    monkeypatch.setattr(checkpoint, "LARGEST", size - 1)
    with pytest.raises(DataError, match=r"more than|larger|at most"):
        checkpoint.load(path)
