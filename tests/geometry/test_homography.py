"""Batched homographies: exactness, the maximum likelihood estimate, covariances, degenerate points."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry import homography

GRID = np.stack(np.meshgrid(np.arange(9) * 0.03, np.arange(6) * 0.03), -1).reshape(-1, 2)


def truth(count, seed=0):
    """Homographies of boards about 1000 px wide, with up to a factor 2 of perspective."""
    random = np.random.default_rng(seed)
    h = np.tile(np.eye(3), (count, 1, 1))
    turn = random.uniform(0, 2 * np.pi, count)
    c, s = np.cos(turn), np.sin(turn)
    h[:, :2, :2] = np.stack([np.stack([c, -s], 1), np.stack([s, c], 1)], 1) * random.uniform(
        1000, 4000, (count, 1, 2)
    )
    h[:, :2, 2] = random.uniform(0, 1000, (count, 2))
    h[:, 2, :2] = random.uniform(-1, 1, (count, 2))
    return h


def views(count, noise=0.0, seed=0):
    h = truth(count, seed)
    xy = np.broadcast_to(GRID, (len(h), *GRID.shape))
    uv = homography.transfer(h, xy)
    return h, xy, uv + noise * np.random.default_rng(seed + 1).normal(size=uv.shape)


def test_exact_data_to_rounding():
    h, xy, uv = views(200)
    found = homography.homographies(xy, uv)
    # the contract is 1e-9 px; rounding of coordinates of some 1000 px allows 1e-11
    assert np.abs(homography.transfer(found, xy) - uv).max() < 1e-11
    np.testing.assert_allclose(found / found[:, 2:, 2:], h, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found, axis=(1, 2)), 1)


@given(st.integers(0, 2**32 - 1), st.floats(-1e5, 1e5), st.floats(1e-3, 1e3))
def test_far_from_the_origin_and_in_any_unit(seed, offset, unit):
    _, xy, uv = views(3, seed=seed)
    moved = (xy + offset) * unit
    found = homography.homographies(moved, uv)
    # the board's own coordinates are rounded by 1e5 * 1e-16 of the 1e-2 between corners: 1e-9 of a square,
    # which a view stretched to 1e5 px per unit shows as 1e-6 px
    assert np.abs(homography.transfer(found, moved) - uv).max() < 1e-5


def test_maximum_likelihood_like_cv2():
    _, xy, uv = views(20, noise=0.5)
    found, _, cost = homography.solve(xy, uv, steps=5)
    residual = homography.transfer(found, xy) - uv
    np.testing.assert_allclose((residual**2).sum((1, 2)), cost, rtol=1e-9)
    for i in range(len(xy)):
        reference = cv2.findHomography(xy[i], uv[i])[0]
        theirs = ((homography.transfer(reference[None], xy[i : i + 1]) - uv[i]) ** 2).sum()
        # cv2 stops at 10 iterations or a relative step of 1e-7: neither may be lower by more than that
        assert cost[i] <= theirs * (1 + 1e-12)
        assert cost[i] == pytest.approx(theirs, rel=1e-5)


def test_one_step_is_nearly_all():
    _, xy, uv = views(50, noise=0.5)
    once, many = (homography.solve(xy, uv, steps=s)[2] for s in (1, 20))
    np.testing.assert_allclose(once, many, rtol=1e-4)


def test_weights():
    _, xy, uv = views(10)
    spoilt = uv.copy()
    spoilt[:, 7] += 30
    weights = np.ones(uv.shape[:2])
    weights[:, 7] = 1e-14
    found = homography.homographies(xy, spoilt, weights)
    clean = np.delete(homography.transfer(found, xy) - uv, 7, axis=1)
    assert np.abs(clean).max() < 1e-9
    # a weight of 2 is a point given twice
    _, xy, uv = views(10, noise=0.3)
    weights = np.ones(uv.shape[:2])
    weights[:, :5] = 2
    twice = homography.homographies(
        np.concatenate([xy, xy[:, :5]], 1), np.concatenate([uv, uv[:, :5]], 1), steps=20
    )
    np.testing.assert_allclose(
        homography.homographies(xy, uv, weights, steps=20), twice, rtol=1e-6, atol=1e-9
    )


def test_the_scale_of_the_weights_is_that_of_the_covariance_alone():
    _, xy, uv = views(3, noise=0.5)
    weights = np.random.default_rng(5).uniform(0.2, 3.0, uv.shape[:2])
    plain, large = homography.Equations.of(xy, uv, weights), homography.Equations.of(xy, uv, 400 * weights)
    (h, gap, cost), (same, same_gap, times) = plain.solve(2), large.solve(2)
    np.testing.assert_allclose(same, h, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(same_gap, gap, rtol=1e-9)
    np.testing.assert_allclose(times, 400 * cost, rtol=1e-9)
    np.testing.assert_allclose(large.covariances(h), plain.covariances(h) / 400, rtol=1e-6, atol=1e-18)


def test_covariances_against_differences():
    """The covariance of a transferred point equals the sum over all image coordinates of its derivatives."""
    _, xy, uv = views(4)
    found = homography.homographies(xy, uv, steps=3)
    where = np.broadcast_to([[0.3, -0.05]], (len(xy), 1, 2))
    step = 1e-4
    rows = []
    for point in range(xy.shape[1]):
        for axis in range(2):
            ends = []
            for sign in (step, -step):
                moved = uv.copy()
                moved[:, point, axis] += sign
                ends.append(homography.transfer(homography.homographies(xy, moved, steps=3), where)[:, 0])
            rows.append((ends[0] - ends[1]) / (2 * step))
    derivative = np.stack(rows, 1)  # (V, 2N, 2)
    expected = np.swapaxes(derivative, 1, 2) @ derivative
    x = np.r_[where[0, 0], 1]
    image = found @ x
    jacobian = np.zeros((len(xy), 2, 9))
    for row in range(2):
        jacobian[:, row, 3 * row : 3 * row + 3] = x / image[:, 2:]
        jacobian[:, row, 6:] = -(image[:, row] / image[:, 2] ** 2)[:, None] * x
    covariance = homography.Equations.of(xy, uv).covariances(found)
    # central differences of step 1e-4 in sums of 1e-13 px rounding: 1e-8 relative
    np.testing.assert_allclose(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2), expected, rtol=1e-6)
    np.testing.assert_allclose(
        homography.Equations.of(xy, uv, np.full(xy.shape[:2], 4.0)).covariances(found),
        covariance / 4,
        rtol=1e-10,
    )
    # scale is the gauge: h itself does not vary along h3
    third = covariance[:, 6:, 6:] @ found[:, 2, :, None]
    assert np.isfinite(third).all()


@pytest.mark.parametrize(
    "xy",
    [
        [[0, 0], [1, 1], [2, 2], [3, 3], [4, 4]],  # a line
        [[0, 0], [1, 0], [2, 0], [0, 1]],  # three of four on a line
        [[0, 0], [1, 0], [0, 1], [0, 1]],  # one twice
        [[1, 1], [1, 1], [1, 1], [1, 1]],
    ],
)
def test_degenerate_points_show_in_the_gap(xy):
    xy = np.array([xy], float)
    uv = 100 * xy + 50
    found, gap, _ = homography.solve(np.concatenate([xy, xy[:, ::-1]]), np.concatenate([uv, uv[:, ::-1]]))
    assert not (gap > 1e-7).any()
    assert found.shape == (2, 3, 3)


def test_a_sound_view_is_not_spoilt_by_a_degenerate_one():
    _, xy, uv = views(2)
    line = np.stack([np.arange(54.0), np.arange(54.0)], 1)
    both = np.concatenate([xy[:1], line[None]]), np.concatenate([uv[:1], line[None]])
    found, gap, _ = homography.solve(*both)
    assert gap[0] > 1e-3 and not gap[1] > 1e-7
    assert np.abs(homography.transfer(found[:1], xy[:1]) - uv[:1]).max() < 1e-10


def test_by_count():
    groups = [g.tolist() for g in homography.by_count([4, 7, 4, 9, 7, 4])]
    assert groups == [[0, 2, 5], [1, 4], [3]]
    assert list(homography.by_count([])) == []


@given(st.integers(0, 2**32 - 1))
def test_points_within_quadrilaterals_are_those_of_their_homographies(seed):
    rng = np.random.default_rng(seed)
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    quads = 50 * square + rng.uniform(-8, 8, (5, 4, 2)) + rng.uniform(-500, 500, (5, 1, 2))  # convex
    at = rng.uniform(0, 1, 4)
    x, y = homography.within_quads(quads, at)
    h = homography.homographies(np.broadcast_to(square, quads.shape), quads, steps=0)
    grid = np.stack(np.meshgrid(at, at), -1).reshape(1, -1, 2)
    expected = homography.transfer(h, np.broadcast_to(grid, (5, 16, 2))).reshape(5, 4, 4, 2)
    np.testing.assert_allclose(np.stack([x, y], -1), expected, atol=1e-7)
