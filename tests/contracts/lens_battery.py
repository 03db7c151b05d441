"""What every lens model must fulfil: one function per property, each raising AssertionError.

What the battery does not prove: that a model is the one its source describes (agreement with cv2 and the
tests of single models do that), and anything about cameras far from the examples.
"""

from __future__ import annotations

import numpy as np

from camcal.model import lenses
from camcal.model.lenses import containment
from camcal.model.lenses.base import Lens
from camcal.model.lenses.forms import OpenCVForm
from camcal.model.lenses.radial import InverseRadialLens

Array = np.ndarray
Size = tuple[int, int]

#: px; the inverse is iterated to a few units in the last place, which at 5000 px is 1e-12
ROUND_TRIP = 1e-9
#: relative to the largest entry of a derivative; rounding in the differences below leaves about 1e-10
DERIVATIVE = 1e-8

#: central difference of eighth order: weights of f(+jh) - f(-jh), j = 1..4
_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


def difference(function, h: float) -> Array:
    """df/dt at 0 by central differences of eighth order: truncation h⁸, far below rounding eps / h."""
    return sum(w * (function(j * h) - function(-j * h)) for j, w in enumerate(_WEIGHTS, 1)) / h


def directions(lens: Lens, params: Array, size: Size, count: int = 60, seed: int = 0) -> Array:
    """Points (count, 3) at various depths whose images lie in the picture, chosen without the inverse."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, min(0.98 * lens.limit_angle(params), 2.0), 5000)
    turn = rng.uniform(0, 2 * np.pi, 5000)
    xyz = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], -1)
    uv, valid = lens.project(params, xyz)
    with np.errstate(invalid="ignore"):
        seen = valid & ((uv >= 0) & (uv <= np.array(size) - 1)).all(-1)
    assert seen.sum() >= count, f"only {seen.sum()} of 5000 directions project into the picture"
    return xyz[seen][:count] * rng.uniform(0.3, 30, (count, 1))


def random_camera(lens: Lens, seed: int, scale: tuple[float, float] = (0.5, 1.2)) -> tuple[Array, Size]:
    """Seeds 0 and 1: an example; others: with each distortion parameter scaled at random, within its bounds."""
    examples = lens.examples()
    params, size = examples[seed % len(examples)]
    if seed >= len(examples):
        params[lens._bend :] *= np.random.default_rng(seed).uniform(*scale, lens.size - lens._bend)
    low, high = np.array([(p.lower, p.upper) for p in lens.parameters]).T
    return np.clip(params, low, high), size


def pixels(size: Size, columns: int = 9, rows: int = 7) -> Array:
    """A grid of pixels (columns * rows, 2) over the picture, its corners and borders included."""
    u, v = np.linspace(0, size[0] - 1, columns), np.linspace(0, size[1] - 1, rows)
    return np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)


# ---------------------------------------------------------------------------------------------- form
def check_parameters(lens: Lens) -> None:
    """Names are unique and known to their groups; neutral values are finite and within bounds."""
    expected = ("fx", "fy", "cx", "cy", "skew") if lens.has_skew else ("fx", "fy", "cx", "cy")
    assert lens.names[: len(expected)] == expected
    assert len(set(lens.names)) == lens.size == len(lens.neutral)
    assert all(p.group in ("focal", "principal", "skew", "distortion") for p in lens.parameters)
    assert all(p.lower <= p.neutral <= p.upper and np.isfinite(p.neutral) for p in lens.parameters)
    assert set(lens.default_fixed) <= set(lens.names)
    assert lenses.make(lens.name, lens.has_skew) == lens
    for params, size in lens.examples():
        assert params.shape == (lens.size,) and len(size) == 2
        assert lens.from_values(dict(zip(lens.names, params, strict=True))).tolist() == params.tolist()
        for shape in lens.shapes(*lens.unproject(params, pixels(size))[:1], pixels(size), size):
            assert set(shape) <= set(lens.names)


def check_shapes(lens: Lens, params: Array, size: Size) -> None:
    """Arrays of any shape go through; none at all, too; a NaN stays one; scale does not matter."""
    xyz = directions(lens, params, size, 12)
    uv, valid = lens.project(params, xyz.reshape(3, 4, 3))
    assert uv.shape == (3, 4, 2) and valid.shape == (3, 4) and valid.all()
    np.testing.assert_allclose(lens.project(params, 1e3 * xyz)[0], uv.reshape(-1, 2), rtol=0, atol=ROUND_TRIP)
    ray, valid = lens.unproject(params, uv)
    assert ray.shape == (3, 4, 3) and valid.all()
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1, rtol=0, atol=1e-14)
    assert lens.project(params, np.zeros((0, 3)))[0].shape == (0, 2)
    assert lens.unproject(params, np.zeros((0, 2)))[0].shape == (0, 3)
    xyz[0, 1] = np.nan
    uv, valid = lens.project(params, xyz)
    assert not valid[0] and np.isnan(uv[0]).all() and valid[1:].all()
    assert not lens.unproject(params, np.array([[np.nan, 3.0]]))[1].any()


# ---------------------------------------------------------------------------------------------- derivatives
def check_jacobians(lens: Lens, params: Array, xyz: Array) -> None:
    """Derivatives with respect to the point and to each parameter, against differences."""
    uv, d_xyz, d_params, valid = lens.jacobians(params, xyz)
    assert valid.all()
    np.testing.assert_allclose(uv, lens.project(params, xyz)[0], rtol=0, atol=ROUND_TRIP)
    depth = np.linalg.norm(xyz, axis=1)[:, None]
    for i in range(3):
        step = depth * np.eye(3)[i]
        numeric = difference(lambda t, step=step: lens.project(params, xyz + t * step)[0], 1e-4)
        _close(d_xyz[:, :, i] * depth, numeric, np.abs(d_xyz * depth[:, :, None]).max(), f"d/d{'xyz'[i]}")
    for what, unit in _parameter_directions(lens):
        analytic = d_params @ unit
        # a step that moves the picture by thousandths of a px: neither the border of the domain nor a knot of
        # a spline, where its third derivative jumps, should pass over a point
        largest = np.abs(analytic).max()
        size = 2 / largest if largest >= 1 else 0.05
        numeric = difference(lambda t, step=size * unit: lens.project(params + t * step, xyz)[0], 1e-3)
        _close(analytic * size, numeric, 2.0, f"d/d{what}")


def _parameter_directions(lens: Lens) -> list[tuple[str, Array]]:
    """Each parameter by itself; of many, the first and random mixtures of all, which miss no wrong one."""
    single = [(name, np.eye(lens.size)[i]) for i, name in enumerate(lens.names)]
    if lens.size <= 25:
        return single
    mixtures = np.random.default_rng(2).normal(size=(6, lens.size))
    mixtures[:, :9] = 0
    return single[:9] + [(f"mixture {i}", m) for i, m in enumerate(mixtures)]


def _close(analytic: Array, numeric: Array, scale: float, what: str) -> None:
    error = np.abs(analytic - numeric).max() / scale
    assert error < DERIVATIVE, f"{what}: off by {error:.2g} of the largest entry"


def check_euler(lens: Lens, params: Array, size: Size) -> None:
    """A point moved along its ray does not move in the picture: d(u, v)/d(xyz) · xyz = 0."""
    xyz = directions(lens, params, size)
    _, d_xyz, _, _ = lens.jacobians(params, xyz)
    along = np.einsum("nij,nj->ni", d_xyz, xyz)
    scale = np.abs(d_xyz).max(axis=(1, 2)) * np.linalg.norm(xyz, axis=1)
    assert (np.abs(along).max(1) <= 1e-12 * scale).all(), "the derivative along the ray is not 0"


def check_linearise(lens: Lens, params: Array, size: Size) -> None:
    """`linearise` fills strided (V, ., 2, N) with what `jacobians` says; False outside the domain."""
    xyz = directions(lens, params, size, 42).reshape(3, 14, 3)
    block = np.full((3, lens.size + 7, 2, 14), np.nan)
    x, y, z = (np.ascontiguousarray(xyz[..., i]) for i in range(3))
    uv, d_xyz, d_params = block[:, -1], block[:, lens.size + 3 : lens.size + 6], block[:, : lens.size]
    with np.errstate(all="ignore"):
        assert lens.linearise(params, x, y, z, uv, d_xyz, d_params) is True
    flat = lens.jacobians(params, xyz.reshape(-1, 3))
    np.testing.assert_array_equal(x, xyz[..., 0])
    for got, want in zip((uv, d_xyz, d_params), flat[:3], strict=True):
        got = np.moveaxis(got, (0, -1), (0, 1)).reshape(42, -1, 2) if got.ndim == 4 else got
        want = np.swapaxes(want, 1, 2) if want.ndim == 3 else want.reshape(3, 14, 2).swapaxes(1, 2)
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-9)
    x[1, 3], y[1, 3], z[1, 3] = 1e-12, 0, -1
    with np.errstate(all="ignore"):
        assert not lens.linearise(params, x, y, z, uv, d_xyz, d_params), "a point straight behind passed"


# ------------------------------------------------------------------------------------ inverse and domain
def check_round_trip(lens: Lens, params: Array, size: Size) -> None:
    """Every pixel of the picture has a ray, which projects back to it."""
    uv = pixels(size)
    ray, valid = lens.unproject(params, uv)
    assert valid.all(), f"no ray for the pixels {uv[~valid][:3].tolist()}"
    back, valid = lens.project(params, ray)
    assert valid.all(), f"the rays of {uv[~valid][:3].tolist()} do not project"
    error = np.abs(back - uv).max()
    assert error < ROUND_TRIP, f"pixel -> ray -> pixel is off by {error:.2g} px"


def check_whole_sphere(lens: Lens, params: Array, size: Size) -> None:
    """Whatever direction is said to project does so as the only one: its pixel leads back to it.

    Within three picture sizes of the picture: farther out, where polynomials of thousands of px meet, a model
    may give no ray back, but a point that lands in or near the picture must belong there.
    """
    rng = np.random.default_rng(1)
    xyz = rng.normal(size=(4000, 3))
    xyz /= np.linalg.norm(xyz, axis=1)[:, None]
    limit = lens.limit_angle(params)
    angle = np.arccos(np.clip(xyz[:, 2], -1, 1))
    # at the very fold the inverse loses half of its digits
    xyz = xyz[(angle < 0.97 * limit) | (angle > 1.03 * limit)]
    uv, valid = lens.project(params, xyz)
    assert np.isnan(uv[~valid]).all() and np.isfinite(uv[valid]).all()
    near = (np.abs(np.nan_to_num(uv, nan=np.inf) - np.array(size) / 2) < 3 * np.array(size)).all(1)
    assert near.sum() >= 40
    ray, back = lens.unproject(params, uv[near])
    assert back.all(), f"no ray back for the direction {xyz[near][~back][:1].tolist()}"
    error = np.abs(ray - xyz[near]).max()
    assert error < 1e-9, f"direction -> pixel -> direction is off by {error:.2g} rad"


def check_outside(lens: Lens, params: Array, size: Size) -> None:
    """Straight behind is outside; so is what lies beyond the limit; the limit itself covers the picture."""
    limit = lens.limit_angle(params)
    assert 0 < limit <= np.pi
    behind = np.array([[0.0, 0, -1], [1e-9, 0, -1], [0, -1e-9, -2]])
    uv, valid = lens.project(params, behind)
    assert not valid.any() and np.isnan(uv).all(), "a point straight behind the camera projects"
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    for factor, wanted in ((0.999, True), (1.001, False)):
        angle = factor * limit
        if angle >= np.pi:
            continue
        ring = np.stack(
            [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), 0 * turn + np.cos(angle)], -1
        )
        uv, valid = lens.project(params, ring)
        if wanted:
            assert valid.all() and np.isfinite(uv).all(), "outside although within the limit"
        else:
            assert not valid.all(), "the limit is not where the domain ends"
    check_linearise_outside(lens, params)
    far = np.array(size) * np.array([[1e3, 1e3], [-1e3, 1e3]])
    ray, valid = lens.unproject(params, far)
    back, again = lens.project(params, ray)
    # lenses that see the whole sphere map a pixel this far to the direction straight behind, up to rounding
    behind_it = np.arctan2(np.hypot(ray[:, 0], ray[:, 1]), ray[:, 2]) > np.pi - 1e-6
    assert again[valid & ~behind_it].all(), "a ray of a pixel far outside is not projected"
    assert np.abs(back - far)[valid & again].max(initial=0) < 1e-3


def check_linearise_outside(lens: Lens, params: Array) -> None:
    """`linearise` turns down each point by itself that `project` does not take, also beyond a second fold."""
    xyz = np.random.default_rng(3).normal(size=(200, 3))
    uv, d_params = np.empty((1, 2, 1)), np.empty((1, lens.size, 2, 1))
    with np.errstate(all="ignore"):
        _, valid = lens.project(params, xyz)
        for x, y, z in xyz[~valid][:30].reshape(-1, 3, 1, 1):
            ok = lens.linearise(params, x, y, z, uv, np.empty((1, 3, 2, 1)), d_params)
            assert not ok, f"({x[0, 0]:.3f}, {y[0, 0]:.3f}, {z[0, 0]:.3f}) has left the domain unnoticed"


def check_centre(lens: Lens, params: Array) -> None:
    """On the axis and next to it all is smooth and finite."""
    xyz = np.array([[0.0, 0, 1], [0, 0, 20], [1e-9, 0, 1], [0, -1e-12, 1], [1e-160, 1e-200, 1]])
    uv, d_xyz, d_params, valid = lens.jacobians(params, xyz)
    assert valid.all() and all(np.isfinite(a).all() for a in (uv, d_xyz, d_params))
    check_jacobians(lens, params, xyz[[0, 2, 4]])
    ray, valid = lens.unproject(params, uv)
    assert valid.all()
    np.testing.assert_allclose(ray, xyz / np.linalg.norm(xyz, axis=1)[:, None], rtol=0, atol=1e-12)


# ---------------------------------------------------------------------------------------------- where it ends
#: coefficients without which a lens is symmetric about its axis, by the first letters of their names
_ASYMMETRIC = ("p1", "p2", "p3", "p4", "tau", "xc", "yc")
#: rad; at a fold the radius is flat, so that rounding hides where it turns to sqrt(1e-15), and a few times that
LIMIT = 1e-6


def check_limit(lens: Lens, params: Array) -> None:
    """The domain ends where sampling finds that the image radius no longer grows with the angle; not before, not after.

    For a lens that states the ray of a pixel: where the angle no longer grows with the radius. The asymmetric terms
    are left out, because the domain is that of the radial part.
    """
    params = params.copy()
    for i, name in enumerate(lens.names):
        if name.startswith(_ASYMMETRIC) or (name in ("s1", "s2", "s3", "s4") and "k1" in lens.names):
            params[i] = 0.0
    if isinstance(lens, InverseRadialLens):
        reach = _end_of_growth(
            lambda t: _ray_angle(lens, params, np.tan(t)), np.arctan(_widest_radius(lens, params))
        )
        wanted = float(_ray_angle(lens, params, np.tan(np.array([reach])))[0])
    else:
        wanted = _end_of_growth(lambda angle: _image_radius(lens, params, angle), np.pi)
    assert abs(lens.limit_angle(params) - wanted) < LIMIT, (
        f"the domain ends at {np.degrees(lens.limit_angle(params)):.6f} degrees, the lens at {np.degrees(wanted):.6f}"
    )


def _widest_radius(lens: Lens, params: Array) -> float:
    """How far out the curve is defined: `reach` of a spline; without one 1e9, which is tan of nearly 90 degrees."""
    return float(params[lens.index("reach")]) if "reach" in lens.names else 1e9


def _image_radius(lens: Lens, params: Array, angle: Array) -> Array:
    """Signed image radius, in focal lengths, of rays at angles from the axis, without a look at the domain."""
    with np.errstate(all="ignore"):
        return (lens.forward(params, np.sin(angle), 0 * angle, np.cos(angle))[0] - params[2]) / params[0]


def _ray_angle(lens: Lens, params: Array, radius: Array) -> Array:
    """Angle from the axis of the rays of pixels at distances in focal lengths, without a look at the domain."""
    with np.errstate(all="ignore"):
        x, _, z, _ = lens.backward(params, params[2] + params[0] * radius, params[3] + 0 * radius)
    return np.arctan2(x, z)


def _end_of_growth(curve, top: float) -> float:
    """The first place in (0, top) at which a curve does not grow, by sampling ever more closely; top without one."""
    low, high = 0.0, top
    for _ in range(4):
        t = np.linspace(low, high, 4001)
        grows = np.diff(curve(t)) > 0
        if grows.all():
            return high
        i = int(grows.argmin())
        low, high = t[max(i - 1, 0)], t[i + 1]
    return 0.5 * (low + high)


# ---------------------------------------------------------------------------------------------- relations
CURVES = {"perspective": np.tan, "equidistant": lambda angle: angle}


def check_neutral(lens: Lens) -> None:
    """Without distortion the lens is a pinhole camera, or the equidistant one where it says so."""
    curve = CURVES[lens.neutral_curve]
    for params, size in lens.examples():
        plain = lens.neutral
        plain[: 5 if lens.has_skew else 4] = params[: 5 if lens.has_skew else 4]
        xyz = directions(lens, plain, size)
        angle, radius = np.arctan2(np.hypot(xyz[:, 0], xyz[:, 1]), xyz[:, 2]), np.hypot(xyz[:, 0], xyz[:, 1])
        m = xyz[:, :2] / radius[:, None] * curve(angle)[:, None]
        want = np.c_[m, np.ones(len(m))] @ lens.matrix(plain)[:2].T
        np.testing.assert_allclose(lens.project(plain, xyz)[0], want, rtol=0, atol=ROUND_TRIP)
        if lens.neutral_curve == "perspective":
            _check_start(lens, plain, xyz[angle < np.pi / 4])


def _check_start(lens: Lens, plain: Array, xyz: Array) -> None:
    """A start from a camera matrix is the lens without distortion; near it where the derivative is 0 there."""
    start = lens.from_matrix(lens.matrix(plain))
    distortion = lens.jacobians(start, xyz)[2][:, :, lens._bend :]
    if distortion.size:
        assert distortion.any(), "a refinement would stay at this start"
    moved = start != plain
    if moved.any():
        assert not lens.jacobians(plain, xyz)[2][:, :, moved].any(), "a start with distortion, without need"
        assert np.abs(lens.project(start, xyz)[0] - lens.project(plain, xyz)[0]).max() < 0.0101 * plain[0]


def check_embedding(outer: Lens, inner: Lens, cameras: int = 6) -> bool:
    """Whether `outer` contains `inner`; if so, random cameras of `inner` project to the same pixels in `outer`."""
    if not containment.contains(outer, inner):
        return False
    for seed in range(cameras):
        params, size = random_camera(inner, seed)
        found = containment.embed(outer, inner, params)
        assert found is not None, f"{outer} contains {inner}, but not its camera {params.tolist()}"
        xyz = directions(inner, params, size)
        got, valid = outer.project(found, xyz)
        assert valid.all(), f"a point of {inner} is outside the domain of {outer}"
        error = np.abs(got - inner.project(params, xyz)[0]).max()
        assert error < ROUND_TRIP, f"{inner} is embedded in {outer} with a difference of {error:.2g} px"
    return True


def check_prior(lens: Lens, params: Array) -> None:
    """The Jacobian of the model's own regularisation, against differences."""
    if lens.prior(params) is None:
        return
    residuals, jacobian = lens.prior(params)
    assert jacobian.shape == (len(residuals), lens.size)
    for i in range(lens.size):
        unit = np.eye(lens.size)[i]
        numeric = difference(lambda t, unit=unit: lens.prior(params + t * unit)[0], 1e-3)
        np.testing.assert_allclose(jacobian[:, i], numeric, rtol=0, atol=DERIVATIVE * np.abs(jacobian).max())


def check_opencv(lens: Lens, params: Array, size: Size) -> None:
    """cv2 projects the camera that it is handed the same way."""
    form = lens.opencv(params)
    if form is None:
        return
    xyz = directions(lens, params, size)
    if form.function != "omnidir.calibrate":
        xyz = xyz[xyz[:, 2] > 0]  # cv2.fisheye divides by z: its lens ends at 180 degrees
    error = np.abs(cv2_project(lens, params, form, xyz) - lens.project(params, xyz)[0]).max()
    assert error < ROUND_TRIP, f"cv2 projects {error:.2g} px elsewhere"


def cv2_project(lens: Lens, params: Array, form: OpenCVForm, xyz: Array) -> Array:
    """Project (N, 3) with cv2's function for this kind of camera; the pinhole function has no skew."""
    import cv2

    k, zero = lens.matrix(params), np.zeros(3)
    points, distortion = np.ascontiguousarray(xyz).reshape(-1, 1, 3), np.asarray(form.distortion, float)
    if form.function == "fisheye.calibrate":
        alpha = k[0, 1] / k[0, 0]
        out = cv2.fisheye.projectPoints(points, zero, zero, k, distortion, alpha=alpha)[0]
    elif form.function == "omnidir.calibrate":
        out = cv2.omnidir.projectPoints(points, zero, zero, k, form.xi, distortion)[0]
    else:
        assert form.function == "calibrateCamera"
        # skew = 0 for cv2; its effect is added: u += skew (v - cy) / fy
        plain = np.array([[k[0, 0], 0, k[0, 2]], k[1], k[2]])
        out = cv2.projectPoints(points, zero, zero, plain, distortion)[0]
        out = out.reshape(-1, 2)
        out = np.c_[out[:, 0] + k[0, 1] * (out[:, 1] - k[1, 2]) / k[1, 1], out[:, 1]]
    return out.reshape(-1, 2)


def check_stacked(lens: Lens) -> None:
    """`linearise` with the parameters of each view's own camera gives what it gives view by view, to the last bit."""
    params = np.array([p for p, _ in lens.examples()] * 3)
    params[2:4] *= 1.1
    rng, size = np.random.default_rng(2), lens.size
    xyz = rng.uniform(-0.4, 0.4, (3, len(params), 14)) + np.array([0, 0, 1])[:, None, None]
    xyz[2, 1, 3] = -1.0  # one behind the camera, one beyond a fold if there is one
    xyz[0, 3, 5] = 1e3
    together, alone = np.zeros((2, len(params), size + 5, 2, 14))

    def fill(own: Array, rows: Array, points: Array) -> object:
        with np.errstate(all="ignore"):
            return lens.linearise(own, *points, rows[:, 0], rows[:, 1:4], rows[:, 4 : 4 + size])

    stacked = np.ascontiguousarray(params.T)[..., None]
    inside = np.ravel(fill(stacked, together, xyz))
    each = [fill(p, alone[v : v + 1], xyz[:, v : v + 1]) for v, p in enumerate(params)]
    assert inside.tolist() == [bool(e) for e in each] and not inside[1]
    np.testing.assert_array_equal(together[inside], alone[inside])
    stacked[0, 0] = -1.0  # outside the bounds
    assert not np.ravel(fill(stacked, together, xyz))[0]


def check_everything(lens: Lens) -> None:
    """The whole battery on one model and its examples, the end of its domain included."""
    check_parameters(lens)
    check_neutral(lens)
    if lens.stackable:
        check_stacked(lens)
    for params, size in lens.examples():
        for check in (
            check_shapes, check_euler, check_linearise, check_round_trip, check_whole_sphere,
            check_outside, check_opencv,
        ):  # fmt: skip
            check(lens, params, size)
        check_jacobians(lens, params, directions(lens, params, size, 40))
        check_centre(lens, params)
        check_prior(lens, params)
        check_limit(lens, params)
