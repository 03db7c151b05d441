"""Limits of options and of work, each from both sides."""

import importlib

import numpy as np
import pytest

from camcal import calibrate_rig
from camcal.assess import rig_checks
from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.lenses import brown, division, kannala_brandt, polynomial, radial_profile, spline
from camcal.settings import sizes
from camcal.solve import outliers
from camcal.solve.optimizers import make
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import How, refine
from tests.rigs import LENS, observed, truth
from tests.solve.problems import problem_of
from tests.solved import solved


@pytest.mark.parametrize(
    ("spec", "most"),
    [
        ("brown:radial={}", brown.MOST_RADIAL),
        ("brown:decentering={}", brown.MOST_DECENTERING),
        ("division:{}", division.MOST_TERMS),
        ("scaramuzza:{}", division.MOST_DEGREE),
        ("kb:{}", kannala_brandt.MOST),
        ("polynomial:{}", polynomial.MOST),
        ("radial-profile:{}", radial_profile.MOST),
        ("spline:{}x8", spline.MOST),
    ],
)
def test_the_largest_models(spec, most):
    assert lenses.make(spec.format(most)).size > 4
    with pytest.raises(UsageError, match=f"{most + 1}"):
        lenses.make(spec.format(most + 1))


def test_the_smallest_spline():
    assert lenses.make(f"spline:{spline.LEAST}x8").size > 4
    with pytest.raises(UsageError, match=f"{spline.LEAST} to {spline.MOST}"):
        lenses.make(f"spline:{spline.LEAST - 1}x8")


@pytest.mark.parametrize(
    ("size", "good"),
    [
        ((sizes.LEAST_CELLS, sizes.MOST_CELLS), True),
        ((sizes.LEAST_CELLS - 1, 5), False),
        ((5, sizes.MOST_CELLS + 1), False),
    ],
)
def test_sizes_of_boards(size, good):
    text = "{}x{}".format(*size)
    if good:
        assert sizes.parse_grid(text) == size
        return
    with pytest.raises(UsageError, match="cannot be used"):
        sizes.parse_grid(text)


@pytest.mark.parametrize(
    ("module", "limit", "spec"),
    [
        ("least_squares.loop", "MOST_ITERATIONS", "lm"),
        ("solve.optimizers.dogleg", "_MOST_ITERATIONS", "dogleg"),
        ("solve.optimizers.gauss_newton", "_MOST_ITERATIONS", "gauss-newton"),
        ("solve.optimizers.descent", "MOST_ITERATIONS", "lbfgs"),
        ("solve.optimizers.leapfrog", "MOST_STEPS", "leapfrog"),
        ("solve.optimizers.scipy_", "_MOST_EVALUATIONS", "scipy"),
    ],
)
def test_a_run_that_reaches_its_limit_has_not_converged(monkeypatch, module, limit, spec):
    owner = importlib.import_module(f"camcal.{module}")
    problem, state = problem_of("pinhole")
    assert getattr(owner, limit) > 2  # with which every method converges: tests/contracts/test_optimizers.py
    monkeypatch.setattr(owner, limit, 2)
    ended = make(spec)(problem, state, Options())
    assert (
        not ended.converged and ended.stop_reason in ("iterations", "evaluations") and ended.iterations <= 2
    )


def with_bad_views(views, bad, part=1.0):
    """A calibration before which the last `bad` views have random errors in so much of their points."""
    good = solved(
        "pinhole", views=views, noise=0.2, truth={"fx": 533.0, "fy": 533.0, "cx": 322.0, "cy": 238.0}
    )
    data, rng = good.observations, np.random.default_rng(0)
    residuals = rng.normal(0, 0.2, good.residuals.shape)
    for i in range(views - bad, views):
        rows = np.arange(data.slices[i].start, data.slices[i].stop)
        rows = rows[: round(part * len(rows))]
        residuals[rows] = rng.choice([-1.0, 1.0], (len(rows), 2)) * rng.uniform(30, 60, (len(rows), 2))
    return refine(good.camera, good.poses, data, How()), residuals


@pytest.mark.parametrize(
    ("left", "rejected"), [(outliers.LEAST_LEFT, True), (outliers.LEAST_LEFT - 1, False)]
)
def test_views_are_rejected_where_enough_are_left(monkeypatch, left, rejected):
    fit, residuals = with_bad_views(left + 2, 2)
    monkeypatch.setattr(outliers, "standardised", lambda _: np.linalg.norm(residuals, axis=1))
    assert outliers.test(fit).bad_views == ((left, left + 1) if rejected else ())


@pytest.mark.parametrize(("part", "rejected"), [(0.6, False), (0.72, True)])
def test_a_view_that_keeps_too_little_is_rejected(monkeypatch, part, rejected):
    assert 1 - 0.72 < outliers.LEAST_KEPT < 1 - 0.6
    fit, residuals = with_bad_views(8, 1, part)
    monkeypatch.setattr(outliers, "standardised", lambda _: np.linalg.norm(residuals, axis=1))
    verdict = outliers.test(fit)
    assert (7 in verdict.bad_views) == rejected


@pytest.mark.parametrize(
    ("count", "said"), [(rig_checks.FEW_INSTANTS, False), (rig_checks.FEW_INSTANTS - 1, True)]
)
def test_instants_that_a_camera_shares(count, said):
    data, _ = observed(truth("ab"), instants=count)
    found = rig_checks.check(calibrate_rig(data, model=LENS, checks=False), {})
    assert ("few-shared-instants" in {w.code for w in found}) == said
