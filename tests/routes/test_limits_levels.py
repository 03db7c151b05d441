"""Levels and limits of poses, of offsets in time and of variances, each just below and just above."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.plan import single_view
from camcal.routes import outliers, pose
from camcal.routes.hand_eye import offset, variance
from tests.sides import LESS, MORE


@pytest.mark.parametrize("count", [4, 20])
@pytest.mark.parametrize("share", [LESS, MORE])
def test_a_further_pose_with_the_same_noise(count, share):
    """By the ratio of the sums of squares, which one in a thousand exceeds."""
    freedom = 2 * count - 6
    limit = stats.f.isf(1e-3, freedom, freedom)
    further, best = SimpleNamespace(cost=share * limit), SimpleNamespace(cost=1.0)
    assert pose._could_be(further, best, count) == (share < 1)


@pytest.mark.parametrize(("count", "searched"), [(outliers.LEAST, True), (outliers.LEAST - 1, False)])
def test_points_among_which_outliers_are_searched(monkeypatch, count, searched):
    class SearchedError(Exception):
        pass

    def poses(*_):
        raise SearchedError

    monkeypatch.setattr(outliers.p3p, "poses", poses)
    view = type("View", (), {"xyz": np.zeros((count, 3)), "__len__": lambda self: count})()
    if searched:
        with pytest.raises(SearchedError):
            outliers.consensus(None, view, np.zeros((count, 3)))
    else:
        assert outliers.consensus(None, view, np.zeros((count, 3))).all()


@pytest.mark.parametrize(("interval", "tried"), [(1e-6, 4001), (LESS / 2000, 4001), (1 / 1000, 2001)])
def test_offsets_that_are_tried(monkeypatch, interval, tried):
    """The interval of the stream apart, but at most two thousand on either side."""
    asked = []
    stream = SimpleNamespace(
        times=np.arange(9) * interval,
        covers=lambda times: asked.append(1) or np.ones(len(times), bool),
        at=lambda times: [None],
    )
    monkeypatch.setattr(offset, "misfits", lambda _: [1.0])
    monkeypatch.setattr(offset, "views_of", lambda *_: None)
    offset.search("in-hand", stream, np.zeros(1), None, 1.0)
    assert len(asked) == tried


@pytest.mark.parametrize("share", [LESS, MORE, 100.0])
def test_the_largest_change_of_a_variance(monkeypatch, share):
    """A factor of twenty in one step."""
    steps = []
    here = SimpleNamespace(score=np.array([1.0, -1.0, 0.0]) * share * np.log(20), information=np.eye(3))
    model = SimpleNamespace(
        floors=lambda _: np.full(3, -99.0),
        at=lambda _: here,
        uphill=lambda logs, at, step, floors: (steps.append(step) or logs, at, 0.0),
    )
    monkeypatch.setattr(variance._Model, "of", lambda *_: model)
    monkeypatch.setattr(variance, "_components", lambda *_: None)
    variance.estimate(None, np.ones(3), 1.0)
    assert np.exp(steps[0]) == pytest.approx([20 ** min(share, 1), 20 ** -min(share, 1), 1])


@pytest.mark.parametrize(("share", "known"), [(LESS, False), (MORE, True)])
def test_a_single_view_that_determines_its_camera(monkeypatch, share, known):
    """By the smallest eigenvalue of the scaled normal equations."""
    found = np.linalg.eigh

    def eigh(matrix):
        values, vectors = found(matrix)
        return np.r_[share * single_view.ROUNDING * values[-1], values[1:]], vectors

    camera = Camera(lenses.make("pinhole"), np.array([800.0, 800, 500, 400]), (1000, 800))
    xyz = np.c_[np.random.default_rng(0).uniform(-1, 1, (20, 2)), np.zeros(20)]
    poses = Poses(np.eye(3)[None], np.array([[0, 0, 5.0]]))
    data = SimpleNamespace(xyz=xyz, uv=camera.project(poses[0].apply(xyz)))
    monkeypatch.setattr(np.linalg, "eigh", eigh)
    sigmas = single_view._sigmas(camera, poses, data, np.eye(4))
    assert np.isfinite(sigmas).all() == known
