"""A lens with distortion from two views of unknown points: fundamental matrices of lifted pixels.

With lifted pixels χ = (u², uv, v², u, v, 1) and the rays d ~ A χ of a rational lens (`camcal.start.claus`), the
images of a point in two views by one camera satisfy

    χ2ᵀ G χ1 = 0,  G = Aᵀ F A,  (6, 6), of rank 2                                                          (1)

(D. Claus, A. Fitzgibbon, A rational function lens distortion model for general cameras, CVPR 2005, section 4). A
division model of one term, d = (u, v, 1 + λ ρ²) (A. Fitzgibbon, Simultaneous linear estimation of multiple view
geometry and lens distortion, CVPR 2001), is the case of (1) with a known A for each λ.

The linear estimate of the 36 entries of G is exact for exact pixels, but useless at 0.03 px of noise (f 600 px, 600
matches). Instead, A itself is estimated: the Sampson distances in px of the matches that agree are minimised over
A = [Q, I], with the best F for each pair. The form [Q, I], rays of a pinhole camera to first order about the centre,
fixes the homography that F leaves undetermined. The start is the division model, whose samples need eight matches.
"""

from __future__ import annotations

import numpy as np

from camcal.least_squares import Differences, Options, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes import epipolar
from camcal.start.claus import FLATTEST, derivatives, lifted
from camcal.start.of_rays import camera_of

#: λ tried, in half diagonals: from a fisheye lens (-0.8 bends the corner's ray by 30 degrees or more) to
#: pincushion; neighbouring values are close enough for the adjustment to converge
SHAPES = (-0.8, -0.6, -0.45, -0.3, -0.2, -0.12, -0.06, 0.0, 0.06, 0.12)
#: pairs that are used
PAIRS = 6
#: a distortion is adopted if it reduces the median Sampson distance by this fraction: one parameter does as much by
#: chance with fifty matches
GAIN = 0.05
#: parameters of the full model beyond the single one of the division model, and the F value above which their reduction
#: of the sum of squares is not chance: the 99.9 % quantile for 200 or more degrees of freedom
MORE, F_WORTH = 8, 3.3
#: of a fit of the rays: limit of evaluations; finite-difference step in half diagonals; relative decrease of the sum of
#: squares at which it ends
ITERATIONS, STEP, SETTLED = 20, 1e-5, 1e-5
#: of the median gradient: lower limit of the divisor of distances, which is 0 at an epipole
LEAST_GRADIENT = 1e-3


@dataclass(frozen=True)
class Rational:
    """Rays A χ (3, 6) of pixels in half diagonals about the image's centre, and the model that they come from."""

    rays: Array
    kind: str  #: pinhole, division or rational


def of_matches(matches: list[tuple[Array, Array]], size: tuple[int, int], seed: int = 0) -> Rational:
    """The rational lens with which most matches agree.

    Parameters
    ----------
    matches : list of pairs of (N, 2) arrays, px
        Of two views each, by one camera; some may be wrong.
    size : (width, height)

    Returns
    -------
    Rational
        `kind` is pinhole if no distortion is significant.
    """
    unit = [(_unit(a, size), _unit(b, size)) for a, b in matches[:PAIRS]]
    scale = float(np.hypot(*size)) / 2
    tried = {shape: [_robust(division(shape), *pair, scale, seed) for pair in unit] for shape in SHAPES}
    # the product of medians, as each pair has its own noise and share of wrong matches
    score = {shape: float(np.exp(np.mean([np.log(m) for m, _ in each]))) for shape, each in tried.items()}
    best = min(score, key=lambda s: score[s])
    if score[best] > (1 - GAIN) * score[0.0]:
        return Rational(division(0.0), "pinhole")
    agreed = [(a[g], b[g]) for (a, b), (_, g) in zip(unit, tried[best], strict=True)]
    single = _least_squares(division(best), division(1.0)[None, :, :3], agreed)
    full = _least_squares(single, np.eye(9).reshape(9, 3, 3), agreed)
    squares = [float(np.square(_off(rays, agreed)).sum()) for rays in (single, full)]
    freedom = sum(len(a) - epipolar.FREEDOM for a, _ in agreed) - (1 + MORE)
    if freedom > 0 and (squares[0] - squares[1]) / MORE > F_WORTH * squares[1] / freedom:
        return Rational(full, "rational")
    return Rational(single, "division")


def division(shape: float) -> Array:
    """A (3, 6) of a division model of one term."""
    return np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 0, 0, 1.0, 0], [shape, 0, shape, 0, 0, 1.0]])


def _unit(uv: Array, size: tuple[int, int]) -> Array:
    return np.asarray((uv - (np.array(size) - 1) / 2) / (np.hypot(*size) / 2))


def _robust(rays: Array, first: Array, second: Array, scale: float, seed: int) -> tuple[float, Array]:
    """The median distance of matches in the pictures, half diagonals, and which of them agree."""
    d1, d2 = (lifted(q) @ rays.T for q in (first, second))
    ahead = (d1[:, 2] > FLATTEST) & (d2[:, 2] > FLATTEST)
    if ahead.sum() < 2 * epipolar.LEAST:
        return np.inf, np.zeros(len(first), bool)
    a, b = (d[ahead] / d[ahead, 2:] for d in (d1, d2))
    f, good = epipolar.agreeing(a, b, epipolar.LEAST_FAR / scale, seed)
    off = np.abs(distances(rays.T @ f @ rays, first[ahead], second[ahead]))
    agree = np.zeros(len(first), bool)
    agree[np.flatnonzero(ahead)[good]] = True
    return float(np.median(off)) + 1e-12, agree


def distances(g: Array, first: Array, second: Array) -> Array:
    """Sampson distances (N,) of matches (N, 2) in the pictures as taken, for a lifted matrix (6, 6)."""
    c1, c2 = lifted(first), lifted(second)
    return np.asarray(np.einsum("ni,ij,nj->n", c2, g, c1) / np.maximum(_gradient(g, first, second), 1e-300))


def _gradient(g: Array, first: Array, second: Array) -> Array:
    c1, c2 = lifted(first), lifted(second)
    parts = [((d @ g) * c1).sum(1) for d in derivatives(second)]
    parts += [((c2 @ g) * d).sum(1) for d in derivatives(first)]
    return np.asarray(np.sqrt(np.square(parts).sum(0)))


def _off(rays: Array, matches: list[tuple[Array, Array]]) -> Array:
    """The distances of all matches with the F of each pair that fits them best."""
    parts = []
    for first, second in matches:
        d1, d2 = (lifted(q) @ rays.T for q in (first, second))
        f = epipolar.linear(d1, d2)
        for _ in range(epipolar.WEIGHTINGS):
            size = _gradient(rays.T @ f @ rays, first, second)
            f = epipolar.linear(d1, d2, 1 / np.maximum(size, LEAST_GRADIENT * float(np.median(size))))
        parts.append(distances(rays.T @ f @ rays, first, second))
    return np.concatenate(parts)


def _least_squares(rays: Array, along: Array, matches: list[tuple[Array, Array]]) -> Array:
    """The A (3, 6) that minimises the distances, over steps of its quadratic part along (K, 3, 3)."""
    steps = np.concatenate([along, np.zeros_like(along)], 2)

    def moved(x: Array) -> Array:
        return np.asarray(rays + np.einsum("k,kij->ij", x, steps))

    problem = Differences(lambda x: _off(moved(x), matches), STEP)
    return moved(minimise(problem, np.zeros((1, len(steps))), Options(SETTLED, ITERATIONS)).state[0])


def undistorted(found: Rational, uv: Array, size: tuple[int, int]) -> Array:
    """Pixels (N, 2) of a pinhole camera for the same rays; NaN beyond 84 degrees at f = half the diagonal."""
    d = lifted(_unit(uv, size)) @ found.rays.T
    d[d[:, 2] <= FLATTEST] = np.nan
    return np.asarray((np.array(size) - 1) / 2 + np.hypot(*size) / 2 * d[:, :2] / d[:, 2:])


def as_camera(found: Rational, focal: float, size: tuple[int, int]) -> Camera:
    """The division camera of three terms nearest to the rays over the picture, for a focal length in px."""
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 25), np.linspace(0, size[1] - 1, 19))
    uv = np.c_[u.ravel(), v.ravel()]
    flat = (undistorted(found, uv, size) - (np.array(size) - 1) / 2) / focal
    ahead = np.isfinite(flat).all(1)
    return camera_of(np.c_[flat, np.ones(len(flat))][ahead], uv[ahead], size)
