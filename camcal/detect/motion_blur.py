"""Motion blur: its extent and direction, from the blur across edges of many directions."""

from __future__ import annotations

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import LEAST_BLUR, MOST_BLUR, SETTLED, SLIGHT
from camcal.detect.saddle import HALF
from camcal.detect.windows import Windows, cut
from camcal.geometry.numbers import distinct
from camcal.least_squares import Normal, Options, Small, minimise, negligible

Array = np.ndarray

MOST_CORNERS = 24  #: of a picture; their blurs scatter by 2 %
STEPS = 10  #: usual fits take 3 to 5
#: of the blur; a Gauss-Newton step of that length ends within half its square of the minimum, a quarter of the scatter
#: of the blurs
NEAR = 0.1
LARGEST = 12  #: px; half the side of the largest window
LEAST_VARIANCE = 0.05  #: of the mean; a smaller variance along the narrow axis is noise


def corner_blurs(gray: Array, uv: Array, params: Array, sides: Array) -> tuple[Array, Array]:
    """The variance of the blur along the normals of the two edges of some corners, and their covariance.

    A blur of covariance S turns the picture sgn(u1) sgn(u2) of a corner into E[sgn sgn] of a bivariate normal
    distribution with variances n1ᵀ S n1, n2ᵀ S n2 and covariance n1ᵀ S n2; to first order in the latter

        erf(u1 / √2 s1) erf(u2 / √2 s2) + n1ᵀ S n2 erf'(u1 / √2 s1) erf'(u2 / √2 s2)

    (the tetrachoric series, Pearson 1901). The two variances alone do not reveal motion along the squares' diagonal.
    The three numbers are fitted, starting from the isotropic blur of the corner's fit.

    Parameters
    ----------
    gray : (height, width) array
    uv : (K, 2) array
        Corners, px.
    params : (K, 7) array
        Parameters of their fits, in the order of `edge_model`.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.

    Returns
    -------
    directions : (N, 3, 2) array
        Directions of the normals (n, m) of each product, radians: (n1, n1), (n2, n2), (n1, n2).
    products : (N, 3) array
        nᵀ S m, px².
    """
    some = distinct(np.linspace(0, len(uv) - 1, MOST_CORNERS).astype(int))
    uv, p, sides = uv[some], params[some], sides[some]
    windows = cut(gray, uv, sides, HALF, 2.5 * p[:, model.BLUR] + 1, LARGEST)
    normals = p[:, [model.ANGLE1, model.ANGLE2]]
    n = np.stack([np.cos(normals), np.sin(normals)], -1).astype(np.float32)
    u = np.einsum("kcp,kic->ikp", windows.q, n)
    common = p[:, model.BLUR]
    start = np.stack([common, common, np.einsum("ki,ki->k", n[:, 0], n[:, 1]) * common**2], 1)
    found = _fitted(_Blurs(windows, u, p), start)
    blurs, mixed = found[:, :2], found[:, 2]
    pairs = np.stack([normals[:, [0, 0]], normals[:, [1, 1]], normals], 1)
    return pairs, np.c_[blurs**2, mixed]


def _fitted(problem: _Blurs, start: Array) -> Array:
    """The three numbers (K, 3) of each corner: by one step if all steps are short, otherwise by iteration."""
    with np.errstate(over="ignore", invalid="ignore"):  # infinite steps are not short
        equations = problem.linearise(start, np.arange(problem.count))
        step, _ = problem.solve(start, equations, np.full(problem.count, SLIGHT))
        blurs = start[:, :2]
        length = np.c_[np.abs(step[:, :2]) / blurs, np.abs(step[:, 2]) / blurs.prod(1)]
    if (length <= NEAR).all():
        return problem.retract(start, step)
    tolerance = negligible(SETTLED, problem.windows.counts.sum(1), 3)
    return np.asarray(minimise(problem, start, Options(tolerance, STEPS)).state)


class _Blurs(Small):
    """Corners with a blur across each edge and a covariance of the two, (K, 3); all else is fixed."""

    def __init__(self, windows: Windows, u: Array, params: Array):
        self.windows, self.u, self.count = windows, u, len(params)
        self.contrast, self.offset = (
            params[:, i, None].astype(np.float32) for i in (model.CONTRAST, model.OFFSET)
        )

    def linearise(self, state: Array, members: Array) -> Normal:
        """r = model - value, grey levels."""
        u, contrast, blurs = self.u[:, members], self.contrast[members], state[:, :2]
        (edge1, slope1), (edge2, slope2) = (model.step(u[i], blurs[:, i]) for i in (0, 1))
        both = slope1 * slope2
        grey = contrast * (edge1 * edge2 + state[:, 2:].astype(np.float32) * both) + self.offset[members]
        across = [-edge2 * slope1 * u[0] / blurs[:, :1], -edge1 * slope2 * u[1] / blurs[:, 1:]]
        counts = self.windows.counts[members]
        jacobian = (contrast * counts)[:, None] * np.stack([*across, both], 1)
        residual = np.where(counts, grey - self.windows.value[members], 0.0)
        return Normal.of(residual.astype(float), jacobian.astype(float))

    def retract(self, state: Array, step: Array) -> Array:
        """Clip to the limits of a blur, and of a covariance (Cauchy-Schwarz)."""
        moved = state + step
        moved[:, :2] = np.clip(moved[:, :2], LEAST_BLUR, MOST_BLUR)
        most = moved[:, :2].prod(1)
        moved[:, 2] = np.clip(moved[:, 2], -most, most)
        return moved


def blur_ellipse(directions: Array, products: Array) -> tuple[float, float] | None:
    """The ratio of the axes of an anisotropic blur, and the direction of the longer axis.

    Parameters
    ----------
    directions : (..., 2) array
        Directions of the unit vectors n, m, radians.
    products : (...) array
        nᵀ S m of the blur's covariance S, px².

    Returns
    -------
    ratio, direction : the ratio of the largest to the smallest blur, and the direction of the largest, degrees
        from x towards y (0 to 180); None where no variance fits.
    """
    a, b = directions.reshape(-1, 2).T
    # S = mean I + [[p, q], [q, -p]]
    design = np.stack([np.cos(a - b), np.cos(a + b), np.sin(a + b)], -1)
    mean, p, q = np.linalg.lstsq(design, products.ravel(), rcond=None)[0]
    values, vectors = np.linalg.eigh(np.array([[mean + p, q], [q, mean - p]]))
    if mean <= 0:
        return None
    direction = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180
    return float(np.sqrt(values[1] / max(values[0], LEAST_VARIANCE * mean))), float(direction)
