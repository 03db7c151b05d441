"""Which way a picture is smeared: the blur across edges of many directions."""

from __future__ import annotations

import numpy as np

from camcal.targets import edge_model as model
from camcal.targets.saddle import HALF
from camcal.targets.windows import cut

Array = np.ndarray

MOST_CORNERS = 24  #: so many corners tell it well enough
STEPS = 4
LARGEST = 12  #: px; half the side of the largest window
SHRINK = 0.02  #: of the weight of the edges
LEAST_BLUR, MOST_BLUR = 0.28, 30.0  #: px


def edge_blurs(gray: Array, uv: Array, params: Array, sides: Array) -> tuple[Array, Array]:
    """The blur across each of the two edges of some corners.

    Gauss-Newton on the two blurs alone, from the common one of the corners' fits.

    Parameters
    ----------
    gray : (height, width) array
    uv : (K, 2) array
        Corners, px.
    params : (K, 7) array
        Of their fits, in the order of `edge_model`.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.

    Returns
    -------
    normals : (N, 2) array
        Directions of the edges' normals, radians.
    blurs : (N, 2) array
        px.
    """
    some = np.unique(np.linspace(0, len(uv) - 1, MOST_CORNERS).astype(int))
    uv, p, sides = uv[some], params[some], sides[some]
    windows = cut(gray, uv, sides, HALF, 2.5 * p[:, model.BLUR] + 1, LARGEST)
    normals = p[:, [model.ANGLE1, model.ANGLE2]]
    u = np.einsum(
        "kcp,kic->ikp", windows.q, np.stack([np.cos(normals), np.sin(normals)], -1).astype(np.float32)
    )
    blurs = np.repeat(p[:, model.BLUR, None], 2, 1)
    contrast, offset = (p[:, i, None].astype(np.float32) for i in (model.CONTRAST, model.OFFSET))
    for _ in range(STEPS):
        (edge1, slope1), (edge2, slope2) = (model.step(u[i], blurs[:, i]) for i in (0, 1))
        residual = (windows.value - offset - contrast * edge1 * edge2) * windows.counts
        j1 = -contrast * edge2 * slope1 * u[0] / blurs[:, :1]
        j2 = -contrast * edge1 * slope2 * u[1] / blurs[:, 1:]
        jacobian = np.stack([j1, j2], 1).astype(float)
        normal = jacobian @ jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(2)
        change = np.linalg.solve(normal, (jacobian @ residual[..., None].astype(float)))[..., 0]
        blurs = np.clip(blurs + np.clip(change, -0.5 * blurs, blurs), LEAST_BLUR, MOST_BLUR)
    return normals, blurs


def smear(normals: Array, blur: Array) -> tuple[float, float] | None:
    """Which way a picture is smeared, from the blur of edges in many directions.

    The variance of the blur across an edge of normal n is nᵀ S n: S (2, 2) is fitted to all edges.

    Parameters
    ----------
    normals : array
        Directions of the normals, radians.
    blur : array of the same shape
        px.

    Returns
    -------
    ratio, direction : the ratio of the largest to the smallest blur, and the direction of the largest,
    degrees
        from x towards y (0 to 180); None where no variance fits the edges.
    """
    blur, normals = np.ravel(blur), np.ravel(normals)
    c, s = np.cos(normals), np.sin(normals)
    # S = mean I + [[a, b], [b, -a]]: what two families of parallel edges do not tell of a and b is drawn to 0
    design = np.stack([np.ones_like(c), c * c - s * s, 2 * c * s], -1)
    normal = design.T @ design + len(c) * np.diag([0, SHRINK, SHRINK])
    mean, a, b = np.linalg.solve(normal, design.T @ blur**2)
    values, vectors = np.linalg.eigh(np.array([[mean + a, b], [b, mean - a]]))
    if values[0] <= 0:
        return None
    direction = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180
    return float(np.sqrt(values[1] / values[0])), float(direction)
