"""Sub-pixel points of edges and of thin lines, each with the direction of the line.

Edges are maxima of the gradient along its own direction (Canny 1986), interpolated by a parabola (Devernay, A
non-maxima suppression method for edge detection with sub-pixel accuracy, 1995). Thin lines are zeros of the first
derivative across the direction of greatest curvature (Steger, An unbiased detector of curvilinear structures, 1998,
eq. 5).
"""

from __future__ import annotations

import cv2
import numpy as np

from camcal.detect.pyramid import MASK, MASK_NORM
from camcal.least_squares.scales import NORMAL_MEDIAN, UNIFORM
from camcal.records import dataclass

Array = np.ndarray

#: px; widths of the Gaussian under the derivatives: twice the blur of a sharp edge, and lines 2 to 8 px wide
EDGE_SIGMA, RIDGE_SIGMA = 1.0, 2.0
#: A point counts if its response exceeds this many standard deviations of the response to noise: of some 1e6
#: pixels, two or three such maxima of pure noise remain, too few to form a chain.
NOISES = 5.0
#: ... and this fraction of the response that one point in ten exceeds (that quantile): texture and shading between
#: the lines are weaker. Quantiles of .9 and .95 find the same ten lines of a building, .8 eleven, .99 nine
WEAKEST, STRONG = 0.25, 0.9
#: curvature along a thin line over that across it, above which it crosses another
CROSSING = 0.3
#: noise of a picture without any (rounding to 8 bits), grey levels
ROUNDING = UNIFORM
#: px; width of the border in which filters are incomplete: three widths of the larger filter
MARGIN = 6


@dataclass(frozen=True)
class LinePoints:
    """Points on edges or thin lines.

    Attributes
    ----------
    uv : (N, 2) array, px
    along : (N, 2) array
        Unit vectors along the edge; their sign is arbitrary.
    strength : float
        The response that one point in ten exceeds.
    """

    uv: Array
    along: Array
    strength: float = 0.0

    def __len__(self) -> int:
        return len(self.uv)


def edges(gray: Array, sigma: float = EDGE_SIGMA) -> LinePoints:
    """Points of edges of a grey picture (rows, cols)."""
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma)
    gx, gy = _derivatives(smooth)
    size = np.hypot(gx, gy)
    # a central difference of noise of variance s² smoothed over sigma has the variance s² / (8 π sigma⁴)
    least = NOISES * noise(gray) / np.sqrt(8 * np.pi) / sigma**2
    rows, cols = _inner(size >= least)
    nx, ny = gx[rows, cols] / size[rows, cols], gy[rows, cols] / size[rows, cols]
    # the maximum within half a pixel along the gradient: a parabola through values one pixel apart
    before, after = _sampled(size, cols - nx, rows - ny), _sampled(size, cols + nx, rows + ny)
    here = size[rows, cols]
    curvature = 2 * here - before - after
    peak = (here > before) & (here >= after) & (curvature > 0)
    shift = (after - before)[peak] / (2 * curvature[peak])
    uv = np.stack([cols[peak] + shift * nx[peak], rows[peak] + shift * ny[peak]], 1)
    return _strong(uv, np.stack([-ny[peak], nx[peak]], 1), here[peak])


def ridges(gray: Array, dark: bool, sigma: float = RIDGE_SIGMA) -> LinePoints:
    """Points of thin lines of a grey picture (rows, cols), dark ones or bright ones."""
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma)
    gx, gy = _derivatives(smooth)
    gxx, gxy = _derivatives(gx)
    _, gyy = _derivatives(gy)
    # the eigenvalue of the Hessian across a dark (bright) line is positive (negative) and the larger in magnitude
    half, off = (gxx - gyy) / 2, np.hypot((gxx - gyy) / 2, gxy)
    middle = (gxx + gyy) / 2
    value = middle + off if dark else middle - off
    # second derivatives of noise of variance s² have the variance 3 s² / (16 π sigma⁶)
    least = NOISES * noise(gray) * np.sqrt(3 / (16 * np.pi)) / sigma**3
    rows, cols = _inner((value if dark else -value) >= least)
    turn = np.arctan2(gxy[rows, cols], half[rows, cols]) / 2 + (0 if dark else np.pi / 2)
    nx, ny = np.cos(turn), np.sin(turn)
    slope = gx[rows, cols] * nx + gy[rows, cols] * ny
    shift = -slope / value[rows, cols]
    near = (np.abs(shift * nx) <= 0.5) & (np.abs(shift * ny) <= 0.5)
    # where lines cross, both curvatures are large, and the point is on neither
    other = np.abs(2 * middle - value)[rows, cols]
    near &= other <= CROSSING * np.abs(value[rows, cols])
    uv = np.stack([cols[near] + (shift * nx)[near], rows[near] + (shift * ny)[near]], 1)
    return _strong(uv, np.stack([-ny[near], nx[near]], 1), np.abs(value[rows, cols][near]))


def _strong(uv: Array, along: Array, response: Array) -> LinePoints:
    """The points whose response is not weak compared with the others."""
    if not len(uv):
        return LinePoints(uv, along)
    strong = float(np.quantile(response, STRONG))
    kept = response >= WEAKEST * strong
    return LinePoints(uv[kept], along[kept], strong)


def noise(gray: Array) -> float:
    """The standard deviation of a picture's noise, grey levels, from the median of its second differences.

    Immerkaer's mask (Fast noise variance estimation, 1996) removes planes and edges; the median ignores texture.
    """
    response = cv2.filter2D(gray.astype(np.float32), -1, MASK)[1:-1, 1:-1]
    return max(float(np.median(np.abs(response))) / (NORMAL_MEDIAN * MASK_NORM), ROUNDING)


def _derivatives(picture: Array) -> tuple[Array, Array]:
    """Central differences in u and v."""
    gx, gy = np.zeros_like(picture), np.zeros_like(picture)
    gx[:, 1:-1] = (picture[:, 2:] - picture[:, :-2]) / 2
    gy[1:-1] = (picture[2:] - picture[:-2]) / 2
    return gx, gy


def _inner(mask: Array) -> tuple[Array, Array]:
    """Rows and columns of a mask, away from the border of the picture."""
    rows, cols = np.nonzero(mask[MARGIN:-MARGIN, MARGIN:-MARGIN])
    return rows + MARGIN, cols + MARGIN


def _sampled(picture: Array, u: Array, v: Array) -> Array:
    """Bilinear samples (N,)."""
    left, top = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = u - left, v - top
    upper = picture[top, left] * (1 - a) + picture[top, left + 1] * a
    lower = picture[top + 1, left] * (1 - a) + picture[top + 1, left + 1] * a
    return upper * (1 - b) + lower * b
