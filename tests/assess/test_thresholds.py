"""Each number that decides about a warning, from both sides."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess import difference
from camcal.assess.checks import coverage, fit, folds, lens, mirror, noise, rejected, views
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning, grade
from camcal.solve import outliers, turns
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.refine import refine
from tests.solved import solved


@pytest.fixture(scope="module")
def good():
    return solved(views=10, noise=0.2)


def with_residuals(solution, residuals):
    return Facts(replace(solution, residuals=residuals))


def lengths(count, size, gross, times):
    """Residuals of one length, but for `gross` of them that are so many times as long."""
    r = np.zeros((count, 2))
    r[:, 0] = size
    r[:gross, 0] *= times
    return r


@pytest.mark.parametrize(("times", "said"), [(0.97, False), (1.03, True)])
def test_a_point_is_gross_beyond_six_sigma(good, times, said):
    # |r| has the median 1.1774 sigma; GROSS sigma is GROSS / 1.1774 medians. 20 of 540 then hold half of the squares
    count = len(good.residuals)
    r = lengths(count, 0.2, 20, times * fit.GROSS / 1.1774)
    assert fit.GROSS == 6.0
    assert bool(list(fit.outliers(with_residuals(good, r)))) == said


@pytest.mark.parametrize(("step", "off", "severity"), [(270, 3.0, "doubtful"), (14, 60.0, "wrong")])
def test_outliers_make_a_camera_wrong_by_how_far_they_move_it(good, step, off, severity):
    """Two and forty points of 540, read too far out by so many px, fitted as if all were well."""
    uv = good.observations.uv.copy()
    centre = good.camera.params[2:4]
    out = uv[::step] - centre
    uv[::step] += off * out / np.linalg.norm(out, axis=1)[:, None]
    bent = refine(good.camera, good.poses, replace(good.observations, uv=uv))
    (found,) = fit.outliers(Facts(bent))
    assert found.severity == severity


@pytest.mark.parametrize(
    ("gross", "said", "severity"), [(5, False, ""), (8, True, "doubtful"), (40, True, "doubtful")]
)
def test_gross_points_count_by_what_they_hold_of_the_squares(good, gross, said, severity):
    r = lengths(len(good.residuals), 0.2, gross, 5.2)
    found = list(fit.outliers(with_residuals(good, r)))
    share = gross * 27.04 / (gross * 27.04 + 540 - gross)
    assert (share > fit.GROSS_SHARE) == said and bool(found) == said
    if said:
        assert found[0].severity == severity


def with_moment(moment, shapes):
    """Facts whose squared residuals follow the first of the shapes (N,) with that E[x²] / E[x]², and their moment."""
    solution = solved(views=75, noise=0.2)
    x = next(x for x in shapes if np.mean((x / x.mean()) ** 2) >= moment)
    r = np.zeros_like(solution.residuals)
    r[: len(x), 0] = 0.2 * np.sqrt(np.random.default_rng(0).permutation(x))
    used = np.arange(len(r)) < len(x)
    facts = with_residuals(replace(solution, observations=solution.observations.with_used(used)), r)
    return facts, *noise.fourth_moment(facts)


@pytest.mark.parametrize(("moment", "said"), [(2.28, False), (2.5, True)])
def test_tails_are_heavy_from_their_bound_on(moment, said):
    # x = |r|² is a mixture of two exponentials; one in ten points has the larger mean
    base, tenth = -np.log((np.arange(4000) + 0.5) / 4000), np.arange(4000) % 10 == 0
    shapes = (base * np.where(tenth, scale, 1.0) for scale in np.linspace(1.0, 4.0, 400))
    facts, found, deviations = with_moment(moment, shapes)
    assert abs(found - noise.HEAVY) < 0.15 and deviations > noise.SIGNIFICANT
    assert (found > noise.HEAVY) == said
    assert bool(list(noise.tails(facts))) == said


@pytest.mark.parametrize(("moment", "said"), [(1.65, True), (1.75, False)])
def test_tails_are_light_up_to_their_bound(moment, said):
    # powers of an exponential variable: E[x²] / E[x]² grows from 1 (power 0) to 2 (power 1)
    base = -np.log((np.arange(4000) + 0.5) / 4000)
    facts, found, deviations = with_moment(moment, (base**power for power in np.linspace(0.5, 1.0, 400)))
    assert abs(found - noise.LIGHT) < 0.1 and deviations < -noise.SIGNIFICANT
    assert (found < noise.LIGHT) == said
    assert bool(list(noise.tails(facts))) == said


@pytest.mark.parametrize(
    ("factor", "squares", "kept"),
    [(1.05, 2.5, False), (1.4, 1.6, False), (1.4, 2.2, True)],
)
def test_a_mirrored_view_is_suspected_and_proved(good, monkeypatch, factor, squares, kept):
    # SUSPECT is on the rms against the median view, SQUARES on the gain of mirroring it
    data = good.observations
    size = np.where(data.view == 3, factor, 1.0) * 0.2
    r = np.c_[size, np.zeros(len(size))]
    gains = lambda facts, chosen: (np.full(len(chosen), np.log(squares)), np.full(len(chosen), 54))  # noqa: E731
    monkeypatch.setattr(mirror, "gains_of_mirroring", gains)
    found = mirror.mirrored_views(with_residuals(good, r))
    assert (factor > mirror.SUSPECT) == (factor == 1.4) and (squares > mirror.SQUARES) == (squares > 1.8)
    assert found.tolist() == ([3] if kept else [])


@pytest.mark.parametrize(("points", "kept"), [(23, True), (19, False)])
def test_a_mirrored_view_needs_points_enough_to_tell(good, monkeypatch, points, kept):
    data = good.observations
    r = np.c_[np.where(data.view == 3, 1.4, 1.0) * 0.2, np.zeros(len(data.view))]
    gains = lambda facts, chosen: (np.full(len(chosen), np.log(2.0)), np.full(len(chosen), points))  # noqa: E731
    monkeypatch.setattr(mirror, "gains_of_mirroring", gains)
    assert (points * np.log(2.0) > mirror.LIKELIER) == kept
    assert (mirror.mirrored_views(with_residuals(good, r)).tolist() == [3]) == kept


@pytest.mark.parametrize(
    ("ratio", "median", "severity"),
    [
        (1.9, 9.0, None),
        (2.1, 9.0, "doubtful"),
        (4.9, 9.0, "doubtful"),
        (5.1, 0.4, "doubtful"),
        (5.1, 0.6, "wrong"),
    ],
)
def test_views_that_disagree_are_graded_by_ratio_and_size(good, ratio, median, severity):
    facts = Facts(good, {"difference": {"ratio": ratio, "median_px": median}})
    found = [w.severity for w in folds.views_disagree(facts)]
    assert found == ([] if severity is None else [severity])


@pytest.mark.parametrize(("rows", "severity"), [(10, None), (14, "note"), (100, "note"), (120, "doubtful")])
def test_rejected_points_are_graded_by_their_share(good, rows, severity):
    data = good.observations
    facts = Facts(replace(good, observations=data.with_used(np.arange(data.point_count) >= rows)))
    found = [w.severity for w in rejected.many_rejected(facts)]
    assert found == ([] if severity is None else [severity])


@pytest.mark.parametrize(("share", "severity"), [(0.015, "note"), (0.1, "doubtful"), (0.3, "wrong")])
def test_a_fold_is_graded_by_how_much_of_the_picture_it_takes(good, share, severity):
    facts = Facts(good)
    whole = len(lens.grid_of(facts.image_size))
    facts.unseen = np.tile([[639.0, 479.0]], (max(1, round(share * whole)), 1))
    (warning,) = lens.fold_in_image(facts)
    assert warning.severity == severity


@pytest.mark.parametrize(("out", "severity"), [(1, "doubtful"), (60, "wrong")])
def test_points_outside_the_picture_are_graded_by_their_share(good, out, severity):
    data = good.observations
    uv = data.uv.copy()
    uv[:out] = [700.0, 100.0]
    (warning,) = coverage.outside_image(Facts(replace(good, observations=replace(data, uv=uv))))
    assert warning.severity == severity


@pytest.mark.parametrize(("tilt", "severity"), [(1.0, "wrong"), (3.5, "doubtful")])
def test_parallel_views_are_graded_by_their_spread(tilt, severity):
    s = solved(
        "pinhole",
        views=12,
        noise=0.05,
        tilt=np.deg2rad(tilt) * 1.2,
        truth={"fx": 533, "fy": 533, "cx": 320, "cy": 240},
    )
    found = [w.severity for w in views.fronto_parallel(Facts(s))]
    spread = views.tilts(Facts(s))[1]
    assert (spread < views.NOTHING_DEGREES) == (severity == "wrong")
    assert found == [severity]


def test_the_grade_is_the_worst_severity():
    made = {s: CalibrationWarning("x", "y", "z", s) for s in ("note", "doubtful", "wrong")}
    assert grade([]) == grade([made["note"]]) == "good"
    assert grade([made["note"], made["doubtful"]]) == "doubtful"
    assert grade(made.values()) == "wrong"


@pytest.mark.parametrize(
    ("diagonal", "most"), [(800, 4.0), (1000, 5.0), (1600, 5.0), (5000, 5.0), (7233, 7.233), (20_000, 20.0)]
)
def test_an_rms_of_many_px_is_wrong_in_itself(diagonal, most):
    assert fit.most_px(diagonal) == pytest.approx(most)


@pytest.mark.parametrize(("rms", "said"), [(3.99, False), (4.01, True)])
def test_a_large_rms_is_wrong_whatever_else_there_is(good, rms, said):
    # 640x480: the diagonal of 798.7 px from the outermost pixel centres, half a per cent of it
    found = list(fit.large_residuals(with_residuals(good, lengths(len(good.residuals), rms, 0, 1))))
    assert [w.severity for w in found] == ["wrong"] * said


@pytest.mark.parametrize(("ratio", "gaussian"), [(0.99, True), (1.01, False)])
def test_the_rms_may_exceed_the_median_by_so_much(ratio, gaussian):
    # one point of 400 is so long that the sigma of the rms is `ratio` times the bound, that of the median being 1
    bound = outliers.LOOKS_GAUSSIAN + outliers.SCATTER / 20
    r = np.full(400, RAYLEIGH_MEDIAN)
    r[0] = np.sqrt(2 * 400 * (ratio * bound) ** 2 - np.square(r[1:]).sum())
    assert outliers.looks_gaussian(r, 1.0) == gaussian


@pytest.mark.parametrize("less", [0, 1])
def test_tails_are_looked_at_from_so_many_points_on(good, less):
    count = noise.LEAST_IN_ALL - less
    used = np.arange(len(good.residuals)) < count
    r = np.random.default_rng(0).normal(size=good.residuals.shape)
    facts = with_residuals(replace(good, observations=good.observations.with_used(used)), r)
    assert (noise.fourth_moment(facts) == (2.0, 0.0)) == bool(less)


@pytest.mark.parametrize(("count", "said"), [(noise.LEAST_ROUNDED, True), (noise.LEAST_ROUNDED - 1, False)])
def test_coordinates_of_few_points_are_whole_by_chance(good, count, said):
    rows = np.flatnonzero(good.used)[:count]
    data = good.observations
    few = replace(data, uv=data.uv.round()).with_used(np.isin(np.arange(len(data.uv)), rows))
    assert bool(list(noise.rounded(Facts(replace(good, observations=few))))) == said


@pytest.mark.parametrize(("count", "said"), [(views.LEAST_BENT, False), (views.LEAST_BENT - 1, True)])
def test_views_that_distortion_needs(count, said):
    lens = "brown:radial=1,decentering=0"  # five parameters, which two views would be enough for
    facts = Facts(
        solved(lens, views=count, truth={"fx": 533.0, "fy": 533.0, "cx": 322.0, "cy": 238.0, "k1": -0.2})
    )
    assert len(facts.free_names) <= views.PARAMETERS_PER_VIEW * count
    assert bool(list(views.few_views(facts))) == said


@pytest.mark.parametrize(("behind", "said"), [(3, True), (4, False)])
def test_a_target_may_be_seen_from_both_sides(good, monkeypatch, behind, said):
    # 3 of 10 are mistakes in single views, 4 of 10 are more than `MINORITY`
    assert 3 / 10 <= views.MINORITY < 4 / 10
    monkeypatch.setattr(views, "sides", lambda *_: np.arange(10) < behind)
    monkeypatch.setattr(views, "_from_behind", lambda _: np.zeros(10, bool))
    assert [w.code for w in views.mirrored(Facts(good))] == ["mirrored-views"] * said


@pytest.mark.parametrize(
    ("points", "known"), [(difference.LEAST_PIXELS, True), (difference.LEAST_PIXELS - 1, False)]
)
def test_pixels_that_a_rotation_needs(good, points, known):
    pixels = np.array([[100.0, 100.0], [500.0, 120.0], [300.0, 400.0]])[:points]
    found = difference.difference(good.camera, good.camera, pixels)
    assert bool(np.isfinite(found.vectors).all()) == known


@pytest.mark.parametrize(("count", "found"), [(turns.LEAST_POINTS, 4), (turns.LEAST_POINTS - 1, 1)])
def test_points_of_a_board_that_may_look_the_same(count, found):
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    assert len(turns.turns_of(corners[-count:] if count == 4 else corners[[0, 1, 3]])) == found
