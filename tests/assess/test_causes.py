"""Causes that all views share: named with their number, silent on clean data, nobody blamed."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from camcal.assess.causes import MOST_OF_IT, find
from camcal.assess.causes.kinds import KINDS, contrasts, shared
from camcal.assess.causes.linear import Linear, all_fields, problem_of
from camcal.assess.causes.search import two_groups
from camcal.assess.causes.words import (
    MANY_PX,
    OTHER_CAMERAS,
    SEVERAL_PX,
    VISIBLE_PX,
    WORSE,
    severity,
    warning_of,
)
from camcal.assess.checks.cause import cause, least_fall
from camcal.assess.checks.facts import Facts
from camcal.data.observations import Correspondences, View
from camcal.errors import DataError
from camcal.model.board import Board
from camcal.plan.calibrate import calibrate
from camcal.solve import optimizers
from camcal.solve.warp import FIELDS, Warp
from camcal.start import numbering
from camcal.start.numbering import check_numbering

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def cases():
    sys.path.insert(0, str(BENCHMARKS))
    import faulty_cases

    yield faulty_cases
    sys.path.remove(str(BENCHMARKS))
    sys.modules.pop("faulty_cases", None)


def fitted(data: Correspondences):
    return calibrate(data, "opencv5", checks=False, crosscheck=False)


NAMES = (
    "zoom by 2 % at some view",
    "two cameras in any order, f 5 % apart",
    "any half of the pictures at 3/4",
    "a part cropped by 60, 40 px",
    "any half turned by 180 degrees",
    "rolling shutter, 4 px",
    "stabiliser, 12 px",
    "print 2 % longer in y",
    "9x6 numbered as 6x9",
    "picture size twice as large",
)


@pytest.mark.parametrize("name", NAMES)
def test_the_cause_is_named_and_nobody_is_blamed(cases, name):
    case = next(c for c in cases.COMMON if c.name == name)
    found = case.run(np.random.default_rng(11))
    assert case.named(found), (found, found.grade)


def test_the_place_of_a_large_split_is_found_by_fits(cases):
    """One step puts the view from which pictures are halved one too late; a displacement by row then fits better."""
    case = next(c for c in cases.COMMON if c.name == "half of the pictures halved")
    assert case.named(case.run(np.random.default_rng(3012)))


def test_the_numbers_found(cases):
    """A zoom of 2 % from a known view on: the view, and the ratio within .2 % (5 sigmas of a simulation)."""
    rng = np.random.default_rng(2)
    first, second = cases.camera(), cases.camera(fx=1020.0, fy=1020.0)
    a, b = cases.seen(first, rng, 15), cases.seen(second, rng, 15)
    data = a.with_views(
        tuple(
            replace(w, id=v.id) if i >= 9 else v
            for i, (v, w) in enumerate(zip(a.views, b.views, strict=True))
        )
    )
    found = find(fitted(data))
    assert found.cause is not None and found.cause.how == "split"
    assert np.flatnonzero(found.cause.parts)[0] == 9
    scale = found.cause.theta[-1, list(FIELDS).index("scale")]
    assert scale == pytest.approx(0.02, abs=0.002)
    # what is left is the noise of .1 px (5 % for 1500 degrees of freedom is over 2 sigmas)
    assert found.sigma == pytest.approx(0.1, rel=0.05)
    said = warning_of(found)
    assert said is not None and said.code == "zoom-or-refocus" and "'v9'" in said.message
    assert "With one number more, sigma falls" in said.message


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("board", [(3, 3), (9, 6)])
def test_clean_views_have_no_cause(cases, seed, board):
    data = cases.seen(cases.camera(), np.random.default_rng(seed), 15, cases.grid(*board))
    assert find(fitted(data)).trial is None


def test_a_view_that_does_not_belong_is_no_cause(cases):
    rng = np.random.default_rng(5)
    data = cases.seen(cases.camera(), rng, 11)
    other = cases.seen(cases.camera(), rng, 1, cases.grid() * [1.0, 1.15, 1.0]).views[0]
    data = data.with_views((*data.views, replace(other, id="other", xyz=cases.grid())))
    found = find(fitted(data))
    assert found.trial is not None and found.views and found.cause is None and warning_of(found) is None


def test_one_step_promises_what_a_fit_gains(cases):
    """A zoom of .1 %, where the problem is linear: the promised gain is that of the fit to 2 %."""
    rng = np.random.default_rng(1)
    first, second = cases.camera(), cases.camera(fx=1001.0, fy=1001.0)
    a, b = cases.seen(first, rng, 12, noise=0.01), cases.seen(second, rng, 12, noise=0.01)
    base = fitted(a.with_views((*a.views[:6], *(replace(v, id=f"{v.id}b") for v in b.views[6:]))))
    warp = all_fields(base)
    linear = Linear.of(base, warp)
    parts = (np.arange(12) >= 6).astype(float)[:, None]
    for kind in ("focal", "camera"):
        design = shared(parts, KINDS[kind](warp))
        problem = problem_of(base, Warp(warp.fields, design, warp.centre, warp.unit))
        start = problem.state(base.camera.params, base.poses)
        end = optimizers.make("lm")(problem, start, None, None)
        assert linear.gain(design) == pytest.approx(linear.cost - end.blocks.cost, rel=0.02)


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(FIELDS)))
@settings(max_examples=30, deadline=None)
def test_derivatives_of_the_fields(seed, name):
    rng = np.random.default_rng(seed)
    q, step = rng.normal(size=(2, 5)), 1e-6
    _, slopes = FIELDS[name](q)
    for j in range(2):
        d = np.zeros_like(q)
        d[j] = step
        numeric = (FIELDS[name](q + d)[0] - FIELDS[name](q - d)[0]) / (2 * step) + 0 * q
        # third derivatives of a cubic times step², and rounding of 1e-16 / step
        assert np.abs(np.broadcast_to(slopes, (2, 2, 5))[:, j] - numeric).max() < 1e-8


def test_contrasts_sum_to_zero():
    basis = contrasts(7)
    assert basis.shape == (7, 6) and np.abs(basis.sum(0)).max() < 1e-12
    assert np.allclose(basis.T @ basis, np.eye(6))


def test_two_groups():
    values = np.array([0.0, 5.0, 0.1, 5.2, -0.1, 4.9])
    assert set(np.flatnonzero(two_groups(values, np.ones(6)))) == {1, 3, 5}
    assert two_groups(np.arange(3.0), np.ones(3)) is None  # no two parts of two views


@pytest.mark.parametrize(
    ("effect", "each", "ratio", "wanted"),
    [
        (1.01 * SEVERAL_PX, False, 0.5, "wrong"),
        (0.99 * SEVERAL_PX, False, 0.5, "doubtful"),
        (0.99 * MANY_PX, True, 0.5, "doubtful"),
        (1.01 * MANY_PX, True, 0.5, "wrong"),
        (1.01 * VISIBLE_PX, False, 0.99, "doubtful"),
        (0.99 * VISIBLE_PX, False, 0.99, "note"),
        (0.0, True, WORSE - 0.01, "doubtful"),
        (0.0, True, WORSE + 0.01, "note"),
    ],
)
def test_severity(effect, each, ratio, wanted):
    assert severity(effect, effect, each, ratio) == wanted


@pytest.mark.parametrize(
    ("ratio", "wanted"), [(OTHER_CAMERAS - 0.01, "wrong"), (OTHER_CAMERAS + 0.01, "doubtful")]
)
def test_other_cameras_are_wrong_however_near_the_mean_camera_projects(ratio, wanted):
    assert severity(0.5 * SEVERAL_PX, 0.0, False, ratio, "several-cameras") == wanted


def test_numbering(cases):
    data = cases.seen(cases.camera(), np.random.default_rng(0), 6)
    check_numbering(data)  # as it is: nothing
    by_columns = cases.grid().reshape(6, 9, 3).transpose(1, 0, 2).reshape(-1, 3)
    for wrong in (cases.grid(6, 9), cases.grid(27, 2), by_columns):
        with pytest.raises(DataError, match="those of 9x6"):
            check_numbering(cases.each(data, lambda v, wrong=wrong: replace(v, xyz=wrong)))
    # in no order at all: that is not for this check to say
    rng = np.random.default_rng(1)
    check_numbering(cases.each(data, lambda v: replace(v, uv=v.uv[rng.permutation(len(v))])))


@pytest.mark.parametrize(("farther", "even"), [(1.5, True), (2.0, False)])
def test_steps_of_a_grid_are_even(farther, even):
    """Of 9 points a row, the last so many times as far away as the first."""
    xyz = Board.grid(9, 6).points
    uv = 50 * xyz[:, :2] / (1 + (farther - 1) / 8 * xyz[:, :1])
    assert numbering._even(View("a", xyz, uv), 9, 6) is even
    by_columns = np.arange(54).reshape(6, 9).T.ravel()
    assert not numbering._even(View("a", xyz[by_columns], uv), 9, 6)
    assert not numbering._even(View("a", xyz, uv), 6, 9)


def test_the_size_of_the_pictures(cases):
    """Pictures said to be larger than they are, from both sides of the limit; a cropped picture is not called so."""
    data = cases.seen(cases.camera(), np.random.default_rng(0), 12)
    for factor, said in ((1.25, False), (1.5, True)):
        size = round(cases.SIZE[0] * factor), round(cases.SIZE[1] * factor)
        assert ("image-size" in cases.codes(replace(data, image_sizes=(size,)))) == said
    assert "image-size" not in cases.codes(replace(data, image_sizes=((2560, 960),)))


@pytest.mark.parametrize(
    ("times", "tails", "wanted"), [(1.01, 5.0, "doubtful"), (0.99, 5.0, "wrong"), (1.01, 0.0, "wrong")]
)
def test_little_evidence_in_noise_with_heavy_tails(cases, monkeypatch, times, tails, wanted):
    """The grade of a cause falls only where sigma hardly falls and the noise is not Gaussian."""
    rng = np.random.default_rng(2)
    first, second = cases.camera(), cases.camera(fx=1020.0, fy=1020.0)
    a, b = cases.seen(first, rng, 12), cases.seen(second, rng, 12)
    data = a.with_views(
        tuple(
            replace(w if i >= 6 else v, id=v.id)
            for i, (v, w) in enumerate(zip(a.views, b.views, strict=True))
        )
    )
    made = fitted(data)
    found = find(made)
    found = replace(found, sigma=times * least_fall(12, found.trial.numbers), before=1.0)
    monkeypatch.setattr("camcal.assess.checks.noise.fourth_moment", lambda facts: (2.9, tails))
    (said,) = cause(Facts(made, None, found))
    assert said.severity == wanted


def test_the_fall_of_sigma_that_is_sure():
    """More views need less of it, more numbers more; that of a real set without a second camera (.95) is not enough."""
    assert least_fall(17, 4) == pytest.approx(0.897, abs=1e-3)
    assert least_fall(40, 4) > least_fall(17, 4) > least_fall(17, 16)


@pytest.mark.parametrize("numbers", [np.linspace(0, 1, 401), norm.ppf((np.arange(401) + 0.5) / 401)])
def test_numbers_that_form_no_parts_are_not_explained_by_two(numbers):
    """What the best two parts explain of the variance of uniform and of Gaussian numbers stays below the limit."""
    part = two_groups(numbers, np.ones(len(numbers)))
    means = np.where(part, numbers[part].mean(), numbers[~part].mean())
    share = 1 - ((numbers - means) ** 2).sum() / ((numbers - numbers.mean()) ** 2).sum()
    assert share == pytest.approx(0.75 if numbers.min() == 0 else 2 / np.pi, abs=0.005)
    assert share < MOST_OF_IT
    apart = np.where(part, 1.0, 0.0) + 0.1 * (numbers - means)
    means = np.where(part, apart[part].mean(), apart[~part].mean())
    assert 1 - ((apart - means) ** 2).sum() / ((apart - apart.mean()) ** 2).sum() > MOST_OF_IT


def test_parts_that_explain_little_are_no_cause(cases):
    data = cases.seen(cases.camera(), np.random.default_rng(3), 12)
    made = fitted(cases.each(data, lambda v: replace(v, uv=v.uv * (1.01 if v.id > "v5" else 1.0))))
    found = find(made)
    assert found.trial is not None and found.trial.how != "each" and found.cause is not None
    for share, named in ((0.79, False), (0.81, True)):
        assert (replace(found, share=share).cause is not None) == named


@pytest.mark.parametrize("kind", KINDS)
def test_candidates_at_once_gain_what_each_gains(cases, kind):
    """The search looks at all places of a split, and at all views, by one call."""
    base = fitted(cases.seen(cases.camera(), np.random.default_rng(0), 12))
    warp = all_fields(base)
    linear, columns = Linear.of(base, warp), KINDS[kind](warp)
    views = len(base.poses)
    parts = np.arange(views) >= np.arange(1, views)[:, None]
    each = [linear.gain(shared(p.astype(float)[:, None], columns)) for p in parts]
    np.testing.assert_allclose(linear.gains_of_parts(columns, parts), each, rtol=1e-9)
    sets = np.array([[0, 3, i] for i in range(4, views)])
    each = [linear.gain(shared(np.eye(views)[:, s], columns)) for s in sets]
    np.testing.assert_allclose(linear.gains_of_views(columns, sets), each, rtol=1e-9)


@pytest.mark.parametrize("share", [2, 3])
def test_a_mirrored_part_is_named(cases, share):
    """Half and a third of the pictures, of a lens 13 px off the centre: the part that shows the other side."""
    rng = np.random.default_rng(4)
    data = cases.seen(cases.camera(cx=652.0, cy=471.0), rng, 15)
    some = rng.permutation(15) < 15 // share
    found = find(fitted(cases._mapped(data, some, cases._mirrored)))
    assert found.cause is not None and found.cause.how == "sides"
    assert (found.cause.parts == some).all()
    said = warning_of(found)
    assert said is not None and said.code == "mirrored-picture"


def test_half_a_per_cent_of_zoom_is_evidence_and_chance_is_not(cases):
    """Of 10 draws each: the zoom that moves the camera by six of its sigmas, and none."""
    from camcal.assess.causes.search import EVIDENCE

    assert EVIDENCE == 10.0
    run = cases.COMMON_FAULTS["zoom by 0.5 %"][0]
    zoomed = [find(fitted(run(np.random.default_rng(s)))).trial for s in range(6)]
    still = [find(fitted(cases.seen(cases.camera(), np.random.default_rng(s), 15))).trial for s in range(6)]
    assert all(t is not None and t.kind == "focal" for t in zoomed) and still == [None] * 6


def test_causes_that_the_plan_looked_for_are_not_looked_for_again(cases, monkeypatch):
    """A print that is too long makes a view seem foreign: the plan asks for causes, and the checks take its answer."""
    from camcal.assess import causes

    asked = []

    def counted(*given):
        asked.append(given)
        return find(*given)

    monkeypatch.setattr(causes, "find", counted)
    case = next(c for c in cases.COMMON if c.name == "print 2 % longer in y")
    assert case.named(case.run(np.random.default_rng(11))) and len(asked) == 1


def test_few_coordinates_are_no_evidence(cases):
    """Four corners of six boards leave 8 coordinates: the criterion alone called one of 12 clean sets resized."""
    case = next(c for c in cases.OTHERS if c.name == "four corners of six boards")
    found = case.run(np.random.default_rng(3009))
    assert "resized-pictures" not in found and found.grade != "wrong"
