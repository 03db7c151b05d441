"""The grey values around corners where four squares meet, and their derivatives, for many corners at once.

    I(q) = a + b S(u1, u2),   u1 = n1·(q - d),   u2 = n2·(q - d)

q are coordinates (px) in which both edges are straight, d is the corner, n1 and n2 are the normals of the edges. S
is sign(u1) sign(u2) under a Gaussian blur s: the product of error functions E(u1) E(u2) if the edges are at right
angles. Otherwise the blurred u1 and u2 have the correlation r = n1·n2, and

    S = sum over k of r^k / k! s^2k E^(k)(u1) E^(k)(u2)

(Mehler's expansion), of which four terms are taken.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

COUNT = 7  #: parameters: corner (2), direction of each edge's normal (2), offset a, half-contrast b, blur s
DX, DY, ANGLE1, ANGLE2, OFFSET, CONTRAST, BLUR = range(COUNT)

# erf(z) = 1 - (c1 t + c2 t^2 + c3 t^3) exp(-z^2), t = 1 / (1 + p z); |error| < 2.5e-5, a hundredth of a grey
# level. Abramowitz & Stegun (1964), 7.1.25. It shares the exponential with the derivative.
ERF_ERROR = 2.5e-5
_P = np.float32(0.47047)
_C = tuple(np.float32(c) for c in (0.3480242, -0.0958798, 0.7478556))
OBLIQUE = 0.2  #: |n1·n2| above which the third term of the expansion exceeds a tenth of a grey level


def step(u: Array, blur: Array) -> tuple[Array, Array]:
    """A blurred edge erf(u / (√2 s)) and its derivative with respect to u.

    Parameters
    ----------
    u : (K, P) float32 array
        Signed distance from the edge, px.
    blur : (K,) array
    """
    scale = (1 / (np.sqrt(2) * blur)).astype(np.float32)[:, None]
    z = u * scale
    bell = z * z
    np.exp(np.negative(bell, out=bell), out=bell)
    t = np.abs(z)
    t *= _P
    t += 1
    np.reciprocal(t, out=t)
    tail = t * _C[2]
    for c in (_C[1], _C[0]):
        tail += c
        tail *= t
    tail *= bell
    edge = np.copysign(np.subtract(1, tail, out=tail), z, out=z)
    bell *= np.float32(2 / np.sqrt(np.pi)) * scale
    return edge, bell


def evaluate(q: Array, params: Array) -> tuple[Array, Array]:
    """Grey values and their derivatives.

    Parameters
    ----------
    q : (K, 2, P) float32 array
        Straightened coordinates of the pixels, px.
    params : (K, 7) array

    Returns
    -------
    value : (K, P) float32 array
    jacobian : (K, 7, P) float32 array
    """
    p = params.astype(np.float32)
    x, y = q[:, 0] - p[:, DX, None], q[:, 1] - p[:, DY, None]
    cos1, sin1 = np.cos(p[:, ANGLE1, None]), np.sin(p[:, ANGLE1, None])
    cos2, sin2 = np.cos(p[:, ANGLE2, None]), np.sin(p[:, ANGLE2, None])
    u1, u2 = cos1 * x + sin1 * y, cos2 * x + sin2 * y
    edge1, slope1 = step(u1, params[:, BLUR])
    edge2, slope2 = step(u2, params[:, BLUR])
    contrast = p[:, CONTRAST, None]
    oblique, both, turned = _oblique(u1, u2, slope1, slope2, p)
    slope1 *= edge2
    slope1 -= both * u1
    slope1 *= contrast
    slope2 *= edge1
    slope2 -= both * u2
    slope2 *= contrast
    jacobian = np.empty((len(q), COUNT, q.shape[2]), np.float32)
    np.add(slope1 * -cos1, slope2 * -cos2, out=jacobian[:, DX])
    np.add(slope1 * -sin1, slope2 * -sin2, out=jacobian[:, DY])
    np.multiply(slope1, cos1 * y - sin1 * x, out=jacobian[:, ANGLE1])
    np.multiply(slope2, cos2 * y - sin2 * x, out=jacobian[:, ANGLE2])
    turned *= contrast
    jacobian[:, ANGLE1] += turned
    jacobian[:, ANGLE2] -= turned
    jacobian[:, OFFSET] = 1
    np.multiply(edge1, edge2, out=jacobian[:, CONTRAST])
    jacobian[:, CONTRAST] += oblique
    slope1 *= u1
    slope2 *= u2
    np.add(slope1, slope2, out=jacobian[:, BLUR])
    jacobian[:, BLUR] *= -1 / p[:, BLUR, None]
    return p[:, OFFSET, None] + contrast * jacobian[:, CONTRAST], jacobian


def _oblique(u1: Array, u2: Array, bell1: Array, bell2: Array, p: Array) -> tuple[Array, Array, Array]:
    """The terms k = 1 to 3 of the expansion, r E'(u1) E'(u2), and the derivative with respect to the angle."""
    angle = p[:, ANGLE1, None] - p[:, ANGLE2, None]
    r = np.cos(angle)
    variance = p[:, BLUR, None] ** 2
    both = bell1 * bell2
    turned = both * (-np.sin(angle) * variance)
    both *= r
    terms = u1 * u2
    terms *= np.float32(0.5) * r
    if np.abs(r).max() > OBLIQUE:
        third = (u1 * u1 - variance) * (u2 * u2 - variance)
        third *= r * r / (6 * variance)
        terms += third
    terms += variance
    terms *= both
    return terms, both, turned


def residuals(
    q: Array, value: Array, counts: Array, params: Array, limits: tuple[float, float]
) -> tuple[Array, Array]:
    """Residuals (K, P), model - value, and their derivatives (K, 7, P); 0 for pixels without information.

    Parameters
    ----------
    q, params
        As for `evaluate`.
    value : (K, P) array
        Grey values.
    counts : (K, P) bool array
        Mask of the pixels to use.
    limits : (low, high)
        Grey values at which the picture is clipped: the true value of a pixel there is at least as extreme.
    """
    model, jacobian = evaluate(q, params)
    residual = model - value
    low, high = limits
    says = counts & ~((value >= high) & (residual > 0)) & ~((value <= low) & (residual < 0))
    return residual * says, jacobian * says[:, None]
