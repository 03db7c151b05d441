"""Numbers that decide something in the routes, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.routes import epipolar, line_geometry, lines, reconstruct, scene_start
from camcal.routes.hand_eye import motions, recognise, scale, variance
from camcal.routes.hand_eye.motions import Motions
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ lines
def series(correlation, pairs, lag=1):
    """Residuals whose products at a lag have a mean of so many times their mean square (1), of one group."""
    rng = np.random.default_rng(0)
    count = pairs + lag
    sign = np.ones(count)
    same = round(pairs * (1 + correlation) / 2)
    steps = np.ones(pairs)
    steps[: pairs - same] = -1
    rng.shuffle(steps)
    for i in range(pairs):
        sign[i + lag] = sign[i] * steps[i]
    return sign


def test_a_significant_correlation():
    pairs = 400
    limit = lines.SIGNIFICANT / np.sqrt(pairs)  # .1
    group = np.zeros(pairs + 1, int)
    assert lines.inflation(series(limit - 0.01, pairs), group) == 1
    assert lines.inflation(series(limit + 0.01, pairs), group) > 1 + 2 * limit


def test_enough_pairs_for_a_correlation():
    for pairs, known in ((lines.LEAST_PAIRS, True), (lines.LEAST_PAIRS - 1, False)):
        residuals = np.ones(pairs + 1)
        assert (lines.inflation(residuals, np.zeros(pairs + 1, int)) > 1) == known


def test_the_longest_lag():
    """Equal residuals are correlated at every lag: the sum ends at a tenth of their number."""
    count = 10 * lines.LAGS
    assert lines.inflation(np.ones(count), np.zeros(count, int)) == 1 + 2 * (count // lines.LAGS - 1)


def test_the_axis_that_a_vector_is_crossed_with():
    for x in (LESS * line_geometry.NEAR_X, MORE * line_geometry.NEAR_X, 1.0, 0.0, -1.0):
        vector = np.array([[x, np.sqrt(1 - x * x), 0.0]])
        frame = np.concatenate([vector, line_geometry.tangents(vector)[0].T])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("count", [lines.LEAST_LINES, lines.LEAST_LINES - 1])
def test_enough_lines(count):
    some = [np.c_[np.arange(6.0), np.full(6, 10.0 * i)] for i in range(count)]
    given = line_geometry.Lines.of(some, [str(i) for i in range(count)], (640, 480))
    if count >= lines.LEAST_LINES:
        lines._check(given)
    else:
        with pytest.raises(DataError, match="line"):
            lines._check(given)


# ------------------------------------------------------------------------------------ two views
@pytest.mark.parametrize("count", [epipolar.LEAST, epipolar.LEAST - 1])
def test_enough_matches(count):
    rng = np.random.default_rng(1)
    points = rng.uniform((-1, -1, 3), (1, 1, 5), (count, 3))
    first, second = (500 * p[:, :2] / p[:, 2:] for p in (points, points + (0.5, 0.1, 0.2)))
    found = epipolar.fundamental(first, second)
    assert (found is not None) == (count >= epipolar.LEAST)


def test_matches_that_agree_with_a_fundamental_matrix():
    """Exact matches and one that is off across its epipolar line: `least` px of Sampson's distance are allowed."""
    rng = np.random.default_rng(2)
    points = rng.uniform((-1, -1, 3), (1, 1, 5), (40, 3))
    first, second = (500 * p[:, :2] / p[:, 2:] for p in (points, points + (0.5, 0.0, 0.0)))
    for distance, agrees in ((LESS, True), (MORE, False)):
        moved = second.copy()
        # the lines are rows of the picture: Sampson's distance is the difference of rows over sqrt(2)
        moved[7, 1] += np.sqrt(2) * distance * epipolar.LEAST_FAR
        good = epipolar.fundamental(first, moved)[1]
        # with the match, the matrix bends towards it by some per cent: a second one at half the distance
        if agrees:
            assert good.all()
    moved[7, 1] += 1.0
    good = epipolar.fundamental(first, moved)[1]
    assert not good[7] and good.sum() == 39


def test_rays_that_are_parallel():
    ray = np.array([[0.0, 0.0, 1.0]])
    motion = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    for angle, known in ((10 * np.sqrt(epipolar.PARALLEL), True), (0.0, False)):
        other = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
        points, _ = epipolar.two_view_points(motion, ray, other)
        assert np.isfinite(points).all() == known


def test_the_scale_of_a_first_adjustment():
    assert reconstruct.loose_scale(np.array([1.0, 3.0, 9.0])) == reconstruct.LOOSE * 3
    limit = reconstruct.LEAST_SCALE / reconstruct.LOOSE
    assert reconstruct.loose_scale(np.full(3, LESS * limit)) == reconstruct.LEAST_SCALE
    assert reconstruct.loose_scale(np.full(3, MORE * limit)) > reconstruct.LEAST_SCALE


@pytest.mark.parametrize("seen", [reconstruct.LEAST_SEEN, reconstruct.LEAST_SEEN - 1])
def test_images_that_determine_a_view(seen):
    """Two views of the same points: with too few of them neither takes part."""
    tracks = SimpleNamespace(point=np.tile(np.arange(seen), 2), view=np.repeat([0, 1], seen))
    bundle = SimpleNamespace(
        residuals=lambda tracks: np.zeros((2 * seen, 2)), points=np.zeros((seen, 3)), rotations=[None, None]
    )
    count = 2 * seen if seen >= reconstruct.LEAST_SEEN else 0
    assert len(reconstruct.usable(bundle, tracks, 1.0)) == count


def test_an_image_within_the_bound():
    tracks = SimpleNamespace(point=np.tile(np.arange(6), 2), view=np.repeat([0, 1], 6))
    for off, count in ((1.0, 12), (MORE, 10)):  # the point has one image left, and is not used
        residuals = np.zeros((12, 2))
        residuals[3, 0] = off
        bundle = SimpleNamespace(
            residuals=lambda tracks, r=residuals: r, points=np.zeros((6, 3)), rotations=[None, None]
        )
        assert len(reconstruct.usable(bundle, tracks, 1.0)) == count


# ------------------------------------------------------------------------------------ scenes
def test_the_same_frame():
    turned = np.eye(3)[[1, 2, 0]] * [[1], [-1], [1]]  # other names and senses of the axes
    assert scene_start._same(1000.0, np.eye(3), 1000.0, turned)
    for share, same in ((LESS, True), (MORE, False)):
        rotation = rotations.exp(np.array([0.0, 0.0, share * scene_start.SAME]))
        assert scene_start._same(1000.0, np.eye(3), 1000.0, rotation) == same
        focal = 1000.0 * (1 + share * scene_start.SAME_FOCAL)
        assert scene_start._same(focal, np.eye(3), 1000.0, np.eye(3)) == same


@pytest.mark.parametrize("count", [scene_start.SAMPLE - 1, scene_start.SAMPLE])
def test_enough_lines_for_a_sample(count):
    """Lines towards two orthogonal points; of fewer than a sample there is no candidate."""
    ends = np.array(
        [[[-100, -80], [60, -90]], [[-90, 70], [80, 95]], [[-70, -60], [-95, 80]], [[75, -50], [99, 70]]]
    )
    found = scene_start.frames(ends[:count].astype(float), np.zeros(2), 320.0, 0, 300.0)
    assert bool(found) == (count >= scene_start.SAMPLE)


# ------------------------------------------------------------------------------------ hand-eye
def test_an_axis_by_its_letter():
    for share, letter in ((LESS, True), (MORE, False)):
        angle = share * motions.ALONG
        words = motions._axis(np.array([np.sin(angle), 0.0, -np.cos(angle)]))
        assert words.startswith("axis z (") == letter


def test_enough_poses():
    motions.require_enough(motions.LEAST_VIEWS)
    with pytest.raises(DataError, match="a hand-eye calibration needs 3"):
        motions.require_enough(motions.LEAST_VIEWS - 1)


def turning(first, second):
    """Motions whose turns about two axes are so many times their noise of .1 degrees."""
    turns = 0.1 * np.array([first, second, 0.0])
    return SimpleNamespace(turns_deg=turns, noise_deg=np.full(3, 0.1), axes=np.eye(3))


def test_turns_about_a_second_axis():
    limit = motions.ABOVE_NOISE
    motions.require_two_axes(turning(100.0, MORE * limit))
    with pytest.raises(EstimationError, match="turn about parallel axes"):
        motions.require_two_axes(turning(100.0, LESS * limit))
    with pytest.raises(EstimationError, match="which is noise: without rotations"):
        motions.require_two_axes(turning(LESS * limit, 0.0))
    with pytest.raises(EstimationError, match="turn about parallel axes"):
        motions.require_two_axes(turning(MORE * limit, 0.0))
    assert Motions is not None


@pytest.mark.parametrize("unit", ["mm", "cm", "in"])
def test_the_ratio_of_two_units(unit):
    factor = scale.MILLIMETRES[unit]
    assert scale._is(factor * (1 + LESS * scale.NEAR_UNIT), 1.0, unit)
    assert not scale._is(factor * (1 + MORE * scale.NEAR_UNIT), 1.0, unit)
    assert scale._is(-factor, 1.0, unit)
    assert not scale._is(factor, 1.0, None)


def test_no_other_unit_is_as_near():
    """The tenth is less than half of what two units differ by."""
    sizes = np.array(sorted(scale.MILLIMETRES.values()))
    assert (sizes[1:] / sizes[:-1]).min() > (1 + scale.NEAR_UNIT) / (1 - scale.NEAR_UNIT)


def test_poses_that_say_something_of_an_outlier():
    """The others' scatter has degrees of freedom only where there are more numbers than unknowns and one pose."""
    misfit = np.array([1.0, 1.0, 400.0])
    shared = variance.NUMBERS * 3 - variance.NUMBERS
    assert variance.outlying(misfit, shared).tolist() == [1, 1, 1]
    assert variance.outlying(misfit, shared - 1)[2] < 1


def test_readings_that_rounding_tells_apart():
    """Of equal readings the first one is taken; of others the one with the smaller residuals."""

    def reading(misfit):
        return SimpleNamespace(misfit=misfit, shift=0.01)

    size = 0.01 + recognise.ROUNDING
    step = size * 10.0**-recognise.DIGITS
    first, second = reading(0.01), reading(0.01 - 0.2 * step)
    base = np.log([size, size]).sum()
    # where the sum is rounded the same way
    if round(base, recognise.DIGITS) == round(base - 0.2 * 10.0**-recognise.DIGITS, recognise.DIGITS):
        assert recognise.likeliest([first, second]) is first
    assert recognise.likeliest([first, reading(0.01 - 3 * step)]) is not first
