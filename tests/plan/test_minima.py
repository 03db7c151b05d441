"""Lower minima: weak cameras begin again elsewhere, and well-determined ones pay nothing."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks.facts import Facts
from camcal.assess.checks.parameters import WEAK
from camcal.assess.covariance import covariance
from camcal.data.points import read_points
from camcal.geometry import projective
from camcal.plan import minima
from camcal.plan.calibrate import calibrate
from camcal.start import CLOSED_FORMS
from tests.shared_data import DATA, needs_data
from tests.solved import solved


@needs_data
def test_nearly_parallel_views_end_no_higher_than_cv2():
    # cv2.calibrateCamera: .642206; from Zhang's closed form the search ends at .654309, fx 4038 instead of 2816
    data = replace(read_points(DATA / "cases" / "gloworm1920.csv", image_size=(1920, 1080)), sigma=None)
    found = calibrate(data, model="opencv5", checks=False)
    assert found.rms_point <= 0.642206 + 1e-5
    assert any(s.name == "refine" and s.info["attempt"] == "other-starts" for s in found.stages)


@needs_data
@pytest.mark.parametrize(
    ("model", "robust", "rms"), [("opencv4", "auto", 1.625952), ("opencv5", "none", 1.238391)]
)
def test_a_cube_that_was_clicked_by_hand(model, robust, rms):
    # scipy.optimize.least_squares from 16 starts
    found = calibrate(
        read_points(DATA / "cases" / "so_cube_1600x1200.csv"), model=model, robust=robust, checks=False
    )
    assert found.used.all() and found.rms_point <= rms * (1 + 1e-5)
    # the closed forms were also made on points that agree, and are shown over those of the result
    forms = Counter(s.name for s in found.stages if s.name in CLOSED_FORMS)
    assert set(forms.values()) == {1}
    for stage in found.stages:
        if stage.projection_matrix is not None and stage.name != "refine":
            off = projective.project(stage.projection_matrix, found.observations.xyz) - found.observations.uv
            assert stage.rms_point == pytest.approx(np.sqrt(np.square(off).sum(1).mean()), rel=1e-9)


def test_weak_is_what_the_warning_calls_weak():
    strong = solved(views=8)
    assert not minima.weak(strong)
    # the same camera from noise that brings its sigma to a little below the limit, and above it
    sigma = minima.Facts(strong).covariance.sigmas["fx"] / strong.camera.params[0]
    for factor, weak in ((0.8, False), (1.25, True)):
        more = WEAK / sigma * factor
        noisy = replace(strong, residuals=strong.residuals * more, normal=replace(strong.normal))
        assert minima.weak(noisy) is weak


def test_a_search_without_a_lower_minimum_gives_back_the_fit():
    fit = solved(views=6)
    assert minima.spread(fit, minima.How()) is fit


@pytest.mark.parametrize(("most", "asked"), [(9, True), (8, False)])
def test_curved_directions_are_followed_for_small_models_alone(monkeypatch, most, asked):
    """`opencv5` has nine free parameters; the linear sigmas of good views are not weak."""
    fit = solved("opencv5", views=8)
    followed = []
    monkeypatch.setattr(minima, "MOST_PARAMETERS", most)
    monkeypatch.setattr(
        Facts, "covariance", property(lambda facts: followed.append(1) or covariance(facts.solution))
    )
    assert not minima.weak(fit) and bool(followed) is asked
