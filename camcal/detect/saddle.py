"""Sub-pixel corners where four squares meet, by fitting the grey values around each corner.

The model is that of `edge_model`; all corners of a picture are fitted in one batch. Each fit yields a covariance
from its own residuals, and a fit that is not a corner is rejected with a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camcal.detect import edge_model as model
from camcal.detect.aliasing import grey_limits, with_sampling
from camcal.detect.blur_shape import as_seen, rounded
from camcal.detect.corners import START_ERROR, Corners, edge_normals, tested
from camcal.detect.fit import Fits, approached, first_guess, fit, fit_sizes
from camcal.detect.local_map import BoardFromPixel
from camcal.detect.part import Picture
from camcal.detect.part import span as span_of
from camcal.detect.shading import evened, slopes, unusual, with_slopes
from camcal.detect.windows import LARGEST, Windows, cut, limited, nested, straightened
from camcal.geometry.numbers import median

Array = np.ndarray

HALF = 0.35  #: of a square; half-width of the window of the first fit, small enough for curved edges
WIDER_HALF = 0.5  #: of a square; if the curvature of the edges is known. Outer squares may be cut narrower
INNER_HALF = 0.65  #: of a square; the same for corners that are not at the border of the board
SEEN = 2.0  #: blurs; pixels farther from both edges contribute little to their positions: erf is 1 to 5 %
FIRST_LARGEST = 7  #: px; half the side of the largest window of a first fit
FIRST_SEEN = 3.0  #: blurs; the same if the picture is blurred
LEAST_PX = 4.5  #: px; a window of small squares is widened towards that half-width
START_BLUR = 1.0  #: px
MOST_START = 0.2  #: of a square; with a larger initial blur the two edges are not separated
#: pixels of a window from which the initial values are found: each of the seven keeps 1/16 of the noise
ENOUGH = 256
ROUGH = 2.0  #: standard deviations within which a first fit stops: the second starts from it
CLEAR = 2.5  #: blurs between a window and the next edge: 1 % of that edge lies within
LEAST_HALF = 0.25  #: of a square


def refine(
    picture: Picture,
    uv: Array,
    sides: Array,
    half: float | Array | None = None,
    blur: float = START_BLUR,
    span: float | None = None,
    shape: Array | None = None,
) -> Corners:
    """Fit all corners of a picture, assuming straight edges and uniform shading within a window.

    Parameters
    ----------
    picture : (height, width) array, or the part around the target
    uv : (K, 2) array
        Approximate corners, px.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    half : float or (K,) array, optional
        Half-width of the windows, in squares; by default that of a first fit on a checkerboard.
    blur : float
        Initial blur, px: at least half the error of `uv`.
    span : float, optional
        Grey levels from black to white, to which the contrast is compared; by default those of the picture.
    shape : (2, 2) array, optional
        Shape of the blur, from `blur_shape.shape_of`; isotropic by default.
    """
    if not len(uv):
        return Corners.none()
    shortest = np.linalg.norm(sides, axis=2).min(1)
    half = np.clip(LEAST_PX / np.maximum(shortest, 1e-9), HALF, WIDER_HALF) if half is None else half
    largest = max(FIRST_LARGEST, FIRST_SEEN * blur)
    windows = cut(picture, uv, sides, half, SEEN * blur + START_ERROR, largest)
    limits = grey_limits(picture, windows)
    windows, seen = rounded(windows, sides, shape)
    guess = first_guess(windows, edge_normals(seen), np.minimum(blur, MOST_START * shortest))
    fits = fit(windows, guess, limits, settled=ROUGH)
    if limits[0] < 0:
        fits = with_sampling(fits, sides * limited(half, sides, largest)[:, None, None])
    return tested(windows, as_seen(fits, shape), sides, half, span or span_of(picture))


def wider_halves(columns: int, rows: int, inner: float = INNER_HALF) -> Array:
    """Half-widths (rows * columns,) of the windows of a second fit on a checkerboard, in squares.

    Corners at the border have at most `WIDER_HALF`, as outer squares may be cut narrower.
    """
    half = np.full((rows, columns), min(inner, WIDER_HALF))
    half[1:-1, 1:-1] = inner
    return half.ravel()


def placed(uv: Array, sides: Array, blur: float) -> Corners:
    """Corners for `sharpen_sizes` that have not been fitted, at positions (K, 2), px, known to a fraction of the blur.

    Their grey levels are still to be found; `sides` as for `refine`.
    """
    params = np.full((len(uv), model.COUNT), np.nan)
    params[:, :2] = 0
    params[:, model.ANGLE1 : model.ANGLE2 + 1], params[:, model.BLUR] = edge_normals(sides), blur
    unknown = np.full((len(uv), 2, 2), np.nan)
    return Corners(uv, unknown, params, unknown[:, 0, 0], ("",) * len(uv))


def with_guesses(known: Corners, uv: Array, sides: Array, parity: Array) -> Corners:
    """Replace the rejected corners by predictions from the good ones, to be fitted again.

    Parameters
    ----------
    uv : (K, 2) array
        Predicted corners, px.
    sides : (K, 2, 2) array
        As for `refine`.
    parity : (K,) array
        +1 or -1, alternating from corner to corner as the colours do.
    """
    good = known.good
    sign = np.sign(np.sum(known.params[good, model.CONTRAST] * parity[good]))
    params = known.params.copy()
    params[~good] = np.median(known.params[good], axis=0)
    params[~good, model.ANGLE1 : model.ANGLE2 + 1] = edge_normals(sides[~good])
    params[~good, model.CONTRAST] = sign * parity[~good] * median(known.contrast[good])
    at = np.where(good[:, None], known.uv, uv)
    return replace(known, uv=at, params=params, reasons=("",) * len(at))


def shares(known: Corners, sides: Array, half: float | Array, largest: float = LARGEST) -> Array:
    """Half-widths (K,) of the windows of a second fit, in squares: clear of the next edges, and not too large."""
    shortest = np.linalg.norm(sides, axis=2).min(1)
    return limited(np.clip(1 - CLEAR * known.blur / shortest, LEAST_HALF, half), sides, largest)


def sharpen(
    picture: Picture,
    known: Corners,
    sides: Array,
    board_from_pixel: BoardFromPixel,
    half: float | Array = WIDER_HALF,
    shape: Array | None = None,
    largest: float = LARGEST,
) -> Corners:
    """Fit corners again, given the curvature of the edges and the gradient of the shading.

    Parameters
    ----------
    known : Corners
        From an earlier fit, all of them good, or from `placed`.
    sides : (K, 2, 2) array
        Steps to the next corner along columns and rows, px.
    board_from_pixel : callable
        Maps px (K, P, 2) around the K corners to coordinates in which the edges are straight.
    half : float or (K,) array
        Half-width of the windows, in squares.
    shape : (2, 2) array, optional
        As for `refine`.
    largest : float
        px; half the side of the largest window.
    """
    if not len(known):
        return known
    return sharpen_sizes(picture, known, sides, board_from_pixel, [half], largest, shape)[0]


def sharpen_sizes(
    picture: Picture,
    known: Corners,
    sides: Array,
    board_from_pixel: BoardFromPixel,
    halves: Sequence[float | Array],
    largest: float,
    shape: Array | None = None,
) -> list[Corners]:
    """As `sharpen`, in windows of several sizes at once.

    One step in windows of the usual size gives the shading; with it, a second step gives the corners of each size.

    Parameters
    ----------
    halves : sequence of float or (K,) arrays
        Half-widths of the windows, in squares, ascending.
    """
    if not len(known):
        return [known for _ in halves]
    share = np.stack([shares(known, sides, half, largest) for half in halves])
    windows, sizes = nested(picture, known.uv, sides, share, SEEN * known.blur + 1)
    limits = grey_limits(picture, windows)
    windows = straightened(windows, sides, share[-1], board_from_pixel, known.blur)
    usual = sizes[int(np.argmin([abs(np.max(half) - INNER_HALF) for half in halves]))]
    straight, seen = rounded(windows.inner(usual).thinned(ENOUGH), sides, shape)
    start = known.params.copy()
    if shape is not None:
        start[:, model.ANGLE1 : model.ANGLE2 + 1] = edge_normals(seen)
    if np.isnan(start).any():  # not fitted before: one step for the grey levels and the blur
        start = first_guess(straight, start[:, model.ANGLE1 : model.ANGLE2 + 1], start[:, model.BLUR])
        start, _ = approached(straight, start, limits)
    start, noise = approached(straight, start, limits)
    noise = np.where(np.isnan(known.noise), noise, known.noise)
    offset, contrast = start[:, model.OFFSET], np.abs(start[:, model.CONTRAST])
    slope = slopes(known.uv, offset, contrast, ~unusual(noise))
    windows, _ = rounded(evened(windows, slope, offset, contrast, limits), sides, shape)
    corners, span = [], span_of(picture)
    for i, fits in enumerate(fit_sizes(windows, sizes, start, limits)):
        inner = windows.inner(sizes[i])
        fits = _with_errors(inner, fits, sides * share[i][:, None, None], limits)
        corners.append(tested(inner, as_seen(fits, shape), sides, halves[i], span))
    return corners


def _with_errors(windows: Windows, fits: Fits, axes: Array, limits: tuple[float, float]) -> Fits:
    """Fits whose covariance includes what the model omits: shading within a window, and coarse sampling."""
    fits = with_slopes(windows, fits, limits)
    return with_sampling(fits, axes) if limits[0] < 0 else fits
