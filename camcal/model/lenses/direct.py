"""Direct solutions: models whose coefficients follow linearly from pairs of rays and pixels.

The equations are those of each model's source, in the coordinates of `start.rough_pinhole`; what they find is
brought into the model's gauge here. They minimise algebraic errors: `regress` goes on from them in px.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.model.lenses.start import rough_pinhole

Array = np.ndarray

#: rad; farther from the axis a ray's place on the plane z = 1 moves by more than tan² = 90 times its angle
WIDEST = np.deg2rad(84)
#: rounds in which origins (quadratically) and distortion centres (linearly, eight to 1e-8 px) settle
ROUNDS = 12
#: relative: an origin that moves no more has settled, to some hundred roundings
SETTLED = 1e-13
#: part of the picture's size: a distortion centre that moves no more has settled, to a millionth of a px
CENTRE_SETTLED = 1e-9
#: of a unit vector's x: rays above it are crossed with the y axis; one component at least is below .58, so that the
#: cross product is never short
NEAR_AXIS = 0.6


def monomials(p: Array, q: Array, powers: Sequence[tuple[int, int]]) -> Array:
    """pⁱ qʲ for each (i, j), (N, M)."""
    return np.stack([p**i * q**j for i, j in powers], -1)


def split_linear(m: Array) -> tuple[float, float, float, float]:
    """fx, fy, skew and turn b with M = [[1, 0], [b, 1]] K⁻¹, for the 2 x 2 part of K.

    M (2, 2) takes pixels to the plane z = 1.
    """
    fx = 1 / m[0, 0]
    turn = m[1, 0] * fx
    fy = m[0, 0] / np.linalg.det(m)
    return float(fx), float(fy), float(-m[0, 1] * fx * fy), float(turn)


def polynomial(rays: Array, uv: Array, order: int) -> tuple[Array, float, Array] | None:
    """The camera matrix, the turn, and coefficients (2, M) of orders 2 to n, of the two polynomials.

    x/z and y/z are polynomials of order n in (u, v): linear least squares. The gauge puts the origin where
    both are 0 and makes their linear part the identity up to the turn.

    Returns
    -------
    K (3, 3), turn, coefficients in the order of `Polynomial.powers`; None with too few rays.
    """
    powers = [(d - j, j) for d in range(order + 1) for j in range(d + 1)]
    front = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]) < WIDEST
    if front.sum() < len(powers):
        return None
    f, centre = rough_pinhole(rays, uv)
    target = rays[front, :2] / rays[front, 2:]
    # equations weighted so that rays near 90 degrees, whose tangents are huge, do not rule the rest
    weight = 1 / (1 + (target**2).sum(1, keepdims=True))
    matrix, turn = np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1.0]]), 0.0
    coefficients = np.zeros((len(powers), 2))
    for _ in range(ROUNDS):  # the same polynomials, written about their own zero
        p, q = _taken_off(matrix, uv[front])
        coefficients = np.linalg.lstsq(monomials(p, q, powers) * weight, target * weight, rcond=None)[0]
        moved = _recentred(matrix, coefficients[0], coefficients[[1, 2]].T)
        if moved is None:
            return None
        done = np.allclose(moved[0], matrix, rtol=SETTLED)
        matrix, turn = moved
        if done:
            break
    return matrix, turn, coefficients[3:].T


def _taken_off(matrix: Array, uv: Array) -> tuple[Array, Array]:
    m = (np.c_[uv, np.ones(len(uv))] @ np.linalg.inv(matrix).T)[:, :2]
    return m[:, 0], m[:, 1]


def _recentred(matrix: Array, constant: Array, linear: Array) -> tuple[Array, float] | None:
    """K and the turn after one Newton step towards the zero of the map, its linear part taken into K.

    None where the map turns the picture over, or its x axis back (rays of one plane determine no camera).
    """
    pixels = linear @ np.linalg.inv(matrix[:2, :2])
    if not (np.linalg.det(linear) > 0 and pixels[0, 0] > 0):
        return None
    shift = np.linalg.solve(linear, -constant)
    fx, fy, skew, turn = split_linear(pixels)
    centre = matrix[:2, :2] @ shift + matrix[:2, 2]
    return np.array([[fx, skew, centre[0]], [0, fy, centre[1]], [0, 0, 1]]), turn


def rational_function(rays: Array, uv: Array) -> tuple[Array, Array] | None:
    """The camera matrix and A (3, 6) in the gauge of `RationalFunction`.

    X x A χ = 0 in two directions across each ray, homogeneous in the 18 entries (Claus & Fitzgibbon 2005,
    section 2.2).

    Returns
    -------
    K (3, 3), A; None with too few rays, or where A turns the picture over.
    """
    if len(rays) < 9:  # two equations each for 18 entries
        return None
    f, centre = rough_pinhole(rays, uv)
    matrix = np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1.0]])
    powers = [(2, 0), (1, 1), (0, 2), (1, 0), (0, 1), (0, 0)]
    across = _across(rays)
    a = np.zeros((3, 6))
    for _ in range(ROUNDS):
        chi = monomials(*_taken_off(matrix, uv), powers)
        lines = np.einsum("knc,nm->kncm", across, chi).reshape(-1, 18)
        a = np.linalg.svd(lines, full_matrices=False)[2][-1].reshape(3, 6)
        a = a / a[2, 5]
        # the map (X / Z, Y / Z) at the origin: its value and its derivative
        linear = a[:2, 3:5] - np.outer(a[:2, 5], a[2, 3:5])
        moved = _recentred(matrix, a[:2, 5], linear)
        if moved is None:
            return None
        done = np.allclose(moved[0], matrix, rtol=SETTLED)
        matrix = moved[0]
        if done:
            break
    return matrix, a


def _across(rays: Array) -> Array:
    """Return two unit vectors (2, N, 3) normal to each ray and to each other."""
    helper = np.where(np.abs(rays[:, [0]]) < NEAR_AXIS, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(rays, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(rays, first)
    return np.stack([first, second / np.linalg.norm(second, axis=1, keepdims=True)])


def radial_depth(rays: Array, uv: Array, exponents: Sequence[int]) -> tuple[float, Array, Array] | None:
    """Focal length, centre (2,) and coefficients c of z = 1 + Σ c_e R^e for a lens symmetric about its axis.

    With ρ the distance from the centre in px, z (u - cx) = f x + Σ g_e x ρ^e and the same for v and y are
    linear in f, cx, cy and g_e = c_e f^(1 - e) (Fitzgibbon 2001, eq. 6, with the centre beside it). ρ follows
    the centre from round to round.

    Returns
    -------
    None where the equations give no positive focal length.
    """
    f, centre = rough_pinhole(rays, uv)
    x, y, z = rays.T
    scale = np.abs(uv - centre).max()
    found = np.zeros(len(exponents) + 3)
    for _ in range(ROUNDS):
        rho = np.linalg.norm(uv - centre, axis=1) / scale
        powers = rho[:, None] ** np.array(exponents, float)
        rows_u = np.c_[x, x[:, None] * powers, z, 0 * z]
        rows_v = np.c_[y, y[:, None] * powers, 0 * z, z]
        # errors in the direction of the ray times the distance: divided by it, they are angles
        weight = np.tile(1 / np.hypot(rho * scale, f), 2)
        lines, known = np.concatenate([rows_u, rows_v]), np.r_[z * uv[:, 0], z * uv[:, 1]]
        found = np.linalg.lstsq(lines * weight[:, None], known * weight, rcond=1e-14)[0]
        if not np.isfinite(found).all() or found[0] <= 0:
            return None
        settled = np.abs(found[-2:] - centre).max() < CENTRE_SETTLED * scale
        f, centre = float(found[0]), found[-2:]
        if settled:
            break
    e = np.array(exponents, float)
    return f, centre, found[1:-2] / f * (f / scale) ** e
