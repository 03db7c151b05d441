"""The points of a view that agree on a homography and a division model: samples of five, then all inliers.

A. Fitzgibbon (2001), section 3: five points of a plane give ten equations for the nine unknowns of H and λ (six
points in space, for twelve), one more than needed, which the eigenvalue problem D1ᵀ D1 h = -λ D1ᵀ D2 h solves in
the least-squares sense. The sample of the least median of squares (Rousseeuw 1984) is then refitted to all
points that agree with it (local optimisation: Chum, Matas & Kittler, Locally optimized RANSAC, 2003).
"""

from __future__ import annotations

import numpy as np

from camcal.geometry.roots import are_real
from camcal.records import dataclass

Array = np.ndarray

#: |λ| in half diagonals of the image: at -8 a ray at right angles to the axis is at a third of the half diagonal,
#: the smallest picture circle of a fisheye; pincushion of real lenses stays far below
STRONGEST = 8.0
#: of five points each: with three of ten points wrong, 17 samples are free of wrong points on average, and none in 2e-5
#: of the views; with four of ten wrong, none in 1 % of them
SAMPLES = 60
#: robust standard deviations above which a point is an outlier. The limit is wide: a lens that the division model does
#: not describe exactly has residuals of several of them near the border, and wrong points lie hundreds away
FAR = 6.0
#: half diagonals; rounding level of residuals of exact data
LEAST_FAR = 1e-9
#: fits to the points that agree
OPTIMISED = 3


@dataclass(frozen=True)
class Equations:
    """D1 and D2 of a view, three rows per point, weighted.

    Attributes
    ----------
    x : (N, m / 3) array
        Homogeneous points of unit spread.
    pixels : (N, 2) array
        About the centre, in half diagonals.
    d1, d2 : (N, 3, m) arrays
    """

    x: Array
    pixels: Array
    d1: Array
    d2: Array

    def take(self, chosen: Array) -> Equations:
        """Select some of the points."""
        return Equations(self.x[chosen], self.pixels[chosen], self.d1[chosen], self.d2[chosen])

    @property
    def flat(self) -> tuple[Array, Array]:
        """D1 and D2 as (3N, m)."""
        m = self.d1.shape[2]
        return self.d1.reshape(-1, m), self.d2.reshape(-1, m)


def agreeing(view: Equations, seed: int = 0) -> Array:
    """The points (N,) that agree; all of them if there are too few to decide or no sample gives a real λ."""
    count, size = len(view.x), view.d1.shape[2]
    everybody = np.ones(count, bool)
    least = size // 3 + 2  # 5 of a plane, 6 in space
    if count < 2 * least:
        return everybody
    rng = np.random.default_rng(seed)
    samples = np.stack([rng.choice(count, least, replace=False) for _ in range(SAMPLES)])
    best = _best(view, samples)
    if best is None:
        return everybody
    for _ in range(OPTIMISED):
        chosen = _near(best)
        again = _best(view, np.flatnonzero(chosen)[None])
        if again is None or np.median(again) >= np.median(best):
            break
        best = again
    return _near(best)


def _near(squares: Array) -> Array:
    # the median of χ² with two degrees of freedom is 2 ln 2
    variance = np.median(squares) / (2 * np.log(2))
    return np.asarray(squares <= max(FAR**2 * 2 * variance, LEAST_FAR**2))


def _best(view: Equations, samples: Array) -> Array | None:
    """Squared distances (N,) for the sample (S, K) with the lowest median; None without a real λ."""
    values, h = _solutions(view, samples)
    if not len(values):
        return None
    squares = _squares(view, values, h)
    return np.asarray(squares[np.median(squares, axis=1).argmin()])


def _solutions(view: Equations, samples: Array) -> tuple[Array, Array]:
    """The real λ (R,) of all samples, and their h (R, m)."""
    m = view.d1.shape[2]
    d1, d2 = (d[samples].reshape(len(samples), -1, m) for d in (view.d1, view.d2))
    left, right = np.swapaxes(d1, 1, 2) @ d1, -np.swapaxes(d1, 1, 2) @ d2
    # exact data without distortion make it singular: the ridge, at rounding level, gives λ = 0
    ridge = np.trace(left, axis1=1, axis2=2)[:, None, None] * 1e-15 * np.eye(m)
    inverse, vectors = np.linalg.eig(np.linalg.solve(left + ridge, right))  # 1 / λ
    with np.errstate(divide="ignore", invalid="ignore"):
        values = 1 / inverse
    real = are_real(values)
    good = real & (np.abs(values) <= STRONGEST)
    return values[good].real, np.swapaxes(vectors, 1, 2)[good].real


def _squares(view: Equations, values: Array, h: Array) -> Array:
    """Squared distances (R, N) between the points without distortion, times 1 + λ ρ²: half diagonals of the picture."""
    onto = np.einsum("rij,nj->rni", h.reshape(len(h), 3, -1), view.x)
    depth = 1 + values[:, None] * np.square(view.pixels).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = onto[..., :2] / onto[..., 2:] * depth[..., None] - view.pixels
    squares = np.square(off).sum(-1)
    return np.where(np.isfinite(squares), squares, np.inf)
