"""Numbers of simulated points and pictures, each just below and just above, or beside finer ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.study import compare_optimizers, points, render
from tests.sides import same_with_finer_and_not_with_coarser
from tests.solve.problems import problem_of

BENT = Camera(
    lenses.make("opencv5"), np.array([500.0, 500, 319.5, 239.5, -0.3, 0.1, 0, 0, -0.02]), (640, 480)
)


def test_displacements_of_outliers():
    """From the shortest to the longest, and of the part of the points that is asked for."""
    length = np.linalg.norm(points.outlier_moves(2000, 0.5, np.random.default_rng(0)), axis=1)
    moved = np.sort(length[length > 0])
    assert len(moved) == 1000
    shortest, longest = points.OUTLIER_PX
    assert shortest <= moved[0] < shortest + 1 and longest - 1 < moved[-1] <= longest
    # beyond five times the noise of bad corners, 1 px, and no farther than a board's neighbouring squares
    assert shortest >= 5.0


def rays():
    """In pixels."""
    return 500 * render.pixel_rays(BENT, 64, 48, 2)


def test_rays_that_are_computed(monkeypatch):
    """A spline through those of every fourth pixel is off by less than 1e-4 px, and one of every thirtieth by more."""
    same_with_finer_and_not_with_coarser(monkeypatch, render, "NODE_STEP", 30, 1, 1e-4, rays)


def test_nodes_across_a_small_picture(monkeypatch):
    """A cubic spline needs as many."""
    assert np.isfinite(render.pixel_rays(BENT, 1, 1, 1)).all()
    monkeypatch.setattr(render, "LEAST_NODES", render.LEAST_NODES - 1)
    with pytest.raises(Exception, match="failed for"):
        render.pixel_rays(BENT, 1, 1, 1)


def met():
    """Where rays meet a sheet whose slope is a tenth, in pixels of 600 to a unit."""
    pose = Pose(np.eye(3), np.array([0.0, 0.0, -6.0]))
    scene = render._Scene(None, None, pose, lambda xy: 0.1 * np.sin(xy[..., 0]), render.Look())
    directions = np.c_[np.linspace(-0.5, 0.5, 41), np.linspace(-0.3, 0.3, 41), np.ones(41)]
    return 100 * scene.meet(directions)[0]


def test_steps_to_a_bowed_sheet(monkeypatch):
    same_with_finer_and_not_with_coarser(monkeypatch, render, "SHEET_STEPS", 3, 40, 1e-6, met)


@pytest.mark.parametrize(("left", "found"), [(1.5, 1), (0.75, 0)])
def test_halvings_of_a_start(monkeypatch, left, found):
    """A start that projects within so much of the smallest distance is taken, and none that is nearer."""
    problem, state = problem_of("pinhole")
    smallest = 0.5 ** (compare_optimizers.HALVINGS - 1)
    rng = np.random.default_rng(0)
    groups = np.array([p.group for p in problem.lens.parameters])
    first = rng.normal(size=len(groups))[0] * state.params[0]

    def linearise(start):
        near = abs(start.params[0] - state.params[0]) <= left * smallest * abs(first)
        return SimpleNamespace() if near else None

    wrapped = SimpleNamespace(lens=problem.lens, free=problem.free, views=problem.views, linearise=linearise)
    assert len(compare_optimizers.perturbed(wrapped, state, 1, 1.0, 0)) == found
