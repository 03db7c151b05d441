"""Neighbours and hulls without scipy.spatial, against it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay, cKDTree

from camcal.geometry import hull, neighbours
from camcal.geometry.neighbours import Neighbours

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(params=[True, False], ids=["few", "many"])
def limit(request, monkeypatch):
    """Both ways through the same code: all distances, and scipy's tree."""
    monkeypatch.setattr(neighbours, "FEW", 10**9 if request.param else 0)


@pytest.mark.parametrize("k", [1, 2, 7])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_nearest(limit, k, dimensions):
    rng = np.random.default_rng(k)
    points, at = rng.normal(size=(40, dimensions)), rng.normal(size=(5, 6, dimensions))
    expected = cKDTree(points).query(at, k=k)
    distance, number = Neighbours(points).query(at, k=k)
    np.testing.assert_array_equal(number, expected[1])
    np.testing.assert_allclose(distance, expected[0], rtol=1e-14)


def test_fewer_points_than_wanted(limit):
    distance, number = Neighbours(np.zeros((2, 2))).query(np.ones((3, 2)), k=4)
    assert (
        np.isinf(distance[:, 2:]).all() and (number[:, 2:] == 2).all() and np.isfinite(distance[:, :2]).all()
    )


def test_pairs_and_reach(limit):
    points = np.random.default_rng(0).uniform(0, 10, (60, 2))
    expected = {tuple(p) for p in cKDTree(points).query_pairs(1.5, output_type="ndarray")}
    assert {tuple(p) for p in Neighbours(points).pairs(1.5)} == expected
    reach = np.linspace(0.1, 3, 60)
    for near, wanted in zip(
        Neighbours(points).within(reach), cKDTree(points).query_ball_point(points, reach), strict=True
    ):
        assert sorted(near) == sorted(wanted)


@settings(deadline=None)  # scipy is imported in the first example
@given(SEEDS, st.integers(3, 400))
def test_hull(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2)) * rng.uniform(0.1, 1000, 2) + 300
    theirs = ConvexHull(points)
    ours = hull.hull(points)
    assert {tuple(p) for p in ours} == {tuple(p) for p in points[theirs.vertices]}
    assert hull.area(points) == pytest.approx(theirs.volume, rel=1e-9)
    places = rng.normal(size=(50, 2)) * points.std(0) + points.mean(0)
    np.testing.assert_array_equal(hull.within(points, places), Delaunay(points).find_simplex(places) >= 0)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.ones((5, 2)), np.c_[np.arange(9.0), np.arange(9.0)]])
def test_points_on_a_line_have_no_hull(points):
    assert len(hull.hull(points)) == 0
    assert hull.area(points) == 0
    assert not hull.within(points, np.array([[1.0, 1.0], [0.5, 0.7]])).any()


def test_a_grid_has_four_corners():
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    points = np.c_[x.ravel(), y.ravel()].astype(float)
    assert len(hull.hull(points)) == 4 and hull.area(points) == 40
    assert hull.within(points, points).all()
