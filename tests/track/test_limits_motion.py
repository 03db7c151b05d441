"""What is believed of motions and of changes, and what rounding may do: numbers just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.settings.tracking import TrackOptions
from camcal.track import detection, events, gains, linear, motion, physical_model, recursive, robust, smoother
from camcal.track.frames import Frame
from camcal.track.iekf import MOVES
from tests.sides import LESS, MORE

from .helpers import follow, make, sequence

#: what each walks by in a second at 30 frames a second: a fraction, px, degrees, a fraction of the distance
SECOND = {
    "zoom": {"focal": 0.016, "principal": 1.1},
    "pan": {"rotation": 0.55},
    "free": {"rotation": 0.55, "translation": 0.016},
}


# ------------------------------------------------------------------------------------ motions
@pytest.mark.parametrize("name", SECOND)
def test_the_walk_of_a_second(name):
    for group, walk in SECOND[name].items():
        assert motion.MOTIONS[name][group] * np.sqrt(30) == pytest.approx(walk, rel=0.05)


@pytest.mark.parametrize("name", ["pan", "free"])
def test_the_inside_of_a_camera_that_moves(name):
    for group in ("focal", "principal"):
        assert motion.MOTIONS[name][group] == pytest.approx(motion.MOTIONS["thermal"][group] / 5)


@pytest.mark.parametrize("name", SECOND)
@pytest.mark.parametrize("part", [1.0, 0.1])
def test_a_walk_that_is_followed_and_a_slower_one_that_raises_alarms(monkeypatch, name, part):
    """Of a camera that walks by what is stated above."""
    kind = {"zoom": "zoom", "pan": "pan", "free": "pan"}[name]
    drift = {group: walk / np.sqrt(30) for group, walk in SECOND[name].items()}
    frames, _ = sequence(kind, 25, noise=0.3, image_size=None, drift=drift)
    figures = {group: part * value for group, value in motion.MOTIONS[name].items()}
    monkeypatch.setitem(motion.MOTIONS, name, figures)
    states = follow(make("iekf", sigma=0.3, motion=name), frames)
    assert (sum(bool(s.alarm) for s in states) > 5) == (part < 1)


def test_a_standing_camera_before_a_plane_is_none_of_the_moving_ones():
    """`MOVES` separates the motions that show a plane from several sides."""
    for name, moves in (("fixed", False), ("thermal", False), ("zoom", False), ("pan", True), ("free", True)):
        figures = motion.figures(name, {})
        assert any(figures[group] >= least for group, least in MOVES.items()) == moves


def after_a_knock(factor, monkeypatch):
    """The camera right after a turn by 3 degrees, in standard deviations of one frame."""
    monkeypatch.setattr(motion, "RESET", {group: factor * value for group, value in RESET.items()})
    frames, _ = sequence("knock", 12, noise=0.3, image_size=None, knock=10, angle=3.0)
    estimator = make("kalman", sigma=0.3, motion="fixed")
    states = follow(estimator, frames)
    sigmas = np.linalg.norm(make_alone(frames[10]).factor, axis=1)
    return np.asarray(states[10].estimate) / sigmas, states[10]


RESET = dict(motion.RESET)
VELOCITY_FRAMES = recursive.VELOCITY_FRAMES


def make_alone(frame):
    alone = make("kalman", sigma=0.3, motion="fixed")
    alone.update(frame)
    return alone


def test_how_far_a_camera_may_be_after_a_change(monkeypatch):
    """Three times as far leads to the same camera, within a tenth of its sigma; a hundredth of it does not."""
    usual, far, near = (after_a_knock(factor, monkeypatch)[0] for factor in (1.0, 3.0, 0.01))
    assert np.abs(usual - far).max() < 0.1 < np.abs(usual - near).max()


def test_what_is_believed_of_a_velocity(monkeypatch):
    """After ten frames twice as much has led to the same camera, within half of its sigma; much less has not."""
    frames, _ = sequence("pan", 10, noise=0.3, image_size=None)
    found = {}
    for factor in (1, 4, 1e-6):
        monkeypatch.setattr(recursive, "VELOCITY_FRAMES", factor * VELOCITY_FRAMES)
        estimator = make("iekf", sigma=0.3, motion="pan", velocity=True)
        follow(estimator, frames)
        found[factor] = estimator.x.params / np.linalg.norm(estimator.factor[:4], axis=1)
    usual, more, few = found.values()
    assert np.abs(usual - more).max() < 0.5 < np.abs(usual - few).max()


def test_what_all_scores_may_have_in_common(monkeypatch):
    """A noise that is estimated from few points: a shift of three of its standard deviations is not summed up."""
    for share, summed in ((LESS, False), (MORE, True)):
        test = detection.ChangeTest(1e-6)
        allowance = 0.2
        test.step(0, share * (recursive.ALLOWED * allowance + detection.REFERENCE), 3.0 * allowance)
        assert (test.sum > 0) == summed
    estimator = make("iekf", motion="fixed")
    asked = []
    monkeypatch.setattr(detection.ChangeTest, "step", lambda _, frame, score, more: asked.append(more))
    for frame in sequence("static", 2, image_size=None)[0]:
        degrees = estimator.noise.dof
        estimator.update(frame)
    assert asked == [pytest.approx(3 * np.sqrt(len(estimator.factor) / degrees))]


def test_a_pose_of_which_nothing_is_believed(monkeypatch):
    """A prior that is three times as wide leads to the same sigmas, and one of a milliradian does not."""
    frames, _ = sequence("static", 1, noise=0.3, image_size=None)
    found = {}
    usual = physical_model.ANY_POSE
    for value in (usual, 3 * usual, 1e-4 * usual):
        monkeypatch.setattr(physical_model, "ANY_POSE", value)
        estimator = make("iekf", sigma=0.3, motion="fixed")
        estimator.update(frames[0])
        found[value] = np.linalg.norm(estimator.factor, axis=1)
    usual, wide, narrow = found.values()
    np.testing.assert_allclose(usual, wide, rtol=1e-3)
    assert (narrow < 0.5 * usual).any()


# ------------------------------------------------------------------------------------ rounding
def test_turns_of_which_the_arcsine_has_all_digits():
    """On both sides of 30 degrees the vector is that of `rotations`, and near 90 degrees it would not be."""
    axis = np.array([0.6, -0.48, 0.64])
    for share in (LESS, MORE):
        turn = rotations.exp(np.arcsin(share * physical_model.SHORT) * axis)
        np.testing.assert_allclose(physical_model._log(turn), rotations.log(turn), atol=1e-15)
    nearly = 0.5 * np.pi - 1e-5
    assert abs(np.arcsin(np.sin(nearly)) - nearly) > 1e-13


@pytest.mark.parametrize(("share", "settled"), [(LESS, True), (MORE, False)])
def test_a_step_that_ends_the_reweighting(monkeypatch, share, settled):
    """Of so much of a standard deviation; larger ones go on and never settle."""
    model = SimpleNamespace(size=1, linearise=lambda *_: (None, None), retract=lambda x, _: x)
    monkeypatch.setattr(robust, "_distances", lambda *_: np.ones(4))
    monkeypatch.setattr(robust, "_scale", lambda *_: 1.0)
    monkeypatch.setattr(robust, "_equations", lambda *_: (np.eye(1), None))
    monkeypatch.setattr(robust, "_solve", lambda *_: np.array([share * robust.SETTLED]))
    monkeypatch.setattr(robust, "_finish", lambda *_: "settled")
    frame = Frame(0, np.zeros((4, 3)), np.zeros((4, 2)))
    if settled:
        assert robust.fit(model, 0.0, frame, 0.3, 9.0) == "settled"
    else:
        with pytest.raises(EstimationError, match="does not converge"):
            robust.fit(model, 0.0, frame, 0.3, 9.0)


@pytest.mark.parametrize(("share", "determined"), [(LESS, False), (MORE, True)])
def test_directions_that_are_determined(share, determined):
    a = np.diag([1.0, share * linear.UNDETERMINED])
    gain = gains.FixedGain(TrackOptions(gain="fixed", alpha=0.5))(np.eye(2), a, np.eye(2), 1.0)
    assert gain[0, 0] == pytest.approx(0.5) and (gain[1, 1] != 0) == determined
    turn = np.array([[1.0, 0.0], [1.0, 2 * share * linear.UNDETERMINED]])
    found = smoother._scaled_inverse(turn)
    assert (np.abs(found).max() > 1e5) == determined


def test_explanations_that_differ_by_rounding(monkeypatch):
    """The first one is taken, until another is better by more than that."""
    eye = np.eye(11)
    step = np.zeros(11)
    step[5] = 1.0
    monkeypatch.setattr(events, "difference", lambda *_: (step, np.eye(11)))
    monkeypatch.setattr(events, "_in_words", lambda *_: ("", {}))
    alarm = SimpleNamespace(before=None, after=None, frame=1, since=0)
    for share, kind in ((LESS, "rotation"), (MORE, "pose")):
        # what is left of the first is 1 - c² = share times the limit, by a direction at an angle to the step
        off = np.sqrt(share * events.EQUAL)
        leaning = (np.sqrt(1 - off**2) * eye[:, 5] + off * eye[:, 6])[:, None]
        monkeypatch.setattr(events, "EXPLANATIONS", {"rotation": leaning, "pose": eye[:, 5:6]})
        assert events.explain(alarm).kind == kind


def test_covariances_that_rounding_made_singular(monkeypatch):
    """Of two parameters that changed alike by exactly as much; ten times as much leads to the same."""
    step = np.zeros(11)
    step[5] = 10.0
    covariance = np.eye(11)
    covariance[8, 9] = covariance[9, 8] = 1 - 1e-17
    monkeypatch.setattr(events, "difference", lambda *_: (step, covariance))
    monkeypatch.setattr(
        events, "_in_words", lambda kind, _, change, sigma: ("", {"change": change, "sigma": sigma})
    )
    alarm = SimpleNamespace(before=None, after=None, frame=1, since=0)
    found, ridge = [], events.RIDGE
    for factor in (1.0, 10.0):
        monkeypatch.setattr(events, "RIDGE", factor * ridge)
        found.append(events.explain(alarm))
    assert {f.kind for f in found} == {"rotation"}
    np.testing.assert_allclose(found[0].figures["change"], found[1].figures["change"], atol=1e-6)
    monkeypatch.setattr(events, "RIDGE", -1e-17)
    with pytest.raises(np.linalg.LinAlgError):
        events.explain(alarm)


@pytest.mark.parametrize("rate", [1e-6, 1e-9])
def test_nodes_of_the_mean_time_to_an_alarm(rate):
    """Twice as many give the same time to a ten-thousandth of it, and an eighth of them does not."""
    threshold = detection.cusum_threshold(rate)
    usual, more, few = (detection.mean_time_to_alarm(threshold, nodes=n) for n in (detection.NODES, 160, 10))
    assert abs(usual / more - 1) < 1e-4 < abs(usual / few - 1)
