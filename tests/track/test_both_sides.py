"""Numbers that decide something in tracking beside those of `test_thresholds`, each just below and just above."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.track import (
    detection,
    events,
    first,
    linear,
    matrix_model,
    noise,
    physical_model,
    rig_changes,
    rig_equations,
    robust,
    table,
)
from camcal.track.matrix_model import MatrixModel
from camcal.track.model import MOVED
from camcal.track.physical_model import Physical, PhysicalModel
from tests.sides import LESS, MORE


def test_a_direction_by_its_axis():
    for share, word in ((LESS, "-y"), (MORE, "(")):
        angle = share * events.ALONG
        assert events.axis(5 * np.array([np.sin(angle), -np.cos(angle), 0.0])).startswith(word)


def test_the_bound_of_few_degrees_of_freedom():
    """dof (exp(-2 ln p / dof) - 1), infinite where the exponential is no float64."""
    probability = 1e-3
    for share, finite in ((MORE, True), (LESS, False)):
        dof = -2 * share * math.log(probability) / noise.LARGEST
        assert math.isfinite(noise.gate(probability, dof)) == finite


def test_the_least_threshold():
    """An alarm in nearly every frame: the threshold is no less than the least one."""
    assert detection.cusum_threshold(0.9999) == detection.LOWEST
    assert detection.cusum_threshold(0.1) > detection.LOWEST
    # on both sides of the place where the threshold goes on as the logarithm
    near = [detection.cusum_threshold(share * detection.EXPONENTIAL) for share in (LESS, MORE)]
    assert near[0] - near[1] == pytest.approx(np.log(MORE / LESS), abs=2 * detection.SOLVED)


def test_points_on_a_plane():
    xyz = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    xyz -= xyz.mean(0)
    u, s, vt = np.linalg.svd(xyz, full_matrices=False)
    for share, flat in ((0.99, True), (1.01, False)):
        extents = np.array([s[0], s[1], share * first.FLAT * s[0]])
        assert first.is_flat(u * extents @ vt) == flat


@pytest.mark.parametrize("count", [first.LEAST_SAMPLED, first.LEAST_SAMPLED - 1])
def test_points_from_which_samples_are_drawn(count):
    xyz = np.random.default_rng(0).uniform(-1, 1, (count, 3))
    uv = 500 * xyz[:, :2] / (xyz[:, 2:] + 4)
    found = first._sampled(xyz, uv)
    assert len(found) == (first.SAMPLES if count >= first.LEAST_SAMPLED else 0)


def test_points_that_determine_a_camera():
    for share, determined in ((MORE, True), (LESS, False)):
        a = np.diag([1.0, 1.0, share * linear.UNDETERMINED])
        if determined:
            np.testing.assert_allclose(a @ robust._solve(a, np.ones(3)), np.ones(3))
        else:
            with pytest.raises(EstimationError, match="do not determine the camera"):
                robust._solve(a, np.ones(3))


def test_an_estimate_that_moved():
    model = MatrixModel()
    origin = np.zeros(11)
    for share, moved in ((LESS, False), (MORE, True)):
        x = origin.copy()
        x[3] = -share * MOVED
        assert model.moved(origin, x) == moved
        before = Physical(np.array([800.0, 800, 320, 240]), np.eye(3), np.array([0.0, 0, 2]))
        longer = Physical(before.params * [1 / (1 - share * MOVED), 1, 1, 1], np.eye(3), before.translation)
        nearer = Physical(before.params, np.eye(3), np.array([0.0, 0, 2 - 2 * share * MOVED]))
        assert PhysicalModel.moved(SimpleNamespace(), before, longer) == moved
        assert PhysicalModel.moved(SimpleNamespace(), before, nearer) == moved


def test_a_covariance_that_follows_the_motion():
    model = MatrixModel()
    x = np.eye(4)[:3].ravel()[:11] + np.r_[np.zeros(8), 0.1, 0.0, 1.0]
    for share, follows in ((LESS, False), (MORE, True)):
        walked = np.zeros(11)
        walked[5] = share * matrix_model.WALKED
        assert (model.carry(x, walked) is not None) == follows


def test_both_forms_of_a_rotation():
    """On both sides of the series: rounding of 1e-16, beside the exact functions of `rotations`."""
    axis = np.array([0.6, -0.48, 0.64])
    for share in (LESS, MORE):
        vector = np.sqrt(share * physical_model.SERIES) * axis
        np.testing.assert_allclose(physical_model._exp(vector), rotations.exp(vector), atol=1e-15)
        np.testing.assert_allclose(physical_model._log(rotations.exp(vector)), vector, atol=1e-15)


def test_both_forms_of_the_jacobian_of_a_logarithm():
    """Just above the series the exact form loses digits: 1e-16 / angle² beside a term of angle²."""
    axis = np.array([0.6, -0.48, 0.64])
    below, above = (
        table.inverse_left_jacobian((share * table.SERIES * axis)[None])[0] for share in (LESS, MORE)
    )
    change = (MORE - LESS) * table.SERIES * 0.5
    np.testing.assert_allclose(below, above, atol=change + 1e-15)


def test_the_largest_deviate():
    """The probability of a larger one underflows."""
    for nis, largest in ((36.9**2, False), (37.1**2, True), (1e9, True)):
        found = detection.normal_deviate(nis, 1, math.inf)
        assert (found == detection.LARGEST) == largest and found > 36


def test_what_all_deviates_may_exceed():
    """The sum grows by what a deviate exceeds half the shift that it is quickest for."""
    for share, since in ((LESS, None), (MORE, 3)):
        test = detection.ChangeTest(1e-3)
        test.step(3, share * detection.REFERENCE)
        assert test.since == since


def explained(monkeypatch, **amounts):
    """The explanation of a change of some parameters by so many standard deviations of independent errors."""
    step = np.zeros(11)
    for name, amount in amounts.items():
        step[np.arange(11)[getattr(events, name)][0]] = amount
    monkeypatch.setattr(events, "difference", lambda *_: (step, np.eye(11)))
    alarm = SimpleNamespace(before=None, after=None, frame=5, since=4)
    return events.explain(alarm).kind


def test_an_explanation_of_more_parameters(monkeypatch):
    """Each costs the logarithm of a hundred, of which three more are needed for a pose than for a rotation."""
    for share, kind in ((LESS, "rotation"), (MORE, "pose")):
        shift = np.sqrt(share * 3 * events.PENALTY)
        assert explained(monkeypatch, ROTATION=30.0, TRANSLATION=shift) == kind


def test_an_unlikely_explanation(monkeypatch):
    """A principal point has one number fewer than a translation, and odds against it."""
    for more, kind in ((-0.01, "principal point"), (0.01, "translation")):
        shift = np.sqrt(9 + events.PENALTY - events.ODDS["principal point"] + more)
        assert explained(monkeypatch, PRINCIPAL=3.0, TRANSLATION=shift) == kind


@pytest.mark.parametrize(("share", "determined"), [(MORE, True), (LESS, False)])
def test_points_that_determine_a_projection_matrix(monkeypatch, share, determined):
    xyz = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    uv = 500 * xyz[:, :2] / (xyz[:, 2:] + 4)
    matrices, singular = first.dlt.solve(xyz[None], uv[None])
    singular = singular.copy()
    singular[:, 10] = share * first.UNDETERMINED * singular[:, 0]
    monkeypatch.setattr(first.dlt, "solve", lambda *_: (matrices, singular))
    if determined:
        assert first.projection_matrix(xyz, uv).shape == (3, 4)
    else:
        with pytest.raises(EstimationError, match="undetermined"):
            first.projection_matrix(xyz, uv)


@pytest.mark.parametrize(("share", "alike"), [(LESS, True), (MORE, False)])
def test_instants_that_show_the_same_change(monkeypatch, share, alike):
    limit = stats.chi2.isf(rig_changes.SAME, 6)
    monkeypatch.setattr(rig_changes, "disagreement", lambda *_: (share * limit, 6))
    watch = SimpleNamespace(test=lambda *_: SimpleNamespace(chi2=1.0), calibration=None, factor=1.0)
    instant = SimpleNamespace(cameras={0: None})
    alone = SimpleNamespace(cameras={1: None})
    owner = rig_changes.RigFollower
    assert owner._alike(watch, instant, instant) == alike
    assert not owner._alike(watch, instant, alone)


def test_directions_that_data_do_not_see():
    """An eigenvalue of the normal equations, relative to the largest, whatever the units of the rows."""
    units = np.array([1.0, 1e3, 1e-2])
    for share, rank in ((MORE, 3), (LESS, 2)):
        # of unit diagonal: two columns with the correlation 1 - e have the eigenvalues 2 - e and e
        e = 2 * share * rig_equations.NULL
        matrix = np.array([[1, 1 - e, 0], [1 - e, 1, 0], [0, 0, 1.0]]) * np.outer(units, units)
        assert rig_equations.inverse(matrix)[1] == rank


def test_instants_after_a_change():
    """They have no test of their own, and the last of them ends the change."""
    renewed, noted = [], []
    watch = SimpleNamespace(
        settling=("knock", rig_changes.SETTLING), kept=[], _note=lambda i, status: noted.append(status)
    )
    watch._renew = lambda: renewed.append(len(watch.kept))
    while not renewed:
        rig_changes.RigFollower._settle(watch, None)
    assert renewed == [rig_changes.SETTLING] and set(noted) == {"settling"}
    found = SimpleNamespace(since="b")
    watch = SimpleNamespace(
        kept=[], changes=[], settling=None, _alarm=lambda: found, _note=lambda *_, **__: None
    )
    rig_changes.RigFollower._add(watch, [SimpleNamespace(name=n) for n in "abc"])
    assert watch.settling == (found, rig_changes.SETTLING) and [i.name for i in watch.kept] == ["b", "c"]


def test_instants_that_are_kept():
    """The longest window."""
    watch = SimpleNamespace(kept=[], _alarm=lambda: None, _note=lambda *_, **__: None)
    most = rig_changes.WINDOWS[-1]
    for n in range(most + 3):
        rig_changes.RigFollower._add(watch, [n])
    assert watch.kept == list(range(3, most + 3))


def test_a_depth_that_is_none():
    """Points nearer to the camera's plane, in the unit of M, have no image."""
    model = MatrixModel()
    x = np.eye(4)[:3].ravel()[:11]  # the depth of a point is Z + 1
    frame = lambda z: SimpleNamespace(xyz=np.array([[0.1, 0.2, z - 1]]), uv=np.zeros((1, 2)))  # noqa: E731
    for share, valid in ((0.99, False), (1.01, True)):
        assert model.linearise(x, frame(share * matrix_model.NEAREST))[1].tolist() == [valid]
