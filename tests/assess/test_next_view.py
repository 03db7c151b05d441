"""The next best view: its prediction is what a calibration with that view finds, and its poses can be held."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess import figures
from camcal.assess.candidate_views import SAME_VIEW, SPREAD, Candidates, rotations_onto, surround
from camcal.assess.difference import image_grid
from camcal.assess.next_view import COLUMNS, NextView
from camcal.assess.uncertainty import projection_uncertainty, worst_sigma
from camcal.errors import DataError
from camcal.model.pose import Poses
from camcal.solve.refine import How, refine
from tests.solved import SIZE, grid, observe, rig, solved

#: so little noise that the linearisation holds to three digits
NOISE = 0.02


def measured(solution, distance):
    """Worst-direction sigmas over the search's grid, by the report's own computation, for sigma_0 = 1."""
    pixels = image_grid(np.zeros(2), np.subtract(SIZE, 1.0), columns=COLUMNS)
    covariance = projection_uncertainty(solution).at_pixels(pixels, distance)
    return worst_sigma(covariance) / figures.sigma_0(solution)


@pytest.mark.parametrize("distance", [np.inf, 12.0])
@pytest.mark.parametrize("options", [{}, {"skew": True}, {"fix": {"p1": 0.0}}, {"sigma": 0.02 * np.ones(54)}])
def test_the_prediction_is_what_a_calibration_with_the_view_finds(distance, options):
    solution = solved(noise=NOISE, views=6, **options)
    # enough of them that the best determines the camera well: the prediction is linear in the errors
    search = NextView(solution, distance, candidates=120)
    now = search.sigmas(search.now) / search.design.sigma_0
    assert now == pytest.approx(measured(solution, distance), rel=1e-6)
    suggestion = search.best()[0]
    seen = observe(
        solution.camera,
        Poses.stack([suggestion.pose]),
        grid(),
        NOISE,
        np.random.default_rng(3),
        options.get("sigma"),
    ).views[0]
    data = solution.observations
    more = data.with_views((*data.views, replace(seen, id="new")))
    poses = Poses.stack([*solution.poses, suggestion.pose])
    fitted = refine(solution.camera, poses, more, How(options.get("fix") or {}))
    after = measured(fitted, distance)
    assert suggestion.worst / search.design.sigma_0 == pytest.approx(after.max(), rel=0.01)
    assert suggestion.median / search.design.sigma_0 == pytest.approx(np.median(after), rel=0.01)


def test_each_suggestion_is_better_than_what_was_there_and_repeats_none():
    search = NextView(solved(views=5), candidates=80)
    found = search.best(4)
    worst = [search.before[0], *(s.worst for s in found)]
    assert worst == sorted(worst, reverse=True)
    images = search.candidates.images(Poses.stack([s.pose for s in found]), grid())
    apart = [np.linalg.norm(a - b, axis=1).mean() for i, a in enumerate(images) for b in images[:i]]
    assert min(apart) >= SAME_VIEW * np.hypot(*SIZE)


def test_the_best_is_no_worse_than_any_candidate():
    search = NextView(solved(views=5), candidates=80)
    every = search.sigmas(search.now + search.added).max(1)
    assert search.best()[0].worst <= every.min() * (1 + 1e-9)


def test_the_whole_target_with_its_outer_cells_is_in_the_picture():
    solution = solved()
    candidates = Candidates(solution, planar=True)
    poses = candidates.spread(200, np.random.default_rng(0))
    assert len(poses) > 120
    outer = np.array([[-1.0, -1, 0], [9, -1, 0], [-1, 6, 0], [9, 6, 0]])
    uv = candidates.images(poses, outer)
    assert (uv > -0.5).all() and (uv < np.subtract(SIZE, 0.5)).all()
    assert len(np.unique((uv.mean(1) > np.divide(SIZE, 2)) @ [1, 2])) == 4  # in all quarters of the picture
    moved = candidates.around(poses, np.random.default_rng(1), 1.0)
    assert len(moved) and candidates.allowed(moved).all()


def test_a_rig_is_turned_as_it_was_and_tilted():
    solution = solved(xyz=rig())
    candidates = Candidates(solution, planar=False)
    poses = candidates.spread(100, np.random.default_rng(0))
    centres = poses.rotations @ rig().mean(0) + poses.translations
    axis = poses.rotations @ solution.poses.rotations[0][2]
    cosine = np.einsum("ki,ki->k", axis, centres) / np.linalg.norm(centres, axis=1)
    assert cosine.min() >= np.cos(np.radians(SPREAD.tilt[1])) - 1e-9


def test_a_lens_that_sees_the_target_nowhere(monkeypatch):
    candidates = Candidates(solved(), planar=True)
    monkeypatch.setattr(candidates, "images", lambda poses, xyz: np.full((len(poses), len(xyz), 2), np.nan))
    with pytest.raises(DataError, match="no pose"):
        candidates.spread(20, np.random.default_rng(0))


def test_pictures_until_counts_from_what_is_there():
    search = NextView(solved(views=5), candidates=60)
    found = [s.worst for s in search.best(3)]
    assert search.pictures_until(search.before[0] * 1.01) == 0
    assert search.pictures_until(found[0] * (1 + 1e-9)) == 1
    assert search.pictures_until(found[2] * (1 + 1e-9)) == 3
    assert search.pictures_until(found[0] * 1e-6, most=4) is None


def test_the_surround_is_one_cell_wider():
    around = surround(grid(square=2.0))
    assert around[:, :2].min(0).tolist() == [-2, -2] and around[:, :2].max(0).tolist() == [18, 12]
    bent = grid() + np.random.default_rng(0).normal(0, 0.01, (54, 3))
    assert surround(bent)[:, :2].min(0) == pytest.approx([-1, -1], abs=0.03)
    for other in (rig(), np.random.default_rng(0).random((60, 3)) * [9, 6, 0]):
        assert not len(surround(other))


def test_rotations_onto_take_the_axis_to_the_ray():
    rays = np.random.default_rng(0).normal(size=(20, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays = np.r_[rays, [[0, 0, 1.0]]]
    assert rotations_onto(rays)[:, :, 2] == pytest.approx(rays, abs=1e-12)
