"""Cases of their own: planes with known intrinsics, distortion, velocities, gains, noise, long runs."""

import numpy as np
import pytest

from camcal.errors import DataError, EstimationError, UsageError
from camcal.geometry import projective, rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.track.frames import Frame
from camcal.track.physical_model import Physical

from .helpers import follow, made_for, make, nees, projection_error, sequence, with_points

PINHOLE = lenses.make("pinhole")
KNOWN = Camera(PINHOLE, PINHOLE.pinhole(900, 900, 320, 240))


@pytest.mark.parametrize("method", ["iekf", "window", "smoother"])
def test_a_plane_is_fine_with_known_intrinsics(method):
    """NEES of 6 degrees of freedom over 5 runs: bounds of probability 1e-4 each side."""
    total = 0.0
    for seed in range(5):
        frames, truths = sequence("static", 20, seed=seed, thickness=0, outliers=0.05)
        estimator = made_for(method, "static", camera=KNOWN, fix={"intrinsics": None})
        total += nees(estimator, follow(estimator, frames)[-1], truths[-1])
    assert 9.4 < total < 65.6


def test_four_points_of_a_plane_start_a_known_camera():
    frames, _ = sequence("static", 3, thickness=0)
    estimator = make("iekf", camera=KNOWN, fix={"intrinsics": None})
    few = [with_points(f, slice(0, 5)) for f in frames]
    assert [s.status for s in follow(estimator, few)] == ["started", "updated", "updated"]


def test_known_intrinsics_that_are_not_held_are_refused_on_a_plane():
    frames, _ = sequence("static", 12, thickness=0)
    estimator = make("iekf", camera=KNOWN)
    with pytest.raises(EstimationError, match="intrinsics"):
        follow(estimator, frames)


def test_parameters_are_held_at_their_values():
    frames, _ = sequence("static", 10)
    estimator = make("iekf", fix={"cx": 321.0, "aspect": None})
    state = follow(estimator, frames)[-1]
    params = state.estimate.params
    assert params[2] == 321.0 and params[0] == pytest.approx(params[1], rel=1e-12)
    assert state.factor.shape == (8, 8)
    with pytest.raises(UsageError, match="not given"):
        make("iekf", fix={"fx": None})


def test_distortion_is_tracked():
    lens = lenses.make("opencv4")
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-1, 1, (80, 3))
    params = np.array([500.0, 505, 320, 240, -0.2, 0.08, 1e-3, -5e-4])
    rotation, translation = rotations.exp(np.array([0.1, -0.2, 0.05])), np.array([0.1, 0, 2.6])
    uv = lens.project(params, xyz @ rotation.T + translation)[0]
    frames = [Frame(i, xyz, uv + rng.normal(0, 0.2, uv.shape)) for i in range(40)]
    estimator = make("iekf", model="opencv4", motion="fixed")
    state = follow(estimator, frames)[-1]
    error = estimator.model.local(state.estimate, Physical(params, rotation, translation))
    deviates = np.linalg.solve(state.factor, error)
    assert deviates @ deviates < 45  # chi-squared of 14 degrees of freedom: 4e-5
    assert state.estimate.params[4] == pytest.approx(-0.2, abs=0.01)


@pytest.mark.parametrize("method", ["kalman", "iekf", "smoother"])
def test_velocity_follows_a_smooth_pan_better_than_a_walk(method):
    rng = np.random.default_rng(0)
    xyz, k = rng.uniform(-1, 1, (50, 3)), np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
    frames, matrices = [], []
    for number in range(120):
        turn = rotations.exp(np.array([0, np.deg2rad(4 * np.sin(number / 40)), 0]))
        matrices.append(projective.compose(k, turn, turn @ [0, 0, 5.0]))
        uv = projective.project(matrices[-1], xyz)
        frames.append(Frame(number, xyz, uv + rng.normal(0, 0.3, uv.shape)))
    errors = {}
    for velocity, walk in ((False, 0.05), (True, 0.002)):
        estimator = make(method, motion="fixed", drift={"rotation": walk}, velocity=velocity)
        states = follow(estimator, frames)
        assert not any(s.changed for s in states)
        found = estimator.model.describe([s.estimate for s in states], [s.factor for s in states]).matrix
        errors[velocity] = np.mean(
            [
                np.abs(projective.project(m, xyz) - projective.project(t, xyz)).mean()
                for m, t in zip(found, matrices, strict=True)
            ][20:]
        )
    assert errors[True] < errors[False]


def test_gains_without_velocity_are_refused_with_one():
    for gain in ("fixed", "forgetting", "mean"):
        with pytest.raises(UsageError, match="velocity"):
            make("kalman", gain=gain, velocity=True)
    with pytest.raises(UsageError, match="gain"):
        make("window", gain="fixed")


def test_the_adaptive_gain_follows_what_the_motion_does_not_say():
    frames, truths = sequence("thermal", 200, drift={"focal": 2e-4})
    errors = {}
    for gain in ("kalman", "adaptive"):
        estimator = make("kalman", motion="fixed", gain=gain, false_alarm=1e-300)
        state = follow(estimator, frames)[-1]
        errors[gain] = projection_error(estimator, state, truths[-1], frames[0].xyz)
    assert errors["adaptive"] < 0.5 * errors["kalman"]


def test_forgetting_has_the_memory_of_its_factor():
    frames, _ = sequence("static", 200, points=40)
    state = follow(make("rls", forgetting=0.9), frames)[-1]
    assert state.effective == pytest.approx((1 + 0.9) / (1 - 0.9), rel=0.02)
    assert state.gain == pytest.approx(0.1, rel=0.02)


def test_the_mean_counts_all_frames():
    frames, _ = sequence("static", 50)
    states = follow(make("rls", gain="mean"), frames)
    assert states[-1].effective == pytest.approx(50, rel=0.01)
    assert states[-1].gain == pytest.approx(1 / 50, rel=0.01)


def test_a_gap_counts_as_time():
    frames, _ = sequence("static", 30)
    plain, gap = make("kalman", motion="pan"), make("kalman", motion="pan")
    for frame in frames[:20]:
        plain.update(frame), gap.update(frame)
    for number in range(20, 25):
        plain.update(Frame(number, np.zeros((0, 3)), np.zeros((0, 2))))
    a, b = (e.update(Frame(25, frames[25].xyz, frames[25].uv)) for e in (plain, gap))
    np.testing.assert_allclose(a.factor @ a.factor.T, b.factor @ b.factor.T, rtol=1e-9)


def test_times_count_by_the_rate():
    frames, _ = sequence("static", 12)
    by_number, by_time = make("kalman", motion="pan"), make("kalman", motion="pan", rate=50.0)
    for i, frame in enumerate(frames):
        a = by_number.update(Frame(3 * i, frame.xyz, frame.uv))
        b = by_time.update(Frame(i, frame.xyz, frame.uv, time=10 + 3 * i / 50))
    np.testing.assert_allclose(a.factor @ a.factor.T, b.factor @ b.factor.T, rtol=1e-9)


def test_sigmas_of_points_weigh():
    frames, truths = sequence("static", 30, noise=0.0)
    rng = np.random.default_rng(0)
    sigma = np.where(np.arange(len(frames[0])) % 2, 0.1, 2.0)
    noisy = [
        Frame(f.number, f.xyz, f.uv + sigma[:, None] * rng.normal(size=f.uv.shape), sigma) for f in frames
    ]
    blind = [Frame(f.number, f.xyz, f.uv) for f in noisy]
    good, bad = make("kalman", motion="fixed"), make("kalman", motion="fixed")
    weighted = projection_error(good, follow(good, noisy)[-1], truths[-1], frames[0].xyz)
    unweighted = projection_error(bad, follow(bad, blind)[-1], truths[-1], frames[0].xyz)
    assert weighted < 0.5 * unweighted
    assert good.noise.sigma == 1.0
    learnt = make("kalman", motion="fixed", learn_noise=True)
    follow(learnt, noisy)
    assert learnt.noise.sigma == pytest.approx(1.0, rel=0.05)  # 30 x 89 degrees of freedom: 1.4 %


def test_a_sigma_that_the_points_contradict_is_an_error():
    frames, _ = sequence("static", 12)
    with pytest.raises(EstimationError, match="times as far"):
        follow(make("kalman", sigma=0.02), frames)


def test_a_left_handed_world_is_named():
    frames, _ = sequence("static", 3)
    mirrored = [Frame(f.number, f.xyz * [1, 1, -1], f.uv) for f in frames]
    with pytest.raises(DataError, match="left-handed"):
        follow(make("kalman"), mirrored)


def test_points_without_noise_do_no_harm():
    frames, truths = sequence("static", 20, noise=0.0)
    for method in ("rls", "kalman", "iekf"):
        estimator = make(method)
        state = follow(estimator, frames)[-1]
        assert projection_error(estimator, state, truths[-1], frames[0].xyz) < 1e-6


def test_a_camera_that_looks_elsewhere_is_found_again():
    frames, truths = sequence("static", 20)
    turn = rotations.exp(np.array([0.0, 0.0, np.pi]))
    matrix = projective.compose(truths[0].k, turn @ truths[0].rotation, turn @ truths[0].translation)
    rng = np.random.default_rng(0)
    turned = [
        Frame(f.number + 20, f.xyz, projective.project(matrix, f.xyz) + rng.normal(0, 0.3, f.uv.shape))
        for f in frames
    ]
    for method in ("rls", "kalman", "iekf"):
        states = follow(make(method), [*frames, *turned])
        assert [s.frame for s in states if s.changed] == [20]
        assert states[-1].status == "updated" and states[-1].innovation < 0.6


@pytest.mark.parametrize("method", ["rls", "kalman", "iekf"])
def test_square_roots_neither_drift_nor_grow(method):
    """1,500 frames: the covariance keeps to what theory says; benchmarks run a million."""
    frames, _ = sequence("static", 4, points=8)
    # the gate and the change test are put aside: here only the recursion counts
    estimator = make(
        method, **({"motion": "fixed"} if method != "rls" else {}), sigma=0.3, gate=1e-9, false_alarm=1e-300
    )
    estimator.update(frames[0])
    start = estimator.factor.copy()
    for number in range(1, 1500):
        frame = frames[0]
        state = estimator.update(Frame(number, frame.xyz, frame.uv))
    if method == "rls":
        # in the steady state the covariance is that of one frame over (1 + λ) / (1 - λ)
        ratio = (1 - 0.98) / (1 + 0.98)
    else:
        ratio = 1 / 1500
    one, many = start @ start.T, state.factor @ state.factor.T
    np.testing.assert_allclose(np.diag(many) / np.diag(one), ratio, rtol=1e-3 if method == "iekf" else 1e-6)


@pytest.mark.parametrize("dof", [1, 3, 40, 5000])
def test_the_gate_is_a_quantile(dof):
    from scipy.stats import f

    from camcal.track.noise import gate

    assert gate(1e-4, dof) == pytest.approx(2 * f.isf(1e-4, 2, dof), rel=1e-6)
    assert gate(1e-4, 1e12) == pytest.approx(gate(1e-4, np.inf), rel=1e-6)


@pytest.mark.parametrize("points", [6, 7, 9])
@pytest.mark.parametrize("method", ["rls", "kalman", "iekf"])
def test_few_points_make_neither_alarms_nor_outliers(method, points):
    """The noise rests on 1, 3 or 7 degrees of freedom at first, and no test may take it for known."""
    for seed in range(6):
        frames, _ = sequence("static", 60, seed=seed, points=points)
        states = follow(made_for(method, "static"), frames)
        assert not any(s.changed for s in states)
        assert sum(s.used for s in states) >= points * 60 - 3 * points  # the start may wait for frames


def test_a_set_of_points_that_never_suffices_is_named():
    """Five points come again in every frame: together they are still five."""
    frames, _ = sequence("static", 12)
    with pytest.raises(EstimationError, match="5 different points"):
        follow(make("kalman"), [with_points(f, slice(0, 5)) for f in frames])


@pytest.mark.parametrize("method", ["kalman", "iekf"])
def test_points_matched_at_random_are_no_noise(method):
    frames, _ = sequence("static", 12)
    rng = np.random.default_rng(0)
    mixed = [Frame(f.number, f.xyz, rng.permutation(f.uv)) for f in frames]
    with pytest.raises(EstimationError, match="fit no camera"):
        follow(make(method), mixed)


@pytest.mark.parametrize("method", ["rls", "kalman", "iekf"])
def test_many_outliers_are_no_change(method):
    """With 27 of 50 points good, a robust fit of the frame alone can take in one that is a little off."""
    frames, truths = sequence("static", 50, image_size=None)
    rng = np.random.default_rng(0)
    for frame in frames[20:]:
        frame.uv[:22] = rng.uniform(0, 480, (22, 2))
        frame.uv[22] += rng.choice([-3.5, 3.5], 2)
    estimator = made_for(method, "static")
    states = follow(estimator, frames)
    assert {s.status for s in states[1:]} == {"updated"}
    assert all(s.used <= 29 for s in states[20:])  # a point anywhere may fall within the gate, rarely
    assert projection_error(estimator, states[-1], truths[-1], frames[0].xyz) < 0.12
