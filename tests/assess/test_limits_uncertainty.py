"""Limits of what data determine, and of the search for causes, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.assess import candidate_views, covariance, curvature, influence
from camcal.assess.causes import effect, linear
from camcal.assess.causes.search import MOST_SWAPPED, Search
from camcal.assess.checks import cause
from camcal.solve.calibration import NormalBlocks
from tests.sides import LESS, MORE
from tests.solved import grid


def correlated(small):
    """Two parameters of which one direction has so large an eigenvalue, the other about 2."""
    return np.array([[1.0, 1 - small], [1 - small, 1.0]])


def test_directions_that_are_determined():
    for share, lost in ((0.9, 1), (1.1, 0)):
        null = covariance.invert_determined(correlated(share * covariance.NULL), np.ones(2))[1]
        assert null.shape == (2, lost)


def test_parameters_that_a_null_direction_touches():
    """A null direction with a small part of a third parameter."""
    for share, touched in ((LESS, False), (MORE, True)):
        part = share * covariance.TOUCHED
        n = np.array([np.sqrt((1 - part**2) / 2)] * 2 + [part])
        null = covariance.invert_determined(np.eye(3) - np.outer(n, n), np.ones(3))[1]
        assert (null[2, 0] != 0) == touched


def test_a_pose_that_its_points_do_not_determine():
    for share, lost in ((0.9, True), (1.1, False)):
        pose = np.eye(6)
        pose[:2, :2] = correlated(share * covariance.NULL)
        normal = NormalBlocks(np.eye(1), np.zeros((1, 1, 6)), pose[None])
        assert covariance.eliminate_poses(normal).undetermined[0].tolist() == [lost] * 2 + [False] * 4


def test_directions_in_which_a_view_has_an_effect(monkeypatch):
    """The spread's smaller eigenvalue against the larger one."""
    asked = []
    monkeypatch.setattr(influence, "f_exceeded", lambda statistic, count, freedom: asked.append(count) or 0.5)
    for share, count in ((0.9, 1), (1.1, 2)):
        ratio = share * influence.UNAFFECTED
        c = (1 - ratio) / (1 + ratio)
        influence._p_value(np.ones(2), np.array([[1, c], [c, 1]]), 9)
        assert asked[-1] == count


def test_directions_of_a_cause_that_gain_nothing():
    for share, none in ((0.9, True), (1.1, False)):
        values, _, _ = linear._scaled(correlated(share * linear._NULL))
        assert (values[0] == 0) == none and values[1] > 1


def test_pixels_that_show_an_effect(monkeypatch):
    trial = SimpleNamespace(kind="camera", how="split", theta=np.zeros((2, 1)))
    base = SimpleNamespace(camera=SimpleNamespace(unproject=lambda p: np.c_[p, np.ones(len(p))]))
    monkeypatch.setattr(effect, "_mean_square", lambda *_: 4.0)
    monkeypatch.setattr(effect, "_by_noise", lambda *_: 0.0)
    for count, found in ((effect._LEAST_PIXELS, 2.0), (effect._LEAST_PIXELS - 1, 0.0)):
        monkeypatch.setattr(effect, "covered_grid", lambda _, n=count: (np.zeros((n, 2)), np.ones(n, bool)))
        assert effect.effect_px(base, trial) == (found, found)


def test_groups_that_are_improved_view_by_view():
    """The first view belongs to the other group."""
    for count, moved in ((MOST_SWAPPED, True), (MOST_SWAPPED + 1, False)):
        right = np.arange(count) < count // 2
        search = SimpleNamespace(
            count=count, _of_groups=lambda _, parts, r=right: (parts != r).sum(1).astype(float)
        )
        begin = right.copy()
        begin[0] = ~begin[0]
        assert (Search._swapped(search, "focal", begin) == right).all() == moved


def test_numbers_that_views_share_in_heavy_noise():
    """The fall at which the criterion for 8 V numbers reaches the evidence."""
    for views, numbers in ((17, 4), (5, 1)):
        n = cause.OF_A_VIEW * views
        for share, sure in ((LESS, True), (MORE, False)):
            fall = share * cause.least_fall(views, numbers)
            assert (2 * n * np.log(fall) + numbers * np.log(n) < -cause.EVIDENCE) == sure


# ------------------------------------------------------------------------------------ targets of the next view
def test_places_of_a_grid():
    """Points on the diagonal fill one place in as many as there are of them."""
    most = candidate_views._MOST_PLACES
    for count, is_grid in ((most, True), (most + 1, False)):
        diagonal = grid(count, count)[:: count + 1]
        assert bool(len(candidate_views.surround(diagonal))) == is_grid
    least = candidate_views._LEAST_GRID
    assert len(candidate_views.surround(grid(2, 2)[:least]))
    assert not len(candidate_views.surround(grid(2, 2)[: least - 1]))


def test_points_that_no_view_shows_together(monkeypatch):
    full = np.zeros((10, 3))

    class View:
        xyz = full

        def __len__(self):
            return 10

    views = [View()]
    most = 10 * candidate_views._MOST_PARTS
    for count, together in ((most - 1, True), (most, False)):
        monkeypatch.setattr(candidate_views, "common_points", lambda _, n=count: (np.ones((n, 3)),))
        found = candidate_views.target_points(SimpleNamespace(observations=SimpleNamespace(views=views)))
        assert len(found) == (count if together else 10)


# ------------------------------------------------------------------------------------ curved intervals
def test_intervals_that_are_wider_than_stated():
    """Variances that are widened, of one free parameter, by how far the profile reaches."""
    low, high = curvature.GROWN
    assert low < 1 < high
    for share, wide in ((LESS, False), (MORE, True)):
        reach = curvature.REACH * np.sqrt(share * high)
        linear_ = SimpleNamespace(sigma_0=1.0, matrix=np.eye(1), names=("fx",))
        solution = SimpleNamespace(free=np.ones((1, 1)))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(curvature, "_curved", lambda *_, r=reach: [(np.ones(1), np.array([r]), [])])
            patch.setattr(curvature, "replace", lambda _, **made: made)
            made = curvature.beyond_linear(solution, linear_)
        assert (made["matrix"][0, 0] > 1) == wide
