"""Numbers of single lens models, each from both sides of the angle, radius or value that it is."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.lenses import direct, fov, opencv, pairs, radial, radial_profile, rational, spline
from camcal.model.lenses.parameters import LEAST_FOCAL
from tests.sides import LESS, MORE


def ray(angle):
    return np.array([[np.sin(angle), 0.0, np.cos(angle)]])


# ------------------------------------------------------------------------------------ direct fits
@pytest.mark.parametrize(("share", "found"), [(LESS, True), (MORE, False)])
def test_rays_of_a_polynomial(share, found):
    """Three rays, of which one is at the limit, for the three terms of a first degree."""
    rays = np.concatenate([ray(0.1), [[0.0, 0.1, 1.0]], ray(share * direct.WIDEST)])
    uv = 800 * rays[:, :2] + (500, 400)
    assert (direct.polynomial(rays, uv, 1) is not None) == found


@pytest.mark.parametrize("angle", np.linspace(0, np.pi / 2, 7))
def test_vectors_across_a_ray(angle):
    """The cross product with the other axis is never shorter than .8 where it is taken."""
    rays = np.array(
        [
            [x, np.sqrt(1 - x * x) * np.sin(angle), np.sqrt(1 - x * x) * np.cos(angle)]
            for x in (0, LESS * direct.NEAR_AXIS, MORE * direct.NEAR_AXIS, 1)
        ]
    )
    both = direct._across(rays)
    assert np.abs(np.einsum("ani,ni->an", both, rays)).max() < 1e-15
    # of x below .6 the cross product with the x axis, which is normal to x; above, with the y axis
    assert np.abs(both[0, :2, 0]).max() == 0 and np.abs(both[0, 2:, 1]).max() == 0


# ------------------------------------------------------------------------------------ single models
def test_the_slope_of_a_field_of_view_near_a_pinhole_camera():
    """Its series and the closed form agree to what the series leaves out and cancellation takes, w³."""
    lens = lenses.make("fov")
    slopes = []
    for share in (LESS, MORE):
        camera = np.array([1.0, 1, 0, 0, share * fov.SMALL])
        by_params = lens.jacobians(camera, np.array([[0.5, 0.2, 1.0]]))[2]
        slopes.append(by_params[0, :, 4] / camera[4])
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-6, atol=0)


def test_the_first_field_of_view():
    """At 45 degrees from the axis it moves a point by 1 %, which a refinement feels."""
    lens = lenses.make("fov")
    uv = lens.project(lens.pinhole(1.0, 1.0, 0.0, 0.0), np.array([[1.0, 0, 1]]))[0]
    assert uv[0, 0] == pytest.approx(0.99, abs=0.002)
    assert lens.pinhole(1.0, 1.0, 0.0, 0.0)[4] == fov.FIRST


@pytest.mark.parametrize(("share", "used"), [(LESS, 4), (MORE, 3)])
def test_rays_of_a_rational_start(monkeypatch, share, used):
    asked = []
    monkeypatch.setattr(opencv, "fit_rational", lambda r, *_: asked.append(len(r)))
    angles = np.array([0.1, 0.2, 0.3, share * opencv.WIDEST])
    monkeypatch.setattr(opencv, "image_radii", lambda *_: (angles, angles))
    lenses.make("opencv5").shapes(np.zeros((4, 3)), np.zeros((4, 2)), None)
    assert asked == [used]


@pytest.mark.parametrize(("share", "plane"), [(LESS, True), (MORE, False)])
def test_ideal_coordinates_that_are_pixels(share, plane):
    """20 focal lengths, which are 168 degrees, or 20 px."""
    ideal = np.array([[0.0, 0.0], [share * pairs.PLANE, 1.0]])
    assert (pairs._ideal_camera(ideal) == np.eye(3)).all() == plane
    assert 2 * np.degrees(np.arctan(pairs.PLANE / 2)) == pytest.approx(168.6, abs=0.1)


@pytest.mark.parametrize("name", ["pinhole", "kb4", "spline:4x4"])
def test_the_least_focal_length(name):
    lower = [p.lower for p in lenses.make(name).parameters[:2]]
    assert lower == [LEAST_FOCAL] * 2 and 0 < LEAST_FOCAL < 1e-3


def test_the_largest_angle_of_a_radial_lens():
    """A curve that passes 180 degrees ends there, by less than a millionth of a px in any picture."""
    for top, limit in ((3.0, 3.0), (4.0, radial.ALMOST_PI)):
        lens = SimpleNamespace(
            ray_angle=lambda _, r, t=top: (np.full_like(r, t), np.ones_like(r)), reach=lambda _: 1.0
        )
        assert radial.InverseRadialLens.limit.__wrapped__(lens, None) == limit
    assert 0 < np.pi - radial.ALMOST_PI < 1e-6


def test_the_range_of_the_inverse_of_a_radial_lens():
    for reach, top in ((1.0, np.pi / 4), (np.inf, radial.WIDEST)):
        lens = SimpleNamespace(
            ray_angle=lambda _, r: (np.arctan(r), 1 / (1 + r * r)), reach=lambda _, end=reach: end
        )
        assert radial.InverseRadialLens._inverse.__wrapped__(lens, None).top == pytest.approx(top, abs=1e-15)
    assert 1e8 < np.tan(radial.WIDEST) < 1e10


@pytest.mark.parametrize(
    ("alpha", "rest"), [(0.999, 1e-3), (1 - 2e-9, 2e-9), (1 - 0.5e-9, 1e-9), (1.0, 1e-9)]
)
def test_the_largest_alpha_that_has_another_reading(alpha, rest):
    """Beyond it 1 - α is taken for the least one, a billionth."""
    values = {"fx": 800.0, "fy": 800.0, "cx": 1.0, "cy": 2.0, "alpha": alpha}
    (xi,) = [r.terms["xi"] for r in lenses.make("ucm").readings(values) if "xi" in r.terms]
    assert xi == pytest.approx(1 / rest - 1, rel=1e-6)


# ------------------------------------------------------------------------------------ curves and grids
def test_a_fold_of_a_profile_is_found_to_a_millionth():
    """Of an interval: the first look sees a sixteenth of it, each of the four others 16 times less."""
    lens = lenses.make("radial-profile:8")
    for fold in np.linspace(0.52, 0.66, 40):
        made = SimpleNamespace(
            intervals=8, ray_angle=lambda _, r, f=fold: (0.1 * r, np.where(r < f, 1.0, -1.0))
        )
        found = type(lens).reach.__wrapped__(made, np.array([2.0]))
        assert 0 <= fold - found < 2.0 / 8 / 16**5 * 1.01


def test_how_far_a_profile_reaches():
    lens = lenses.make("radial-profile:8")
    rays = np.c_[np.linspace(0.01, 0.5, 40), np.zeros(40), np.ones(40)]
    (shape,) = lens.shapes(rays, 800 * rays[:, :2] + (500, 400), None)
    assert shape["reach"] == pytest.approx(1.1 * 0.5, rel=1e-2) and radial_profile.MARGIN == 1.1
    lower = {p.name: p.lower for p in lens.parameters}["reach"]
    assert lower == radial_profile.LEAST_REACH < 0.005  # of the longest telescope lens of the benchmarks


def test_third_differences_count_a_hundredth():
    """Of a profile, one of 100 px counts like a residual of 1 px; of a spline, by the weight that it may be given."""
    lens = lenses.make("radial-profile:4")
    params = lens.examples()[0][0].copy()
    params[-5:] = np.arange(5) ** 3 / 6 * 100 / params[0]
    assert lens.prior(params)[0] == pytest.approx([1.0, 1.0])
    params = np.random.default_rng(0).normal(size=40)
    usual, same, other = (
        lenses.make(name).prior(params)[0]
        for name in ("spline:4x4", "spline:4x4,smooth=0.01", "spline:4x4,smooth=0.02")
    )
    np.testing.assert_allclose(usual, same, rtol=1e-12)
    np.testing.assert_allclose(2 * usual[:-3], other[:-3], rtol=1e-12)  # the last three hold the directions


def test_the_rectangle_of_a_spline():
    """A twentieth of the picture is added on each side."""
    lens = lenses.make("spline:4x4")
    rays = np.c_[np.random.default_rng(0).uniform(-0.5, 0.5, (80, 2)), np.ones(80)]
    uv = 800 * rays[:, :2] + (499.5, 399.5)
    (shape,) = lens.shapes(rays, uv, (1000, 800))
    width = (shape["right"] - shape["left"]) * shape["fx"]
    assert width == pytest.approx(1.1 * 999, rel=1e-6) and spline.MARGIN == 0.05


def test_a_spline_without_smoothness_is_still_determined():
    """Its direct fit has a little of it, as there are cells without points."""
    rays = np.c_[np.random.default_rng(0).uniform(-0.1, 0.1, (80, 2)), np.ones(80)]
    uv = 800 * rays[:, :2] + (499.5, 399.5)
    lens = lenses.make("spline:6x6,smooth=0")
    (shape,) = lens.shapes(rays, uv, (1000, 800))
    grid = np.array([v for n, v in shape.items() if n[0] in "xy" and n[1].isdigit()])
    assert np.abs(grid).max() < 1.0  # without it some are undetermined
    seen = lens.project(lens.from_values(shape), rays)[0]
    assert np.abs(seen - uv).max() < 0.5


def test_the_least_denominator(monkeypatch):
    """A pole among the points weighs at most a thousand times as much as a point of a pinhole camera."""
    r = np.linspace(0.1, 1.0, 20)
    weights, found = [], np.linalg.lstsq

    def solve(rows, right, rcond):
        weights.append(np.abs(right).max())
        return np.array([0.0, -1.0]), *found(rows, right, rcond)[1:]  # 1 - r²: 0 at the last radius

    monkeypatch.setattr(np.linalg, "lstsq", solve)
    rational.fit_rational(r, r + 1.0, 1, 1)
    assert max(weights[1:]) == pytest.approx(1 / rational.LEAST_DENOMINATOR) == pytest.approx(1000)
