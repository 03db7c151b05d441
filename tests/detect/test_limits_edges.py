"""Limits of fitted edges, of corners' windows and of their fits, each just below and just above."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize
from scipy.special import erf

from camcal.detect import camera_pass, edge_model, fit, outlines, saddle, segment_fit, shading, windows
from camcal.detect.fit import Fits
from tests.detect import drawing
from tests.detect.test_both_sides import outline
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ outlines of squares
@pytest.mark.parametrize(("share", "kept"), [(0.99, True), (1.01, False)])
def test_a_corner_that_an_outline_does_not_have(share, kept):
    """One side of a square of 1,000 px has a vertex in its middle, by a part of the perimeter outside."""

    def perimeter(off):
        return 3000 + 2 * np.hypot(500, off)

    off = optimize.brentq(lambda d: d - share * outlines.CORNER * perimeter(d), 0, 999)
    made = outline(np.rint([[0, 0], [500, -off], [1000, 0], [1000, 1000], [0, 1000]]))
    assert (outlines._quadrilateral(made) is not None) == kept


def wavy(amplitude, length=120):
    """A picture that is dark below an edge at v = 20, which swings by `amplitude` px with a period of 8 px."""
    v, u = np.mgrid[:41, :length]
    edge = 20 + amplitude * np.sin(2 * np.pi * (u - 0.5) / 8)
    return (50 + 100 * np.clip((edge - v) / 3 + 0.5, 0, 1)).astype(np.float32)  # interpolated exactly


def edge_of(picture, length=100.0, ends=(0.0, 0.0)):
    start = np.array([10.0, 20.0])
    return outlines._edge(picture, start, start + (length, 0.0), 3.0, np.array(ends), 0.0)


def test_the_straightest_edge():
    # the deviation of a sine is its amplitude over the root of two
    for share, straight in ((0.9, True), (1.1, False)):
        assert (edge_of(wavy(share * outlines.STRAIGHT * np.sqrt(2))) is not None) == straight


def test_the_least_scatter_of_an_edge():
    for share, scatter in ((0.5, outlines.FLOOR), (2.0, 2 * outlines.FLOOR)):
        made = edge_of(wavy(share * outlines.FLOOR * np.sqrt(2)))
        assert np.sqrt(made.variance) == pytest.approx(scatter, rel=0.1)
    assert edge_of(wavy(0.0)).variance == outlines.FLOOR**2


def dark_square(side=40):
    v, u = np.mgrid[:100, :100]
    inside = np.clip(side / 2 + 0.5 - np.abs(u - 50), 0, 1) * np.clip(side / 2 + 0.5 - np.abs(v - 50), 0, 1)
    half = side / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]]) + 50
    return (200 - 150 * inside).astype(np.float32), corners[None]


@pytest.mark.parametrize("side", [12, 60])
def test_the_ends_of_an_edge(side):
    """No profile lies in the first px of a short edge, or in a part of a long one, whatever the picture shows there."""
    gray, quads = dark_square(side)
    usual = outlines.refine_squares(gray, quads, np.array([99.0])).corners
    first = 50 - side // 2
    skipped = int(max(outlines.ENDS * side, outlines.ENDS_PX))
    for changed, same in ((skipped, True), (skipped + 1, False)):
        other = gray.copy()
        other[:first, first + 1 : first + changed] = 160.0
        found = outlines.refine_squares(other, quads, np.array([99.0])).corners
        assert np.array_equal(found, usual) == same


def test_how_far_profiles_reach():
    gray, quads = dark_square()
    for share, good in ((LESS, False), (MORE, True)):
        room = np.array([share * outlines.SHORTEST / outlines.REACH])
        assert outlines.refine_squares(gray, quads, room).good[0] == good
    usual = outlines.refine_squares(gray, quads, np.array([99.0])).corners
    for beyond, same in ((1.0, True), (-1.0, False)):
        other = gray.copy()
        first = 71 + int(outlines.LONGEST + beyond)
        other[:, first:] = 90.0
        found = outlines.refine_squares(other, quads, np.array([99.0]))
        assert np.array_equal(found.corners, usual) == same


def test_the_inside_of_a_printed_square():
    """Of seven columns of samples three are darker and three brighter than the one in the middle."""
    quads = 40.0 * (np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]]) - 0.5) + 50
    for share, plain in ((0.97, True), (1.03, False)):
        step = share * outlines.PLAIN * 100 / np.sqrt(6 / 7)
        v, u = np.mgrid[:100, :100]
        inside = (np.abs(u - 50) <= 20) & (np.abs(v - 50) <= 20)
        gray = np.where(inside, 50 + step * np.sign(u - 50), 150).astype(np.float32)
        mask, contrast = outlines.plain_inside(gray, quads)
        assert contrast == pytest.approx(100) and mask[0] == plain


# ------------------------------------------------------------------------------------ windows
def curve(slope_at_end=1.0, bend=0.0):
    """The curve of an edge across which the board coordinate has the slope 1, and another at one end of the window."""
    slope = np.ones(len(windows.ALONG))
    slope[-1] = slope_at_end
    middle = -bend * windows.ALONG**2 * slope
    return windows._curve(np.stack([middle - windows.BESIDE * slope, middle + windows.BESIDE * slope])[None])[
        0
    ]


def test_a_map_that_is_not_of_a_plane():
    for share, used in ((LESS, False), (MORE, True)):
        assert curve(share * windows.LEAST_SCALE, 0.1).any() == used
    for share, used in ((LESS, True), (MORE, False)):
        assert curve(1.0, share * windows.MOST_BEND).any() == used
    np.testing.assert_allclose(curve(1.0, 0.3), [0.3, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("largest", [windows.LARGEST, camera_pass.LARGEST])
def test_the_largest_window(monkeypatch, largest):
    for share, half in ((LESS, 0.5), (MORE, 0.5 / MORE)):
        sides = share * 2 * largest * np.eye(2)[None]
        assert windows.limited(0.5, sides, largest)[0] == pytest.approx(half)
    if largest == windows.LARGEST:
        assert windows.limited(1.0, 100 * np.eye(2)[None])[0] == largest / 100
    else:
        asked = []
        monkeypatch.setattr(saddle, "sharpen_sizes", lambda *a: asked.append(a[-1]) or [])
        view = SimpleNamespace(uv=np.array([[5.0, 5.0]]))
        camera_pass.refine_in_windows(np.zeros((9, 9), np.uint8), view, lambda uv: uv, 1.0, blur=1.0)
        assert asked == [largest]


def test_a_pixel_without_an_area_on_the_board():
    for share, known in ((LESS, False), (MORE, True)):
        scale = np.sqrt(share * camera_pass.NO_AREA)
        assert camera_pass._sides(np.zeros((1, 2)), lambda uv, s=scale: s * uv, 1.0)[1][0] == known


# ------------------------------------------------------------------------------------ fits
@cache
def fitted_corner():
    """A window around a noise-free corner, and the parameters of its fit."""
    h = drawing.homography((5, 5), (80, 80), square=14)
    gray = drawing.light(h, (5, 5), (160, 160), blur=1.0).astype(np.float32)
    uv = drawing.corners((5, 5), h)[[12]]
    sides = 14 * np.eye(2)[None]
    cut = windows.cut(gray, uv, sides, 0.4, 4.0)
    start = fit.first_guess(cut, saddle.edge_normals(sides), np.ones(1))
    return cut, fit.fit(cut, start, (0.0, 255.0), 1e-6).params


def corner_fit(shift=0.0):
    """A window, parameters that are those of its fit but for a shift along x, and the limits of grey values."""
    cut, params = fitted_corner()
    params = params.copy()
    params[:, edge_model.DX] += shift
    return cut, params, (0.0, 255.0)


def step_of(shift):
    """The length of a step from such parameters in blurs, and in px."""
    cut, params, limits = corner_fit(shift)
    problem = fit._Corners(cut, limits)
    state, _, length = fit._stepped(problem, params, problem.linearise(params, np.arange(1)))
    return length[0], np.abs(state - params)[0, :2].max()


def shift_for(limit, which):
    return optimize.brentq(lambda s: step_of(s)[which] - limit, 1e-4, 0.9, rtol=1e-6)


def test_a_step_that_is_too_long():
    for share, moved in ((LESS, True), (MORE, False)):
        cut, params, limits = corner_fit(shift_for(share * fit.LONG, 0))
        assert (fit.approached(cut, params, limits)[0] != params).any() == moved


def test_a_step_that_is_short_enough():
    """It is the only one; from farther away the fit is iterated, and ends nearer to its minimum."""
    least = corner_fit()[1]
    for share, once in ((LESS, True), (MORE, False)):
        cut, params, limits = corner_fit(shift_for(share * fit.SHORT, 0))
        size = windows.Inner(cut.value.shape[1], cut.inside)
        (found,) = fit.fit_sizes(cut, [size], params, limits)
        problem = fit._Corners(cut, limits)
        stepped = fit._stepped(problem, params, problem.linearise(params, np.arange(1)))[0]
        assert np.array_equal(found.params, stepped) == once
        assert np.abs(found.params - least)[0, :2].max() < fit.SHORT**2 / 2


def test_a_fit_that_stands_still(monkeypatch):
    """A fit that reaches the last iteration has converged where its next step is that short."""

    def ends(problem, start, _):
        stats = SimpleNamespace(converged=np.zeros(1, bool))
        return start, problem.linearise(start, np.arange(1)), stats

    for share, still in ((LESS, True), (MORE, False)):
        cut, params, limits = corner_fit(shift_for(share * fit.STILL, 1))
        with monkeypatch.context() as patch:
            patch.setattr(fit, "minimise", ends)
            assert fit.fit(cut, params, limits).converged[0] == still


def test_the_least_noise_of_a_fit():
    """That of rounding to whole grey levels; and what a Gaussian does not tell of the area of a pixel."""
    params = np.zeros((1, edge_model.COUNT))
    params[:, edge_model.BLUR] = 1.0
    for noise, found in ((LESS * fit.ROUNDING, fit.ROUNDING), (MORE * fit.ROUNDING, MORE * fit.ROUNDING)):
        assert fit._noise(np.array([0.5 * 100 * noise**2]), np.array([107]), params)[0] == pytest.approx(
            found
        )
    params[:, edge_model.CONTRAST] = 1e5
    assert fit._noise(np.zeros(1), np.array([107]), params)[0] == pytest.approx(
        1e5 * fit.SQUARE_PIXEL, rel=1e-3
    )
    # an edge under a Gaussian and a pixel's area, and that under a Gaussian of the same variance
    x = np.linspace(-8, 8, 3201)
    for blur in (0.8, 1.5):
        sigma, at = np.sqrt(blur**2 - 1 / 12), x[:, None] + (np.arange(100) - 49.5) / 100
        exact = erf(at / np.sqrt(2) / sigma).mean(1)
        off = (exact - erf(x / np.sqrt(2) / blur))[np.abs(x) < 2 * blur]
        assert np.sqrt(np.mean(off**2)) * blur**4 == pytest.approx(fit.SQUARE_PIXEL, rel=0.25)


@pytest.mark.parametrize(("limit", "inwards"), [(fit.LEAST_BLUR, 1), (fit.MOST_BLUR, -1)])
def test_the_least_and_the_largest_blur(limit, inwards):
    problem = fit._Corners(*[corner_fit()[i] for i in (0, 2)])
    state = np.ones((1, edge_model.COUNT))
    for off, found in ((inwards * 0.01, limit + inwards * 0.01), (-inwards * 0.01, limit)):
        step = np.zeros_like(state)
        step[:, edge_model.BLUR] = limit + off - 1
        assert problem.retract(state, step)[0, edge_model.BLUR] == pytest.approx(found)


def test_windows_without_an_edge_can_be_solved():
    """Their equations are singular: the damping of a step and the rounding of the products keep them finite."""
    cut, params, limits = corner_fit()
    flat = windows.Windows(cut.origin, cut.q, np.full_like(cut.value, 90), cut.counts, cut.inside)
    params[:, edge_model.CONTRAST] = 0
    problem = fit._Corners(flat, limits)
    equations = problem.linearise(params, np.arange(1))
    assert np.linalg.matrix_rank(equations.matrix[0]) < edge_model.COUNT
    assert np.isfinite(fit._stepped(problem, params, equations)[0]).all()
    assert np.isfinite(fit._inverse(equations.matrix)).all()
    # on an edge they change neither
    cut, params, limits = corner_fit(0.02)
    equations = fit._Corners(cut, limits).linearise(params, np.arange(1))
    exact = np.linalg.inv(equations.matrix[0].astype(float))
    found = fit._inverse(equations.matrix)[0]
    assert np.abs(found[:2, :2] / exact[0, 0] - exact[:2, :2] / exact[0, 0]).max() < 10 * fit.PRODUCTS
    undamped = -exact @ equations.gradient[0]
    problem = fit._Corners(cut, limits)
    assert problem.solve(params, equations, np.full(1, fit.SLIGHT))[0][0] == pytest.approx(
        undamped, rel=1e-4, abs=1e-5
    )


# ------------------------------------------------------------------------------------ the model of an edge
def test_the_error_of_the_approximated_edge():
    u = np.linspace(-6, 6, 20_001, dtype=np.float32)[None]
    error = np.abs(edge_model.step(u, np.ones(1))[0] - erf(u / np.sqrt(2))).max()
    assert 0.8 * edge_model.ERF_ERROR < error < 1.02 * edge_model.ERF_ERROR
    # a descent of a sum of squares that this error can make does not count
    cut, _, limits = corner_fit()
    least = 0.5 * cut.counts.sum() * (edge_model.ERF_ERROR * 255) ** 2
    assert fit._Corners(cut, limits).rounding[0] == pytest.approx(least)


def test_the_third_term_of_oblique_edges():
    """It is left out where it is less than a tenth of a grey level at a contrast of 100."""
    q = (
        np.stack(np.meshgrid(np.linspace(-4, 4, 41), np.linspace(-4, 4, 41)))
        .reshape(1, 2, -1)
        .astype(np.float32)
    )
    for share, terms in ((LESS, 2), (MORE, 3)):
        r = share * edge_model.OBLIQUE
        params = np.array([[0, 0, 0, np.arccos(r), 0, 100.0, 1.0]])
        u1, u2 = q[0, 0], np.cos(params[0, 3]) * q[0, 0] + np.sin(params[0, 3]) * q[0, 1]
        (e1, d1), (e2, d2) = (edge_model.step(u[None], np.ones(1)) for u in (u1, u2))
        series = [r, r**2 / 2 * u1 * u2, r**3 / 6 * (u1**2 - 1) * (u2**2 - 1)]
        value = (e1 * e2 + d1 * d2 * sum(series[:terms]))[0] * 100
        np.testing.assert_allclose(edge_model.evaluate(q, params)[0][0], value, atol=2e-3)
        assert np.abs(100 * d1 * d2 * series[2]).max() == pytest.approx(0.1, rel=0.2)


# ------------------------------------------------------------------------------------ shading
def test_a_shift_by_shading_that_is_significant():
    """Of two corners the second has unusual residuals, those of a gradient."""
    cut, params, limits = corner_fit()
    both = cut.take(np.array([0, 0]))
    both.value[1] += np.where(both.counts[1], 2.0 * np.where(both.counts[1], both.q[1, 0], 0), 0)
    params = params.repeat(2, 0)

    def added(variance):
        covariance = variance * np.eye(2)[None].repeat(2, 0)
        found = shading.with_slopes(
            both, Fits(params, covariance, np.array([1.0, 9.0]), np.ones(2, bool)), limits
        )
        return (found.covariance - covariance)[1]

    move = np.trace(added(1e-12))
    assert move > 0
    for share, counted in ((MORE, True), (LESS, False)):  # the shift, in sigmas
        assert added(move / (share * shading.SIGNIFICANT) ** 2).any() == counted


def test_a_corner_with_less_weight_in_the_shading():
    """One of 401 values of a constant level; the others lie one above and one below it."""
    for share, whole in ((0.98, True), (1.02, False)):
        values = np.r_[np.tile([1.0, -1.0], 200), share * shading.HUBER][:, None]
        found = shading._robust_fits(np.ones((401, 1)), values)[0, 0]
        assert (abs(found / values.mean() - 1) < 1e-6) == whole


def test_shading_of_corners_in_a_row(monkeypatch):
    """The ridge makes the equations solvable, and changes nothing where they are."""
    count = shading.LEAST_CORNERS
    row = np.c_[10.0 * np.arange(count), np.full(count, 50.0)]
    found = shading.slopes(row, 100 + 0.2 * row[:, 0], np.full(count, 40.0), np.ones(count, bool))
    assert np.isfinite(found).all()
    spread = row + np.random.default_rng(0).normal(0, 20, row.shape)
    exact = shading.slopes(spread, 100 + 0.2 * spread[:, 0], np.full(count, 40.0), np.ones(count, bool))
    np.testing.assert_allclose(exact[..., 0], 0.2, rtol=1e-5)
    monkeypatch.setattr(shading, "RIDGE", 0.0)
    with pytest.raises(np.linalg.LinAlgError):
        shading.slopes(row, 100 + 0.2 * row[:, 0], np.full(count, 40.0), np.ones(count, bool))


# ------------------------------------------------------------------------------------ segments
def test_points_beside_a_segment():
    """Of exact points one lies aside; beyond the biweight's range of the least deviation it has no influence."""
    place = np.linspace(-50, 50, 101)
    for share, counts in ((0.98, True), (1.02, False)):
        off = np.zeros(101)
        off[50] = share * segment_fit.TUKEY * segment_fit.FINEST
        middle, _ = segment_fit._line(place, off, np.ones(101))
        assert (abs(middle) > 1e-12) == counts
