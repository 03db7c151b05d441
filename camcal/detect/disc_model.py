"""The grey values around the outline of a disc, and their derivatives, for many discs at once.

    I(d) = (a + b Φ(s(d) / σ)) (1 + g·d),    s = (|L d| - 1) / |∇|L d||,    d = pixel - centre

a is the black level, b the step to white, g the relative gradient of the shading, Φ the normal distribution
function, s the signed distance from the ellipse |L d| = 1 (to first order) and σ the blur. Ten parameters: centre (2),
L symmetric (3), a, g (2), b, σ.
"""

from __future__ import annotations

import numpy as np

from camcal.records import dataclass

Array = np.ndarray

CX, CY, L11, L12, L22, OFFSET, GX, GY, STEP, BLUR = range(10)
COUNT = 10


@dataclass(frozen=True)
class Band:
    """Pixels around K outlines, padded to P: offsets (K, P) from the centres, values, and a validity mask.

    `white` is the grey value at which the picture is clipped: a pixel there is at least as bright.
    """

    x: Array
    y: Array
    value: Array
    counts: Array
    inside: Array
    white: float

    def take(self, rows: Array) -> Band:
        """Select some of the discs."""
        x, y, value, counts, inside = (
            a[rows] for a in (self.x, self.y, self.value, self.counts, self.inside)
        )
        return Band(x, y, value, counts, inside, self.white)


def distance(matrix: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Signed distance from |L d| = 1 (first order), L d, and |∇|L d||."""
    wx = matrix[..., 0, 0] * x + matrix[..., 0, 1] * y
    wy = matrix[..., 1, 0] * x + matrix[..., 1, 1] * y
    rho = np.sqrt(wx * wx + wy * wy) + 1e-12
    slope = np.hypot(
        matrix[..., 0, 0] * wx + matrix[..., 1, 0] * wy, matrix[..., 0, 1] * wx + matrix[..., 1, 1] * wy
    )
    slope = slope / rho + 1e-12
    return (rho - 1) / slope, wx / rho, wy / rho, slope


def matrix_of(params: Array) -> Array:
    """L (K, 2, 2) of parameters (K, 10)."""
    return params[:, [L11, L12, L12, L22]].reshape(-1, 2, 2)


def residuals(band: Band, params: Array) -> tuple[Array, Array]:
    """Residuals (K, P), model - value, and their derivatives (K, 10, P)."""
    from scipy.special import erf  # imported here: the import is slow, and most targets have no discs

    p = params[:, :, None]
    x, y = band.x - p[:, CX], band.y - p[:, CY]
    s, nx, ny, slope = distance(matrix_of(params)[:, None], x, y)
    z = s / p[:, BLUR]
    edge = 0.5 * (1 + erf(z / np.sqrt(2)))
    bell = p[:, STEP] * np.exp(-0.5 * z * z) / (np.sqrt(2 * np.pi) * p[:, BLUR])
    along = bell / slope  # d I / d |L d|; the change of the slope itself vanishes on the outline
    jacobian = np.empty((len(params), COUNT, band.x.shape[1]))
    grey, shading = p[:, OFFSET] + p[:, STEP] * edge, 1 + p[:, GX] * x + p[:, GY] * y
    along *= shading
    jacobian[:, CX] = -along * (p[:, L11] * nx + p[:, L12] * ny) - grey * p[:, GX]
    jacobian[:, CY] = -along * (p[:, L12] * nx + p[:, L22] * ny) - grey * p[:, GY]
    jacobian[:, L11] = along * nx * x
    jacobian[:, L12] = along * (nx * y + ny * x)
    jacobian[:, L22] = along * ny * y
    jacobian[:, OFFSET] = shading
    jacobian[:, GX], jacobian[:, GY] = grey * x, grey * y
    jacobian[:, STEP] = edge * shading
    jacobian[:, BLUR] = -bell * shading * z
    residual = grey * shading - band.value
    counts = band.counts & ~((band.value >= band.white) & (residual > 0))
    return np.where(counts, residual, 0.0), jacobian * counts[:, None]
