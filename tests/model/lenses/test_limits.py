"""Numbers of inverses and curves, each just below and just above, by functions whose steps and errors are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model.lenses import curve, inverse, newton
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ two equations
@pytest.mark.parametrize(("share", "ended"), [(LESS, True), (MORE, False)])
def test_the_last_step_of_two_equations(share, ended):
    calls = []

    def function(a, b):
        calls.append(1)
        one, none = np.ones_like(a), np.zeros_like(a)
        return none + share * newton.LAST_STEP, none.copy(), one, none, none, one.copy()

    solved = newton.solve(function, np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))[2]
    assert solved[0] == ended and (len(calls) == 1) == ended


@pytest.mark.parametrize(("settled", "slow"), [(newton.QUICK, False), (newton.QUICK + 1, True)])
def test_steps_for_all_points(monkeypatch, settled, slow):
    """The step is short from the given one on."""
    calls, asked = [], []

    def function(a, b):
        calls.append(1)
        one, none = np.ones_like(a), np.zeros_like(a)
        return none + (0.0 if len(calls) >= settled else 1e-6), none.copy(), one, none, none, one.copy()

    found = newton._slowly
    monkeypatch.setattr(newton, "_slowly", lambda *a: asked.append(1) or found(*a))
    newton.solve(function, np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))
    assert bool(asked) == slow


@pytest.mark.parametrize(("share", "found"), [(0.99, True), (1.01, False)])
def test_points_next_to_a_fold(share, found):
    """At a double root a step of Newton leaves a quarter of the residual."""

    def function(a, b):
        one, none = np.ones_like(a), np.zeros_like(a)
        return a * a, none.copy(), 2 * a, none, none, one

    begin = np.array([np.sqrt(share * newton.SOLVED * 4.0**newton.SLOW)])
    none = np.zeros(1)
    assert newton._slowly(function, none, none, begin, none.copy())[2][0] == found


def test_the_range_of_the_radial_start():
    """It ends at a thousand focal lengths, or just before the limit, where the slope is 0 or infinite."""

    def series(s):
        return np.ones_like(s), np.zeros_like(s)

    assert np.tan(newton.RadialStart(series, np.inf)._inverse.top) == pytest.approx(1000, rel=1e-6)
    top = newton.RadialStart(series, 1.0)._inverse.top
    assert np.pi / 4 - 1e-8 < top == np.pi / 4 * newton.INSIDE < np.pi / 4


# ------------------------------------------------------------------------------------ curves
@pytest.mark.parametrize(("share", "found"), [(0.8, True), (1.2, False)])
def test_a_double_root(share, found):
    """1 ± i ε; rounding leaves ε² to a few 1e-16."""
    part = share * curve.REAL
    assert (curve.first_root([1 + part**2, -2.0, 1.0]) < np.inf) == found


@pytest.mark.parametrize(("share", "found"), [(LESS, True), (MORE, False)])
def test_a_root_that_rounding_makes_up(monkeypatch, share, found):
    off = 2 * share * curve.LEFT  # 1 - x at 1 / (1 + off) leaves off, of terms whose sizes sum to 2
    monkeypatch.setattr(np.linalg, "eigvals", lambda _: np.array([1 + off]))
    assert (curve.first_root([1.0, -1.0]) < np.inf) == found


@pytest.mark.parametrize(("share", "found"), [(LESS, False), (MORE, True)])
def test_a_root_that_is_too_far(monkeypatch, share, found):
    monkeypatch.setattr(np.linalg, "eigvals", lambda _: np.array([share * curve.FARTHEST]))
    monkeypatch.setattr(curve, "LEFT", 1.0)
    assert (curve.first_root([1.0, -1.0]) < np.inf) == found


def test_the_largest_power_of_a_scale():
    most = curve.LARGEST_POWER
    assert curve._scaled([1.0, -(2.0 ** (1 - most))])[1] == most - 1
    assert curve._scaled([1.0, -(2.0 ** -(most + 1))])[1] == most


def given(function, top=1.0):
    """An inverse without its table."""
    made = object.__new__(curve.Inverse)
    made.function, made.top = function, top
    return made


@pytest.mark.parametrize(("target", "size"), [(0.5, 1.0), (20.0, 20.0)])
@pytest.mark.parametrize(("share", "solved"), [(0.99, True), (1.01, False)])
def test_values_that_are_found(share, solved, target, size):
    made = given(lambda t: (np.full_like(t, target + share * curve.SOLVED * size), np.ones_like(t)))
    assert made._bracketed(np.array([target]))[1][0] == solved


@pytest.mark.parametrize(("share", "calls"), [(LESS, 1), (MORE, curve.QUICK)])
def test_the_last_step_of_one_equation(share, calls):
    made_calls = []

    def function(t):
        made_calls.append(1)
        return np.full_like(t, share * curve.LAST_STEP), np.ones_like(t)

    made = given(function)
    made._bracketed = lambda target: (target, True)
    made._newton(np.array([0.5]), np.zeros(1))
    assert len(made_calls) == calls


def test_bracketed_steps(monkeypatch):
    """By bisection alone, which the slope of 0 forces, to the rounding and no less with fewer."""

    def reached():
        made = given(lambda t: (np.sign(t - 0.3), np.zeros_like(t)))
        with np.errstate(all="ignore"):
            return made._bracketed(np.zeros(1))[0][0]

    ends = {}
    for steps in (40, curve.BRACKETED, 2 * curve.BRACKETED):
        monkeypatch.setattr(curve, "BRACKETED", steps)
        ends[steps] = abs(reached() - 0.3)
    few, usual, more = ends.values()
    assert few > 1e-14 and usual < 2e-16 and more < 2e-16


def test_cells_of_the_table_of_an_inverse(monkeypatch):
    """To 1e-9 with 8 kB, and not with a quarter of them."""
    target = np.linspace(0, 0.999 * np.sin(0.8), 1000)
    for cells, fine in ((curve.CELLS // 4, False), (curve.CELLS, True)):
        monkeypatch.setattr(curve, "CELLS", cells)
        made = curve.Inverse(lambda t: (np.sin(t), np.cos(t)), 0.8)
        found = made.start(target.copy())
        assert (np.abs(found - np.arcsin(target)).max() < 1e-9) == fine
        assert made._table.nbytes <= 8192


def test_slopes_of_cubics_that_grow():
    steepest = curve.STEEPEST
    for slope, taken in ((LESS * steepest, LESS * steepest), (MORE * steepest, steepest)):
        table = curve._cubics(np.array([0.0, 1.0]), np.array([slope, 0.0]))
        assert table[1, 0] == pytest.approx(taken)
        inside = np.linspace(0, 1, 1001)
        assert (np.diff(np.polyval(table[::-1, 0], inside)) > -1e-15).all()


def test_what_stands_for_infinity():
    with np.errstate(all="ignore"):
        made = curve.Inverse(lambda t: (t / (1 - t), 1 / (1 - t) ** 2), 1.0)
    assert (
        made.end == curve.HUGE
        and made(np.array([1e9]))[1][0]
        and not made(np.array([MORE * curve.HUGE]))[1][0]
    )


def test_results_that_are_kept():
    for others, calls in ((curve.KEPT - 1, curve.KEPT), (curve.KEPT, curve.KEPT + 2)):
        made = []
        method = curve.cached(lambda _, k, m=made: m.append(k[0]))
        for value in [*range(others + 1), 0]:
            method("owner", np.array([float(value)]))
        assert len(made) == calls


# ------------------------------------------------------------------------------------ rays of pixels
def stepped(step, begin=0.0, most=1):
    """How far p goes, and the calls, where Newton's step is given: X = (-step, 0, 1) before the ray (0, 0, 1)."""
    calls = []

    def ray(_, p, q):
        calls.append(1)
        state = np.zeros((3, 3, 1))
        state[0, :, 0] = -step, 0, 1
        state[1, 0] = state[2, 1] = 1
        return state

    p, q = np.array([begin]), np.zeros(1)
    target = np.array([[0.0], [0.0], [1.0]])
    inverse.InverseLens._iterate(SimpleNamespace(ray=ray), None, p, q, target, most)
    return p[0] - begin, len(calls)


def test_steps_that_are_shortened():
    """Beyond a tenth of a focal length they are at most half of the radius and of .2."""
    long = inverse.LONG
    assert stepped(LESS * long)[0] == pytest.approx(LESS * long)
    assert stepped(long / 1.5, begin=-0.5 * inverse.SPAN)[0] == pytest.approx(long / 1.5)
    assert stepped(MORE * long)[0] == pytest.approx(0.5 * inverse.SPAN) == pytest.approx(0.1)
    assert stepped(5.0, begin=1.0)[0] == pytest.approx(0.6)
    assert stepped(LESS * 0.6, begin=1.0)[0] == pytest.approx(LESS * 0.6)


def test_the_last_step_of_a_pixel():
    assert stepped(LESS * inverse.LAST_STEP, most=3)[1] == 1
    assert stepped(MORE * inverse.LAST_STEP, most=3)[1] == 3


def test_the_extent_of_a_domain():
    """Folds at different radii, up to which it is traced in 32 parts of 99 steps of the angle, in 24 directions."""
    lens = SimpleNamespace(farthest=lambda _: 20.0, pixel_inside=lambda p, q, _: np.ones(p.shape, bool))
    lens._until_fold = lambda k, radius: inverse.InverseLens._until_fold(lens, k, radius)

    def ray(fold, p, q):
        # (p, q, 1 + r² / fold²): X · (dX/dp x dX/dq) = 1 - r² / fold²
        one, none, c = np.ones_like(p), np.zeros_like(p), 1 / fold**2
        return np.array([[p, q, 1 + c * (p * p + q * q)], [one, none, 2 * c * p], [none, one, 2 * c * q]])

    lens.ray = ray
    parts = []
    for fold in np.linspace(0.7, 1.3, 150):
        reach, radii = inverse.InverseLens._extent.__wrapped__(lens, fold)
        assert reach.shape == (24,) and np.ptp(reach) < 1e-12
        parts.append((np.arctan(fold) - np.arctan(reach[0])) / (np.arctan(20.0) / 99 / 32))
    assert min(parts) >= 0 and 0.9 < max(parts) < 1.1
    assert np.degrees(np.arctan(20.0) / 99 / 32) < 0.03
    # a third of a degree from one of the table to the next
    assert len(radii) == 513 and 0.3 < 180 / inverse.CELLS < 0.4
