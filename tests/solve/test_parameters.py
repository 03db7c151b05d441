"""From `--fix` to the matrix of the free parameters."""

import re

import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model.lenses import make
from camcal.solve.parameters import apply_fixed, free_matrix

LENS = make("opencv5")
START = LENS.from_values({"fx": 500.0, "fy": 520.0, "cx": 320.0, "cy": 240.0, "k1": -0.2})


def free_names(free):
    return [[LENS.names[i] for i in np.flatnonzero(column)] for column in free.T]


def test_nothing_fixed():
    np.testing.assert_array_equal(apply_fixed(LENS, START, {}), START)
    np.testing.assert_array_equal(free_matrix(LENS, START, {}), np.eye(LENS.size))


def test_values_are_set_and_none_holds_the_start():
    fix = {"cx": 319.5, "k1": None}
    params = apply_fixed(LENS, START, fix)
    assert params[LENS.index("cx")] == 319.5 and params[LENS.index("k1")] == -0.2
    free = free_matrix(LENS, params, fix)
    assert free.shape == (9, 7)
    assert not free[[LENS.index("cx"), LENS.index("k1")]].any()


def test_the_start_is_not_changed():
    before = START.copy()
    apply_fixed(LENS, START, {"fx": 1.0, "aspect": None})
    np.testing.assert_array_equal(START, before)


def test_aspect_ties_fx_and_fy():
    params = apply_fixed(LENS, START, {"aspect": None})
    assert params[0] == params[1] == 510.0
    free = free_matrix(LENS, params, {"aspect": None})
    assert free.shape == (9, 8)
    assert ["fx", "fy"] in free_names(free)
    np.testing.assert_array_equal(free[:2, 0], [1.0, 1.0])


def test_aspect_with_a_value():
    params = apply_fixed(LENS, START, {"aspect": 1.04})
    assert params[1] / params[0] == pytest.approx(1.04, rel=1e-15)
    assert params[0] == pytest.approx(0.5 * (500 + 520 / 1.04))
    np.testing.assert_allclose(free_matrix(LENS, params, {"aspect": 1.04})[:2, 0], [1.0, 1.04])


@pytest.mark.parametrize(("name", "expected"), [("fx", (500.0, 525.0)), ("fy", (520.0 / 1.05, 520.0))])
def test_aspect_with_one_of_the_two_fixed_holds_both(name, expected):
    fix = {"aspect": 1.05, name: None}
    params = apply_fixed(LENS, START, fix)
    np.testing.assert_allclose(params[:2], expected, rtol=1e-15)
    assert not free_matrix(LENS, params, fix)[:2].any()


def test_contradiction():
    with pytest.raises(UsageError, match="ratio") as caught:
        apply_fixed(LENS, START, {"fx": 500.0, "fy": 500.0, "aspect": 1.0})
    assert caught.value.hint


@pytest.mark.parametrize("function", [apply_fixed, free_matrix])
def test_unknown_name(function):
    with pytest.raises(UsageError, match="k9"):
        function(LENS, START, {"k9": None})


def test_all_fixed():
    assert free_matrix(LENS, START, dict.fromkeys(LENS.names)).shape == (9, 0)


@pytest.mark.parametrize(
    "fix, said", [({"fx": 0.0}, "fx = 0"), ({"fy": -3.0}, "fy = -3"), ({"k1": np.nan}, "k1 = nan")]
)
def test_values_outside_the_range_are_refused(fix, said):
    with pytest.raises(UsageError, match=f"{re.escape(said)}.*range"):
        apply_fixed(LENS, START, fix)
    assert apply_fixed(LENS, START, {"fx": 1e-6})[0] == 1e-6  # the bound itself
