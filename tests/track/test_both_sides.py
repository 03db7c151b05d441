"""Numbers that decide something in tracking beside those of `test_thresholds`, each just below and just above."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.track import detection, events, first, matrix_model, noise, physical_model, robust, table
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
        a = np.diag([1.0, 1.0, share * robust.UNDETERMINED])
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
