"""The battery over every model of the table, its variants, with and without skew; and over wrong models."""

import re

import numpy as np
import pytest

from camcal.errors import UsageError
from camcal.model import lenses
from camcal.model.lenses.inverse import InverseLens
from camcal.model.lenses.opencv import OpenCV
from tests.contracts import lens_battery as battery
from tests.contracts.lens_specs import SPECS

LENSES = [lenses.make(spec, skew) for spec in SPECS for skew in (False, True)]
CAMERAS = [
    pytest.param(lens, *camera, id=f"{lens.name}{'+skew' if lens.has_skew else ''}-{i}")
    for lens in LENSES
    for i, camera in enumerate(lens.examples())
]
each_lens = pytest.mark.parametrize("lens", LENSES, ids=repr)
each_camera = pytest.mark.parametrize("lens, params, size", CAMERAS)


def test_every_model_has_a_summary():
    assert set(lenses.SUMMARIES) == set(lenses.LENSES)


@each_lens
def test_parameters(lens):
    battery.check_parameters(lens)


@each_lens
def test_neutral_is_a_plain_camera(lens):
    battery.check_neutral(lens)


@each_camera
def test_shapes(lens, params, size):
    battery.check_shapes(lens, params, size)


@each_camera
def test_jacobians(lens, params, size):
    battery.check_jacobians(lens, params, battery.directions(lens, params, size, 40))


@each_camera
def test_nothing_changes_along_a_ray(lens, params, size):
    battery.check_euler(lens, params, size)


@each_camera
def test_linearise(lens, params, size):
    battery.check_linearise(lens, params, size)


@each_camera
def test_round_trip(lens, params, size):
    battery.check_round_trip(lens, params, size)


@each_camera
def test_whole_sphere(lens, params, size):
    battery.check_whole_sphere(lens, params, size)


@each_camera
def test_outside(lens, params, size):
    battery.check_outside(lens, params, size)


@pytest.mark.parametrize(
    "lens", [n for n in LENSES if not isinstance(n, InverseLens) and not n.has_skew], ids=repr
)
def test_limit(lens):
    for seed in range(20):
        battery.check_limit(lens, battery.random_camera(lens, seed)[0])
        battery.check_limit(lens, battery.random_camera(lens, seed + 2, (-3, 3))[0])


@each_camera
def test_centre(lens, params, size):
    battery.check_centre(lens, params)


@each_camera
def test_prior(lens, params, size):
    battery.check_prior(lens, params)


@each_camera
def test_opencv(lens, params, size):
    battery.check_opencv(lens, params, size)


@pytest.mark.parametrize("name", lenses.LENSES)
def test_unknown_option(name):
    with pytest.raises(UsageError, match="nonsense") as error:
        lenses.make(f"{name}:nonsense=3")
    assert error.value.hint


def test_unknown_model():
    with pytest.raises(UsageError, match="unknown model 'opencv6'"):
        lenses.make("opencv6")


# ---------------------------------------------------------------------------------------------- wrong models
class _Wrong(OpenCV):
    """opencv5 with one mistake; `catches` says which check must fall."""

    catches = ""

    def __init__(self):
        super().__init__("opencv5")


class WrongParameterDerivative(_Wrong):
    catches = "jacobians"

    def derivatives(self, k, x, y, z, d_xyz, d_k, fx, fy):
        found = super().derivatives(k, x, y, z, d_xyz, d_k, fx, fy)
        d_k[:, 4] *= 1.0001
        return found


class WrongPointDerivative(_Wrong):
    catches = "euler"

    def derivatives(self, k, x, y, z, d_xyz, d_k, fx, fy):
        found = super().derivatives(k, x, y, z, d_xyz, d_k, fx, fy)
        d_xyz[:, 2] *= 1 + 1e-7
        return found


class ForgetsARow(_Wrong):
    catches = "linearise"

    def linearise(self, params, x, y, z, uv, d_xyz, d_params):
        kept = d_params[:, 6].copy()
        ok = super().linearise(params, x, y, z, uv, d_xyz, d_params)
        d_params[:, 6] = kept
        return ok


class NeverOutside(_Wrong):
    catches = "whole_sphere"

    def in_domain(self, k, x, y, z):
        return z > 0


class BehindIsInside(_Wrong):
    catches = "outside"

    def in_domain(self, k, x, y, z):
        return x * x + y * y < (self.plane.fold(k) * z) ** 2


class LooksOnlyAtTheSlope(_Wrong):
    """Beyond a second fold the slope is positive again."""

    catches = "outside"

    def examples(self):
        params, size = super().examples()[0]
        params[4:] = -0.6, 0.1, 0, 0, 0
        return [(params, size)]

    def derivatives(self, k, x, y, z, d_xyz, d_k, fx, fy):
        xd, yd, _ = super().derivatives(k, x, y, z, d_xyz, d_k, fx, fy)
        slope = (x * d_xyz[:, 0, 0] + y * d_xyz[:, 1, 0]) * x + (x * d_xyz[:, 0, 1] + y * d_xyz[:, 1, 1]) * y
        return xd, yd, bool((slope > 0).all() and (z > 0).all())


class LaxLinearise(_Wrong):
    catches = "linearise"

    def linearise(self, *args):
        super().linearise(*args)
        return True


class RoughInverse(_Wrong):
    catches = "round_trip"

    def undistort(self, k, mx, my):
        x, y, z, valid = super().undistort(k, mx, my)
        return x * (1 + 1e-10), y, z, valid


class WrongNeutral(_Wrong):
    catches = "neutral"

    def distort(self, k, x, y, z):
        mx, my = super().distort(k, x, y, z)
        return mx + 1e-8 * my, my


class WrongTerms(_Wrong):
    catches = "embedding"

    def terms(self):
        return super().terms() | {"n2": "k3", "n3": "k2"}


class EndsEarly(_Wrong):
    """By 0.06 degrees."""

    catches = "limit"

    def limit_angle(self, params):
        return super().limit_angle(params) - 1e-3


class EndsLate(_Wrong):
    catches = "limit"

    def limit_angle(self, params):
        return super().limit_angle(params) + 1e-3


class SwappedForCv2(_Wrong):
    catches = "opencv"

    def opencv(self, params):
        form = super().opencv(params)
        form.distortion[[2, 3]] = form.distortion[[3, 2]]
        return form


def _run(check, lens):
    params, size = lens.examples()[0]
    arguments = {
        "jacobians": (lens, params, battery.directions(lens, params, size)),
        "neutral": (lens,),
        "embedding": (lens, OpenCV("opencv4")),
        "limit": (lens, params),
        "centre": (lens, params),
    }
    getattr(battery, f"check_{check}")(*arguments.get(check, (lens, params, size)))


@pytest.mark.parametrize("wrong", _Wrong.__subclasses__())
def test_the_battery_catches_a_wrong_model(wrong):
    right = OpenCV("opencv5")
    right.examples = wrong().examples
    _run(wrong.catches, right)
    with pytest.raises(AssertionError):
        _run(wrong.catches, wrong())


def test_differences_are_sharper_than_the_tolerance():
    exact = np.exp(0.3) * 500
    got = battery.difference(lambda t: 500 * np.exp(0.3 + t), 1e-3)
    assert abs(got - exact) / exact < battery.DERIVATIVE / 50


@pytest.mark.parametrize(
    "most, beyond",
    [
        ("kb:12", "kb:13"),
        ("brown:radial=10,decentering=6", "brown:radial=11"),
        ("brown:radial=0,decentering=6", "brown:decentering=7"),
        ("division:8", "division:9"),
        ("scaramuzza:12", "scaramuzza:13"),
        ("scaramuzza:2", "scaramuzza:1"),
        ("radial-profile:40", "radial-profile:41"),
        ("radial-profile:2", "radial-profile:1"),
        ("polynomial:15", "polynomial:16"),
        ("polynomial:1", "polynomial:0"),
        ("spline:40x4", "spline:41x4"),
        ("spline:4x4", "spline:4x3"),
        ("spline:4x4,smooth=0", "spline:4x4,smooth=-1"),
        ("brown:prism=1", "brown:prism=2"),
        ("brown:centre=free", "brown:centre=here"),
        ("division:1,direction=distort", "division:1,direction=back"),
        ("kb:0", "kb:x"),
    ],
)
def test_options_up_to_their_limits(most, beyond):
    battery.check_parameters(lenses.make(most))
    option = re.escape(beyond.rpartition(":")[2].rpartition(",")[2])
    with pytest.raises(UsageError, match=f"{option}"):
        lenses.make(beyond)
