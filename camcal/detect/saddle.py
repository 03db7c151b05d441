"""Sub-pixel corners where four squares meet, by fitting the grey values of each corner's picture.

The model is that of `edge_model`; all corners of a picture are fitted in one batch. Each fit yields a
covariance from its own residuals, and a verdict: a corner that does not look like one is rejected with its
reason.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import Fits, first_guess, fit
from camcal.detect.local_map import BoardFromPixel
from camcal.detect.pyramid import grey_span
from camcal.detect.shading import evened, slopes
from camcal.detect.windows import Windows, cut, straightened

Array = np.ndarray

HALF = 0.35  #: of a square; half-width of the window of the first fit, small enough for curved edges
WIDER_HALF = 0.5  #: of a square; where the curvature of the edges is known. Outer squares may be cut narrower
INNER_HALF = 0.65  #: of a square; the same for corners that are not at the edge of the board
SEEN = 2.0  #: blurs; pixels farther from both edges say little of where these are
FIRST_LARGEST = 7  #: px; half the side of the largest window of a first fit
LEAST_PX = 4.5  #: px; a window of small squares is widened towards that half-width
START_BLUR = 1.0  #: px
ROUGH = 0.5  #: standard deviations within which a first fit stops: the second begins there
CLEAR = 2.5  #: blurs that a window keeps away from the next edge
LEAST_HALF = 0.25  #: of a square
MOST_BLUR = 0.3  #: of a square
LEAST_INSIDE = 0.75  #: share of the window that must lie in the picture
LEAST_CONTRAST = (
    1.0  #: grey levels of 255; half the difference of black and white, which rounding leaves there
)
MOST_MISFIT = 0.22  #: residual as a share of the contrast; noise of 10 levels on a contrast of 60 gives 0.17
MOST_TURN = 0.35  #: rad; between a fitted edge and the board's direction
MOST_SIGMA = 0.35  #: px


@dataclass(frozen=True)
class Corners:
    """Fitted corners of one picture.

    Attributes
    ----------
    uv : (K, 2) array
        px.
    covariance : (K, 2, 2) array
        px².
    params : (K, 7) array
        Of the fits, in the order of `edge_model`; the corner's own two are relative to `uv`, so 0.
    noise : (K,) array
        Standard deviation of the residuals, grey levels.
    reasons : tuple of str
        Empty for a good corner, otherwise why it is rejected.
    """

    uv: Array
    covariance: Array
    params: Array
    noise: Array
    reasons: tuple[str, ...]

    @property
    def good(self) -> Array:
        """Mask (K,) of the corners that were not rejected."""
        return np.array([not r for r in self.reasons], bool)

    @property
    def sigma(self) -> Array:
        """Standard deviation (K,) in each coordinate, px: the root of the mean variance."""
        return np.sqrt(0.5 * np.trace(self.covariance, axis1=1, axis2=2))

    @property
    def blur(self) -> Array:
        """Standard deviation (K,) of the blur across the edges, px."""
        return self.params[:, model.BLUR]

    @property
    def contrast(self) -> Array:
        """Half the difference (K,) of bright and dark, grey levels."""
        return np.abs(self.params[:, model.CONTRAST])

    def take(self, rows: Array) -> Corners:
        """Only some of the corners (a mask or indices)."""
        reasons = tuple(np.array(self.reasons, object)[rows])
        return Corners(self.uv[rows], self.covariance[rows], self.params[rows], self.noise[rows], reasons)


def grey_limits(gray: Array) -> tuple[float, float]:
    """Grey values where a picture is cut off: black, and full scale (that of the data for 16 bits)."""
    return 0.0, white_level(gray)


def white_level(gray: Array) -> float:
    """Grey value of full scale."""
    return float(gray.max()) if gray.dtype == np.uint16 else 255.0


def refine(
    gray: Array,
    uv: Array,
    sides: Array,
    half: float | Array = HALF,
    blur: float = START_BLUR,
    scale: float | None = None,
) -> Corners:
    """Fit all corners of a picture, edges taken for straight and the light for even within a window.

    Parameters
    ----------
    gray : (height, width) array
    uv : (K, 2) array
        Approximate corners, px.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    half : float or (K,) array
        Half-width of the windows, of a square.
    blur : float
        Blur to start from, px: at least half the error of `uv`.
    scale : float, optional
        Grey levels from black to white, to judge the contrast by; those of the picture where left out.
    """
    if not len(uv):
        return _nothing()
    shortest = np.linalg.norm(sides, axis=2).min(1)
    windows = cut(gray, uv, sides, half, 2 * blur + 1.5, FIRST_LARGEST)
    start = np.minimum(blur, 0.2 * shortest)
    guess = first_guess(windows, edge_normals(sides), start)
    fits = fit(windows, guess, grey_limits(gray), settled=ROUGH)
    return _judged(windows, fits, sides, half, scale or grey_span(gray))


def usual_half(sides: Array) -> Array:
    """Half-widths (K,) of the windows of a first fit, shares of the squares of a checkerboard."""
    shortest = np.linalg.norm(sides, axis=2).min(1)
    return np.clip(LEAST_PX / np.maximum(shortest, 1e-9), HALF, WIDER_HALF)


def wider_halves(columns: int, rows: int) -> Array:
    """Half-widths (rows * columns,) of the windows of a second fit on a checkerboard, of a square."""
    half = np.full((rows, columns), WIDER_HALF)
    half[1:-1, 1:-1] = INNER_HALF
    return half.ravel()


def with_guesses(known: Corners, uv: Array, sides: Array, parity: Array) -> Corners:
    """Replace the corners that were rejected by what the good ones let expect, to be fitted again.

    Parameters
    ----------
    uv : (K, 2) array
        Where the corners should be, px.
    sides : (K, 2, 2) array
        As for `refine`.
    parity : (K,) array
        +1 or -1, alternating from corner to corner as the colours do.
    """
    good = known.good
    usual = np.median(known.params[good], axis=0)
    sign = np.sign(np.sum(known.params[good, model.CONTRAST] * parity[good]))
    params = known.params.copy()
    params[~good] = usual
    params[~good, model.ANGLE1 : model.ANGLE2 + 1] = edge_normals(sides[~good])
    size = np.median(known.contrast[good])
    params[~good, model.CONTRAST] = sign * parity[~good] * size
    at = np.where(good[:, None], known.uv, uv)
    return Corners(at, known.covariance, params, known.noise, ("",) * len(at))


def sharpen(
    gray: Array,
    known: Corners,
    sides: Array,
    board_from_pixel: BoardFromPixel,
    half: float | Array = WIDER_HALF,
) -> Corners:
    """Fit corners again, with the edges' curvature and the slope of the light known.

    Parameters
    ----------
    known : Corners
        Of an earlier fit, all of them good.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    board_from_pixel : callable
        From px (K, P, 2) around the K corners to coordinates in which the edges are straight.
    half : float or (K,) array
        Half-width of the windows, of a square.
    """
    if not len(known.uv):
        return known
    limits = grey_limits(gray)
    shortest = np.linalg.norm(sides, axis=2).min(1)
    share = np.clip(1 - CLEAR * known.blur / shortest, LEAST_HALF, half)
    windows = cut(gray, known.uv, sides, share, SEEN * known.blur + 1)
    windows = straightened(windows, sides, share, board_from_pixel)
    offset = known.params[:, model.OFFSET]
    slope = slopes(known.uv, offset, known.contrast)
    windows = evened(windows, slope, offset, known.contrast, limits)
    return _judged(windows, fit(windows, known.params, limits), sides, half, grey_span(gray))


def edge_normals(sides: Array) -> Array:
    """Directions (K, 2) of the normals of the edges along the rows and along the columns, radians."""
    return np.stack(
        [np.arctan2(sides[:, 1, 0], -sides[:, 1, 1]), np.arctan2(sides[:, 0, 0], -sides[:, 0, 1])], 1
    )


def _judged(windows: Windows, fits: Fits, sides: Array, half: float | Array, scale: float) -> Corners:
    params = fits.params
    shift = np.linalg.norm(params[:, :2], axis=1)
    shortest = np.linalg.norm(sides, axis=2).min(1)
    turn = np.abs((params[:, 2:4] - edge_normals(sides) + np.pi / 2) % np.pi - np.pi / 2).max(1)
    contrast = np.abs(params[:, model.CONTRAST])
    variance = 0.5 * np.trace(fits.covariance, axis1=1, axis2=2)
    misfit = fits.noise / np.maximum(contrast, 1e-9)
    usual = np.median(misfit)
    tests = {  # the first that fails is the reason
        "at the border of the picture": windows.inside < LEAST_INSIDE,
        "too little contrast": contrast < LEAST_CONTRAST * scale / 255,
        "blurred away": params[:, model.BLUR] > MOST_BLUR * shortest,
        "not where its neighbours say": shift > np.maximum(0.5 * half * shortest, 1.5),
        "edges do not follow the board": turn > MOST_TURN,
        "does not look like a corner": misfit > np.where(usual < MOST_MISFIT / 3, MOST_MISFIT, 3 * usual),
        "uncertain": ~fits.converged | ~(variance < MOST_SIGMA**2),
    }
    reasons = np.full(len(params), "", object)
    for reason, failed in reversed(tests.items()):
        reasons[failed] = reason
    uv = windows.origin + params[:, :2]
    params = np.c_[np.zeros((len(params), 2)), params[:, 2:]]
    return Corners(uv, fits.covariance, params, fits.noise, tuple(str(r) for r in reasons))


def _nothing() -> Corners:
    return Corners(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, model.COUNT)), np.zeros(0), ())
