"""Lenses that state the ray of a pixel: where their domain ends."""

import numpy as np
import pytest

from camcal.model import lenses

#: between the spokes on which the extent is looked for, as well as on them
TURN = np.linspace(0, 2 * np.pi, 53)


def cubic(c):
    """(X, Y) = (p, q) (1 - c (p² + q²)): folds at the radius sqrt(1 / (3 c))."""
    lens = lenses.make("bicubic")
    values = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    return (
        lens,
        lens.from_values(values | dict.fromkeys(("a30", "a12", "b21", "b03"), -c)),
        np.sqrt(1 / (3 * c)),
    )


def division(c):
    """(X, Y, Z) = (p, q, 1 - c (p² + q²)): never folds; 90 degrees at the radius sqrt(1 / c)."""
    lens = lenses.make("rational-function")
    return lens, lens.from_values({"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "c1": -c, "c3": -c})


def ring(radius):
    return np.c_[320 + 500 * radius * np.cos(TURN), 240 + 500 * radius * np.sin(TURN)]


@pytest.mark.parametrize("c", [0.05, 0.3, 2.0])
def test_the_domain_ends_at_the_fold(c):
    lens, params, fold = cubic(c)
    for radius, inside in ((0.997 * fold, True), (1.001 * fold, False), (1.5 * fold, False)):
        ray, valid = lens.unproject(params, ring(radius))
        assert (valid == inside).all(), radius
        if inside:
            uv, seen = lens.project(params, ray)
            assert seen.all()
            np.testing.assert_allclose(uv, ring(radius), rtol=0, atol=1e-8)


def test_rays_behind_the_camera():
    lens, params = division(0.3)
    ray, valid = lens.unproject(params, ring(3.0))
    assert valid.all() and (ray[:, 2] < -0.3).all()
    np.testing.assert_allclose(lens.project(params, ray)[0], ring(3.0), rtol=0, atol=1e-8)
    assert not lens.unproject(params, ring(1.1 * lens.farthest(params[4:])))[1].any()


def test_no_second_pixel_beyond_the_fold():
    """Directions that the curve reaches again beyond its fold have the pixel before it, or none."""
    lens, params, fold = cubic(0.3)
    peak = fold * (1 - 0.3 * fold**2)
    xyz = np.c_[np.linspace(-1.5 * peak, 1.5 * peak, 200), np.zeros(200), np.ones(200)]
    uv, valid = lens.project(params, xyz)
    assert valid[np.abs(xyz[:, 0]) < 0.95 * peak].all() and not valid[np.abs(xyz[:, 0]) > peak].any()
    assert (np.abs(uv[valid, 0] - 320) < 500 * fold).all()


@pytest.mark.parametrize("name", ["bicubic", "polynomial:5", "spline:6x5", "rational-function"])
def test_derivatives_of_rays_beside_differences(name):
    lens = lenses.make(name)
    params, size = lens.examples()[0]
    uv = np.random.default_rng(0).uniform(40, np.array(size) - 40.0, (25, 2))
    ray, by_uv, by_params, valid = lens.rays_with_derivatives(params, uv)
    assert valid.all()
    np.testing.assert_allclose(ray, lens.unproject(params, uv)[0], atol=1e-14)

    def difference(change):
        step, vector = change
        moved = [
            lens.unproject(params + s * step * vector[2:], uv + s * step * vector[:2])[0] for s in (1, -1)
        ]
        return (moved[0] - moved[1]) / (2 * step)

    axes = np.eye(2 + len(params))
    for at, exact in ((range(2), by_uv), (range(2, 2 + len(params)), by_params)):
        found = np.stack([difference((1e-6, axes[i])) for i in at], 2)
        # differences of rays near 1 with a step of 1e-6 are good to 1e-10, beside curvature of the same order
        np.testing.assert_allclose(found, exact, atol=1e-8 * max(1.0, float(np.abs(exact).max())))
