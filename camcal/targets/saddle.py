"""Sub-pixel corners where four squares meet, by fitting the grey values of each corner's picture.

The model is that of `edge_model`; all corners of a picture are fitted in one batch. Each fit yields a
covariance from its own residuals, and a verdict: a corner that does not look like one is rejected with its
reason.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.targets import edge_model as model
from camcal.targets.fit import Fits, fit
from camcal.targets.windows import Windows, cut

Array = np.ndarray

HALF = 0.35  #: of a square; half-width of the window of the first pass, small enough for curved edges
START_BLUR = 1.0  #: px
LEAST_INSIDE = 0.75  #: share of the window that must lie in the picture
LEAST_CONTRAST = 2.0  #: grey levels of 255
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
    blur : (K,) array
        Standard deviation of the blur across the edges, px.
    contrast : (K,) array
        Half the difference of bright and dark; negative where the first square is dark.
    noise : (K,) array
        Standard deviation of the residuals, grey levels.
    reasons : tuple of str
        Empty for a good corner, otherwise why it is rejected.
    """

    uv: Array
    covariance: Array
    blur: Array
    contrast: Array
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


def grey_limits(gray: Array) -> tuple[float, float]:
    """Grey values where a picture is cut off: black, and full scale (that of the data for 16 bits)."""
    if gray.dtype == np.uint16:
        return 0.0, float(gray.max())
    return 0.0, 255.0


def refine(
    gray: Array, uv: Array, sides: Array, half: float = HALF, blur: float = START_BLUR, scale: float = 255.0
) -> Corners:
    """Fit all corners of a picture.

    Parameters
    ----------
    gray : (height, width) array
    uv : (K, 2) array
        Approximate corners, px.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    half : float
        Half-width of the windows, of a square.
    blur : float
        Blur to start from, px: at least the error of `uv`.
    scale : float
        Grey value of white, to judge the contrast by.
    """
    shortest = np.linalg.norm(sides, axis=2).min(1)
    windows = cut(gray, uv, sides, half, 4 * blur + 3)
    angles = edge_normals(sides)
    start = np.minimum(blur, 0.2 * shortest)
    fits = fit(windows, angles, start, grey_limits(gray))
    return _judged(windows, fits, sides, angles, half, scale)


def edge_normals(sides: Array) -> Array:
    """Directions (K, 2) of the normals of the edges along the rows and along the columns, radians."""
    return np.stack(
        [np.arctan2(sides[:, 1, 0], -sides[:, 1, 1]), np.arctan2(sides[:, 0, 0], -sides[:, 0, 1])], 1
    )


def _judged(windows: Windows, fits: Fits, sides: Array, angles: Array, half: float, scale: float) -> Corners:
    params = fits.params
    shift = np.linalg.norm(params[:, :2], axis=1)
    shortest = np.linalg.norm(sides, axis=2).min(1)
    turn = np.abs((params[:, 2:4] - angles + np.pi / 2) % np.pi - np.pi / 2).max(1)
    contrast = np.abs(params[:, model.CONTRAST])
    variance = 0.5 * np.trace(fits.covariance, axis1=1, axis2=2)
    misfit = fits.noise / np.maximum(contrast, 1e-9)
    usual = np.median(misfit) if len(misfit) else 0.0
    tests = {  # the first that fails is the reason
        "at the border of the picture": windows.inside < LEAST_INSIDE,
        "too little contrast": contrast < LEAST_CONTRAST * scale / 255,
        "blurred away": params[:, model.BLUR] > 0.3 * shortest,
        "not where its neighbours say": shift > np.maximum(0.5 * half * shortest, 1.5),
        "edges do not follow the board": turn > MOST_TURN,
        "does not look like a corner": (misfit > max(MOST_MISFIT, 3 * usual)) | (misfit > 3 * usual + 0.1),
        "uncertain": ~fits.converged | ~(variance < MOST_SIGMA**2),
    }
    reasons = np.full(len(params), "", object)
    for reason, failed in reversed(tests.items()):
        reasons[failed] = reason
    return Corners(
        windows.origin + params[:, :2],
        fits.covariance,
        params[:, model.BLUR],
        params[:, model.CONTRAST],
        fits.noise,
        tuple(str(r) for r in reasons),
    )
