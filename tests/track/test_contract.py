"""What every estimator of the table keeps to; a new entry is tested by being listed."""

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.track.estimator import TrackState
from camcal.track.frames import Frame

from .helpers import (
    METHODS,
    follow,
    made_for,
    make,
    projection_error,
    round_trip,
    sequence,
    true_estimate,
    with_points,
)

pytestmark = pytest.mark.parametrize("method", METHODS)


def same(a: TrackState, b: TrackState):
    """Bit for bit."""
    for name in TrackState.__slots__:
        left, right = getattr(a, name), getattr(b, name)
        if name == "alarm":
            assert (left is None) == (right is None)
        elif isinstance(left, (np.ndarray, tuple)):
            assert all(np.array_equal(x, y) for x, y in zip(left, right, strict=True)), name
        else:
            np.testing.assert_equal(left, right, err_msg=name)  # NaN is equal to NaN


def test_converges_on_a_standing_camera(method):
    frames, truths = sequence("static", 80)
    estimator = made_for(method, "static")
    states = follow(estimator, frames)
    assert [s.frame for s in states] == [f.number for f in frames]
    assert not any(s.changed for s in states)
    errors = [projection_error(estimator, s, t, frames[0].xyz) for s, t in zip(states, truths, strict=True)]
    # One frame of 50 points at 0.3 px leaves 0.3 sqrt(11 / 100) = 0.1 px rms, up to four times that at the
    # worst point; the mean of 80 frames is nine times better, rls with its 99 frames of memory nearly so.
    assert errors[-1] < (0.6 if method == "batch" else 0.1)
    assert states[-1].noise == pytest.approx(0.3, rel=0.03)  # 80 x 89 degrees of freedom: sigma 0.8 %


def test_resumed_run_is_the_uninterrupted_run(method):
    frames, _ = sequence("knock", 30, knock=20, angle=1.0, outliers=0.05)
    frames[7] = with_points(frames[7], slice(0, 3))
    whole = make(method)
    expected = [whole.update(f) for f in frames]
    for cut in (0, 1, 8, 21, 29):
        first = make(method)
        for frame in frames[:cut]:
            first.update(frame)
        second = make(method)
        second.restore(round_trip(first.state()))
        for frame, wanted in zip(frames[cut:], expected[cut:], strict=True):
            same(second.update(frame), wanted)
        if whole.offline:
            reference = make(method)
            for a, b in zip(follow(reference, frames), second.finish(), strict=True):
                same(b, a)


def test_too_few_points_are_predicted_only(method):
    frames, _ = sequence("static", 12)
    frames[8] = with_points(frames[8], slice(0, 2))
    frames[9] = with_points(frames[9], slice(0, 0))
    estimator = make(method)
    states = [estimator.update(f) for f in frames]
    assert [s.status for s in states[8:11]] == ["predicted", "predicted", "updated"]
    before, after = states[7], states[9]
    assert np.abs(estimator.model.local(before.estimate, after.estimate)).max() < 1e-12  # log(R Rᵀ) rounds
    # the uncertainty does not shrink without data
    grown = np.linalg.norm(after.factor, axis=1) / np.linalg.norm(before.factor, axis=1)
    assert (grown > 1 - 1e-9).all()
    assert np.isnan(after.nis) and after.gain == 0


def test_outliers_are_gated(method):
    frames, truths = sequence("static", 60, outliers=0.1)
    estimator = made_for(method, "static")
    states = follow(estimator, frames)
    assert not any(s.changed for s in states)
    good = sum(int(t.good.sum()) for t in truths)
    used = sum(s.used for s in states)
    # all outliers that lie more than a few px off are out, and of the good points 1e-4 by the gate's own rate
    assert good - 10 <= used <= good + 10
    error = projection_error(estimator, states[-1], truths[-1], frames[0].xyz)
    assert error < (0.6 if method == "batch" else 0.12)


def test_late_and_repeated_frames_are_ignored(method):
    frames, _ = sequence("static", 10)
    plain, disturbed = make(method), make(method)
    for frame in frames:
        plain.update(frame)
    wild = Frame(0, frames[0].xyz, frames[0].uv + 50)
    for frame in frames:
        assert disturbed.update(frame) is not None
        assert disturbed.update(frame) is None  # again
        if frame.number:
            assert disturbed.update(wild) is None  # late
    assert disturbed.ignored == 19
    following = Frame(10, *_points(frames[0]))
    same(disturbed.update(following), plain.update(following))


def _points(frame):
    return frame.xyz, frame.uv


def test_time_that_does_not_advance_is_late(method):
    frames, _ = sequence("static", 3)
    estimator = make(method)
    for number, time in ((0, 0.0), (1, 0.5)):
        estimator.update(Frame(number, *_points(frames[number]), time=time))
    assert estimator.update(Frame(2, *_points(frames[2]), time=0.5)) is None
    assert estimator.update(Frame(3, *_points(frames[2]), time=0.6)) is not None


def test_a_changing_number_of_points(method):
    frames, truths = sequence("static", 60)
    rng = np.random.default_rng(1)
    cut = [with_points(f, rng.permutation(len(f))[: rng.integers(7, len(f))]) for f in frames]
    cut[0] = frames[0]
    estimator = made_for(method, "static")
    states = follow(estimator, cut)
    assert not any(s.changed for s in states)
    assert [s.points for s in states] == [len(f) for f in cut]
    if method != "batch":
        assert projection_error(estimator, states[-1], truths[-1], frames[0].xyz) < 0.15


def test_a_knock_is_seen_and_followed(method):
    frames, truths = sequence("knock", 60, knock=30, angle=0.3)
    estimator = made_for(method, "knock")
    states = follow(estimator, frames)
    assert [s.frame for s in states if s.changed] == [30]
    assert states[30].status == "restarted" and states[30].alarm is not None
    before, after = (projection_error(estimator, states[i], truths[i], frames[0].xyz) for i in (29, 59))
    assert max(before, after) < (0.6 if method == "batch" else 0.15)


def test_waits_for_enough_points(method):
    frames, _ = sequence("static", 6)
    estimator = make(method)
    few = [with_points(f, slice(2 * i, 2 * i + 2)) for i, f in enumerate(frames[:3])]
    statuses = [estimator.update(f).status for f in (*few, *frames[3:])]
    assert statuses == ["waiting", "waiting", "started", "updated", "updated", "updated"]


def test_frames_before_the_first_points_are_passed_over(method):
    """A film often begins before the target is held up: with more frames than an estimator waits for."""
    frames, _ = sequence("static", 16)
    estimator = make(method)
    empty = [with_points(f, slice(0, 0)) for f in frames[:14]]
    statuses = [estimator.update(f).status for f in (*empty, *frames[14:])]
    assert statuses[:14] == ["waiting"] * 14 and statuses[14] == "started"


def test_a_plane_in_one_view_is_refused(method):
    frames, _ = sequence("static", 20, thickness=0)
    estimator = make(method)
    with pytest.raises(EstimationError, match="plane") as caught:
        for frame in frames:
            estimator.update(frame)
    assert "iekf" in caught.value.hint


def test_no_frame_with_a_camera_is_an_error(method):
    frames, _ = sequence("static", 3)
    estimator = make(method)
    for frame in frames:
        estimator.update(with_points(frame, slice(0, 1)))
    with pytest.raises(EstimationError, match="needed to start"):
        estimator.finish()


def test_frames_that_fit_no_camera_are_rejected(method):
    frames, truths = sequence("static", 30)
    rng = np.random.default_rng(2)
    wild = Frame(20, frames[20].xyz, rng.uniform(0, 480, frames[20].uv.shape))
    estimator = made_for(method, "static")
    states = follow(estimator, [*frames[:20], wild, *frames[21:]])
    assert states[20].status == "rejected" and not states[20].changed
    assert not any(s.changed for s in states)
    if method != "batch":
        assert projection_error(estimator, states[-1], truths[-1], frames[0].xyz) < 0.15


def test_truth_is_within_the_stated_uncertainty(method):
    frames, truths = sequence("static", 40, seed=5)
    estimator = made_for(method, "static")
    state = follow(estimator, frames)[-1]
    error = estimator.model.local(state.estimate, true_estimate(estimator.model, truths[-1]))
    sigma = np.linalg.norm(state.factor, axis=1)
    assert (np.abs(error) < 4.5 * sigma).all()  # eleven normal deviates: 4.5 sigmas once in 13,000 runs
