"""Circles whose centres are the centroids of their images: found with their radius, and not in corners."""

import numpy as np
import pytest

from camcal.assess.causes.circles import circles
from camcal.assess.checks import check
from camcal.assess.checks.circles import LARGEST, SIGNIFICANT, SMALLEST
from camcal.data.observations import Correspondences, View
from camcal.plan.calibrate import calibrate
from tests.solved import SIZE, camera_of, grid, tilted_poses


def discs(radius, seed=0, noise=0.003, views=25):
    """The centroids of the images of discs of a radius in squares, by polygons of 180 sides."""
    rng = np.random.default_rng(seed)
    truth, board, seen = camera_of("opencv4"), grid(), []
    around = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    rim = radius * np.c_[np.cos(around), np.sin(around), 0 * around]
    for i, pose in enumerate(tilted_poses(board, views, rng)):
        outline = truth.project(pose.apply((board[:, None] + rim).reshape(-1, 3))).reshape(len(board), -1, 2)
        x, y = outline[..., 0], outline[..., 1]
        cross = x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y
        uv = truth.project(pose.apply(board))
        if radius:
            uv = ((outline + np.roll(outline, -1, 1)) * cross[..., None]).sum(1) / 3 / cross.sum(1)[:, None]
        seen.append(View(f"v{i}", board, uv + noise * rng.normal(size=uv.shape), None, np.arange(len(board))))
    data = Correspondences.from_views(tuple(seen), SIZE)
    return calibrate(data, "opencv4", checks=False, crosscheck=False)


@pytest.mark.parametrize("seed", range(3))
def test_the_radius_is_found(seed):
    s = discs(0.4, seed)
    found = circles(s)
    # known to 2 % by the noise; the expansion of (1) leaves terms of the fourth order
    assert found.deviations > SIGNIFICANT and found.radius == pytest.approx(0.4, rel=0.08)
    (said,) = [w for w in check(s) if w.code == "circle-centres"]
    assert "0.4" in said.message and "circles" in said.hint
    # the camera with circles of that size is the nearer one
    truth = camera_of("opencv4").params
    assert abs(found.params[0] - truth[0]) < abs(s.camera.params[0] - truth[0])


@pytest.mark.parametrize("seed", range(6))
def test_corners_are_no_circles(seed):
    s = discs(0.0, seed)
    assert abs(circles(s).deviations) < SIGNIFICANT
    assert "circle-centres" not in {w.code for w in check(s)}


def test_the_gain_is_that_of_the_step():
    """By (2): half the square of the deviations, in units of the noise."""
    s = discs(0.3)
    found = circles(s)
    noise = 2 * s.fit.cost / (2 * int(s.used.sum()) - s.free_count)
    assert found.gain == pytest.approx(0.5 * found.deviations**2 * noise, rel=1e-9)


@pytest.mark.parametrize(
    ("radius", "deviations", "said"),
    [
        (0.3, SIGNIFICANT + 0.1, True),
        (0.3, SIGNIFICANT - 0.1, False),
        (SMALLEST + 0.01, 9, True),
        (SMALLEST - 0.01, 9, False),
        (LARGEST - 0.01, 9, True),
        (LARGEST + 0.01, 9, False),
    ],
)
def test_what_counts_as_circles(monkeypatch, radius, deviations, said):
    from camcal.assess.causes.circles import Circles
    from camcal.assess.checks import circles as module
    from camcal.assess.checks.facts import Facts

    s = discs(0.0)
    monkeypatch.setattr(module, "circles", lambda *_: Circles(radius, deviations, 1.0, s.camera.params))
    assert bool(list(module.circle_centres(Facts(s)))) == said


def test_a_known_target_has_been_corrected():
    from dataclasses import replace

    s = discs(0.4)
    known = replace(s, observations=replace(s.observations, target={"kind": "circles"}))
    assert circles(known) is None


@pytest.mark.parametrize(("stated", "severity"), [(0.0, "doubtful"), (1.0, "note")])
def test_a_small_effect_is_doubtful_where_it_exceeds_what_the_camera_says(monkeypatch, stated, severity):
    from camcal.assess.checks import circles as module
    from camcal.assess.checks import fit
    from camcal.assess.checks.facts import Facts
    from camcal.assess.difference import Difference

    monkeypatch.setattr(Difference, "rms_px", property(lambda _: 0.1))
    monkeypatch.setattr(fit, "stated_px", lambda *_: stated)
    assert [w.severity for w in module.circle_centres(Facts(discs(0.4)))] == [severity]


@pytest.mark.parametrize(("share", "said"), [(0.9, True), (1.1, False)])
def test_a_bent_board_explains_more_than_circles(monkeypatch, share, said):
    from camcal.assess.checks import circles as module
    from camcal.assess.checks.facts import Facts
    from camcal.assess.free_board import Promise

    s = discs(0.4)
    gained = circles(s).gain / s.fit.cost
    of_board = share * gained / module.LEAST_OF_BOARD
    bent = Promise(1.0, float(np.sqrt(1 - of_board)), 0.0, 1.0)
    monkeypatch.setattr(Facts, "free_board", bent)
    assert bool(list(module.circle_centres(Facts(s)))) == said
