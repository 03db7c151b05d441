"""Fitted corners of a picture, and the tests that a corner must pass."""

from __future__ import annotations

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.fit import Fits
from camcal.detect.windows import Windows
from camcal.geometry.numbers import median
from camcal.records import dataclass

Array = np.ndarray

LEAST_INSIDE = 0.75  #: share of the window that must lie in the picture: one of its four edges may be missing
#: grey levels of 255, half the difference of black and white; at less, rounding to whole levels decides
LEAST_CONTRAST = 1.0
MOST_BLUR = 0.3  #: of a square; with more blur a window of half a square has no uniform part of either colour
#: of the window; a fit that moves farther has reached another corner. In small windows START_ERROR is permitted
MOST_SHIFT = 0.5
START_ERROR = 1.5  #: px; largest error of a corner before it is fitted
MOST_TURN = 0.35  #: rad (20 degrees); between a fitted edge and the board's direction
#: residual as a share of the contrast: noise of 10 grey levels on a contrast of 60 gives 0.17. In a picture in which
#: most corners have more, `RARE` times the median of the picture
MOST_MISFIT, RARE = 0.22, 3.0
MOST_SIGMA = (
    0.35  #: px; a corner with a larger one is known no better than one distributed uniformly over a pixel
)


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
        Parameters of the fits, in the order of `edge_model`; those of the corner are relative to `uv`, hence 0.
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

    @classmethod
    def none(cls) -> Corners:
        """Make an empty set of corners."""
        return cls(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, model.COUNT)), np.zeros(0), ())

    def __len__(self) -> int:
        return len(self.uv)

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
        """Half the difference (K,) between bright and dark, grey levels."""
        return np.abs(self.params[:, model.CONTRAST])

    def take(self, rows: Array) -> Corners:
        """Select some of the corners (a mask or indices)."""
        reasons = tuple(np.array(self.reasons, object)[rows])
        return Corners(self.uv[rows], self.covariance[rows], self.params[rows], self.noise[rows], reasons)


def edge_normals(sides: Array) -> Array:
    """Directions (K, 2) of the normals of the edges along the rows and along the columns, radians.

    Parameters
    ----------
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    """
    return np.arctan2(sides[:, ::-1, 0], -sides[:, ::-1, 1])


def tested(windows: Windows, fits: Fits, sides: Array, half: float | Array, span: float) -> Corners:
    """The corners of fits; the reason of a rejected one is the first test that it failed.

    Parameters
    ----------
    windows : Windows
    fits : Fits
        Of the windows.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    half : float or (K,) array
        Half-width of the windows, of a square.
    span : float
        Grey levels from black to white that the picture can represent.
    """
    params = fits.params
    shift = np.hypot(params[:, 0], params[:, 1])
    shortest = np.hypot(sides[..., 0], sides[..., 1]).min(1)
    turn = np.abs((params[:, 2:4] - edge_normals(sides) + np.pi / 2) % np.pi - np.pi / 2).max(1)
    contrast = np.abs(params[:, model.CONTRAST])
    variance = 0.5 * (fits.covariance[:, 0, 0] + fits.covariance[:, 1, 1])
    misfit = fits.noise / np.maximum(contrast, 1e-9)
    tests = {
        "at the border of the picture": windows.inside < LEAST_INSIDE,
        "too little contrast": contrast < LEAST_CONTRAST * span / 255,
        "blurred away": params[:, model.BLUR] > MOST_BLUR * shortest,
        "not where its neighbours predict": shift > np.maximum(MOST_SHIFT * half * shortest, START_ERROR),
        "its edges do not follow the board": turn > MOST_TURN,
        "does not look like a corner": misfit > max(MOST_MISFIT, RARE * median(misfit)),
        "uncertain": ~fits.converged | ~((variance > 0) & (variance < MOST_SIGMA**2)),
    }
    uv, params = windows.origin + params[:, :2], params.copy()
    params[:, :2] = 0
    reasons: tuple[str, ...] = ("",) * len(uv)
    if np.any(list(tests.values())):
        reasons = tuple(map(str, np.select(list(tests.values()), list(tests), "")))
    return Corners(uv, fits.covariance, params, fits.noise, reasons)
