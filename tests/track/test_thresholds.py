"""Each number that decides something, from both sides; and the process noise against its closed form."""

import numpy as np
import pytest
from scipy.stats import chi2

from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.settings.tracking import TrackOptions
from camcal.track import first, follow, recursive
from camcal.track.follow import Follower
from camcal.track.frames import Frame
from camcal.track.gains import AdaptiveGain
from camcal.track.noise import FLOOR, MEMORY, Noise
from camcal.track.output import Output
from camcal.track.robust import FrameFit
from camcal.track.table import Table
from tests.sides import LESS, MORE

from .helpers import make, sequence, with_points


def started(method="kalman", **options):
    """An estimator after one frame without noise, and that frame."""
    frames, _ = sequence("static", 1, noise=0.0, image_size=None)
    estimator = make(method, **{"sigma": 0.3, "motion": "fixed", **options})
    estimator.update(frames[0])
    return estimator, frames[0]


# ------------------------------------------------------------------------------------ process noise
@pytest.mark.parametrize("step", [1.0, 2.5])
@pytest.mark.parametrize("method", ["kalman", "iekf"])
def test_the_covariance_of_a_constant_velocity(method, step):
    """P⁺ = F P Fᵀ + [[s³/3, s²/2], [s²/2, s]] ⊗ Q (Bar-Shalom, Li & Kirubarajan 2001, eq. 6.2.2-12)."""
    estimator, _ = started(method, motion="pan", velocity=True)
    estimator._refresh()
    p = estimator.model.size
    q, before = estimator._process @ estimator._process.T, estimator.factor @ estimator.factor.T
    assert np.abs(q).max() > 0
    estimator._predict(step)
    forward = np.block([[np.eye(p), step * np.eye(p)], [np.zeros((p, p)), np.eye(p)]])
    white = np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
    wanted = forward @ before @ forward.T + np.kron(white, q)
    # relative to the geometric mean of the variances: rounding of sums of squares
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        (estimator.factor @ estimator.factor.T - wanted) / size / size[:, None], 0, atol=1e-9
    )


@pytest.mark.parametrize("step", [1.0, 2.5])
@pytest.mark.parametrize("method", ["kalman", "iekf"])
def test_the_covariance_of_a_random_walk(method, step):
    estimator, _ = started(method, motion="pan")
    estimator._refresh()
    wanted = estimator.factor @ estimator.factor.T + step * estimator._process @ estimator._process.T
    estimator._predict(step)
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        (estimator.factor @ estimator.factor.T - wanted) / size / size[:, None], 0, atol=1e-9
    )


def test_a_new_velocity_has_the_spread_of_a_hundred_frames():
    estimator, _ = started(motion="pan", velocity=True)
    p = estimator.model.size
    spread = estimator.factor[p:] @ estimator.factor[p:].T
    wanted = 100 * estimator._process @ estimator._process.T
    np.testing.assert_allclose(spread, wanted, atol=1e-9 * np.abs(wanted).max())


# ------------------------------------------------------------------------------------ the recursion
def test_frames_that_are_waited_for():
    frames, _ = sequence("static", recursive.PATIENCE)
    estimator = make("kalman")
    for frame in frames[:-1]:
        assert estimator.update(with_points(frame, slice(0, 5))).status == "waiting"
    with pytest.raises(EstimationError, match="5 different points in the first frames; 6 are needed"):
        estimator.update(with_points(frames[-1], slice(0, 5)))


@pytest.mark.parametrize(
    ("near", "alone"), [(round(50 * recursive.MAJORITY), False), (round(50 * recursive.MAJORITY) - 1, True)]
)
def test_a_majority_of_the_points_speaks_for_the_prediction(near, alone):
    """So many of 50 points near their prediction suffice; with one fewer the frame gets a camera of its own."""
    estimator, frame = started()
    uv = frame.uv.copy()
    uv[near:] += np.random.default_rng(0).uniform(40, 80, (50 - near, 2))
    reading = estimator._read(Frame(1, frame.xyz, uv))
    assert (reading.alone is not None) == alone
    assert np.count_nonzero(reading.keep) == near


LEAST = int(np.ceil(29 * recursive.SAME))


@pytest.mark.parametrize(("near", "kept"), [(LEAST, LEAST), (LEAST - 1, 29)])
def test_a_camera_that_explains_hardly_more_points_is_not_another_camera(near, kept, monkeypatch):
    """Beside the 29 points of the frame's own camera."""
    estimator, frame = started()
    uv = frame.uv.copy()
    uv[near:] += np.random.default_rng(0).uniform(40, 80, (50 - near, 2))
    own = np.arange(50) < 29
    fit = FrameFit(estimator.x, estimator.factor, None, own, 0.3, 0.3)
    monkeypatch.setattr(type(estimator), "_alone", lambda self, frame: fit)
    assert np.count_nonzero(estimator._read(Frame(1, frame.xyz, uv)).keep) == kept


@pytest.mark.parametrize(
    ("probability", "alone"), [(1.1 * recursive.SUSPECT, False), (0.9 * recursive.SUSPECT, True)]
)
def test_a_frame_that_contradicts_itself_is_examined(probability, alone):
    estimator, frame = started(gate=1e-12)
    noise = np.random.default_rng(0).normal(0, 0.3, frame.uv.shape)
    equations = estimator._read(Frame(1, frame.xyz, frame.uv + noise)).equations
    scale = np.sqrt(chi2.isf(probability, equations.dof) / equations.rest)
    reading = estimator._read(Frame(1, frame.xyz, frame.uv + scale * noise))
    assert (reading.alone is not None) == alone


def test_an_iteration_ends_where_it_moves_little(monkeypatch):
    """Linearised until a step is below a thousandth of a standard deviation, not to the last digit."""
    counts = []
    for settled in (recursive.SETTLED, 1e-300):
        monkeypatch.setattr(recursive, "SETTLED", settled)
        estimator, frame = started("iekf", iterations=30)
        linearise, calls = estimator.model.linearise, []

        def counted(*args, linearise=linearise, calls=calls):
            calls.append(0)
            return linearise(*args)

        monkeypatch.setattr(estimator.model, "linearise", counted)
        noise = np.random.default_rng(0).normal(0, 0.3, frame.uv.shape)
        estimator.update(Frame(1, frame.xyz, frame.uv + noise))
        counts.append(len(calls))
    assert counts[0] <= 4 and counts[1] > 8


# ------------------------------------------------------------------------------------ the start
def scattered(scatter):
    return FrameFit(None, np.eye(1), None, np.ones(4, bool), 1.0, scatter)


@pytest.mark.parametrize("sigma", [None, np.full(4, 0.5)])
def test_the_largest_scatter_in_sigmas(sigma):
    uv = np.array([[0.0, 0], [100, 0], [0, 100], [100, 100]])
    frame = Frame(0, np.zeros((4, 3)), uv, sigma)
    first._check_scatter(scattered(LESS * first.SCATTER * 0.2), frame, 0.2)
    with pytest.raises(EstimationError, match="times as far"):
        first._check_scatter(scattered(MORE * first.SCATTER * 0.2), frame, 0.2)


@pytest.mark.parametrize("unit", [1.0, 0.5])
def test_a_scatter_that_shows_no_camera(unit):
    """The four points have a standard deviation of 50 √2 px about their centre."""
    uv = np.array([[0.0, 0], [100, 0], [0, 100], [100, 100]])
    frame = Frame(0, np.zeros((4, 3)), uv, None if unit == 1 else np.full(4, unit))
    first._check_scatter(scattered(LESS * first.BLIND * 50 * np.sqrt(2) / unit), frame, None)
    with pytest.raises(EstimationError, match="fit no camera"):
        first._check_scatter(scattered(MORE * first.BLIND * 50 * np.sqrt(2) / unit), frame, None)


def test_flat_points_are_those_of_a_ten_thousandth():
    xyz = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    assert first.is_flat(xyz * [1, 1, 0.99e-4])
    assert not first.is_flat(xyz * [1, 1, 1.01e-4])


@pytest.mark.parametrize(
    ("drift", "refused"),
    [
        ({"rotation": 0.0199}, True),
        ({"rotation": 0.0201}, False),
        ({"translation": 4.99e-4}, True),
        ({"translation": 5.01e-4}, False),
    ],
)
def test_how_much_a_camera_has_to_move_before_a_plane(drift, refused):
    frames, _ = sequence("static", 1, thickness=0)
    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(900, 900, 320, 240))
    estimator = make("iekf", camera=camera, motion="fixed", drift=drift)
    if refused:
        with pytest.raises(EstimationError, match="intrinsics"):
            estimator._first(frames[0])
    else:
        estimator._first(frames[0])


# ------------------------------------------------------------------------------------ moving models
def test_when_the_matrix_has_moved():
    estimator, _ = started()
    model, x = estimator.model, estimator.x
    assert not model.moved(x, x + 0.0099) and model.moved(x, x + 0.0101)
    assert model.carry(x, np.full(11, 0.99e-3)) is None
    assert model.carry(x, np.full(11, 1.01e-3)) is not None


def test_when_the_physical_camera_has_moved():
    estimator, _ = started("iekf")
    model, x = estimator.model, estimator.x
    for part in (0.0098, -0.0098):
        assert not model.moved(x, x._replace(params=x.params * [1 + part, 1, 1, 1]))
        assert not model.moved(x, x._replace(translation=x.translation * (1 + part)))
    for part in (0.0102, -0.0102):
        assert model.moved(x, x._replace(params=x.params * [1 + part, 1, 1, 1]))
        assert model.moved(x, x._replace(translation=x.translation * (1 + part)))


# ------------------------------------------------------------------------------------ noise and gains
def test_the_degrees_of_freedom_that_the_noise_remembers():
    noise, most = Noise(), MEMORY
    noise.add(4 * (most - 1), most - 1)
    assert noise.dof == most - 1 and noise.sigma == pytest.approx(2.0)
    noise.add(4 * 1000.0, 1000)
    assert noise.dof == most
    noise.add(0.0, most)  # half of the weight from now on
    assert noise.sigma == pytest.approx(np.sqrt(2.0))
    exact = Noise()
    exact.add(0.0, 10)
    assert exact.sigma == FLOOR == 1e-6


def test_the_adaptive_gain_inflates_beyond_two_standard_deviations():
    """Ten frames of memory; P is multiplied by (mean - 1 - 2 spread) / predicted where that is above 1."""
    gain, p = AdaptiveGain(TrackOptions()), 4
    factor, a = 0.5 * np.eye(p), np.eye(p)
    for _ in range(400):
        same = gain.inflate(factor, a, np.full(p, np.sqrt(1.25)))  # as predicted: 1 + 0.25
    assert gain.weight == pytest.approx(10.0) and same is not factor
    np.testing.assert_array_equal(same, factor)
    gain.mean = 5.0
    z = np.full(p, np.sqrt(5.0))
    spread = 1.25 * np.sqrt(2.0 / p / 10)
    np.testing.assert_allclose(
        gain.inflate(factor, a, z), factor * np.sqrt((4.0 - 2 * spread) / 0.25), rtol=1e-9
    )


# ------------------------------------------------------------------------------------ changes
def follower(tmp_path):
    estimator = make("kalman", motion="fixed")
    return Follower(estimator, Output(Table(estimator.model), "csv", tmp_path / "t.csv"))


def test_a_change_is_described_some_frames_later(tmp_path):
    run = follower(tmp_path)
    frames, _ = sequence("knock", 60, knock=30, angle=0.5)
    for frame in frames[: 30 + follow.SETTLE]:
        run._take(frame)
    assert run.summary.change_count == 0
    run._take(frames[30 + follow.SETTLE])
    assert run.summary.change_count == 1


def test_so_many_changes_are_kept_and_all_are_counted(tmp_path, monkeypatch):
    run = follower(tmp_path)
    monkeypatch.setattr(follow, "explain", lambda alarm: alarm)
    for number in range(follow.KEPT + 1):
        run._alarm = number
        run._describe()
    assert run.summary.change_count == follow.KEPT + 1 and len(run.summary.changes) == follow.KEPT
