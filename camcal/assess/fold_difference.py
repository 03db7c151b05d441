"""The difference between the cameras of the folds, relative to their uncertainty.

A camera estimated without some of the views differs from that of all views. Least squares being efficient,
the covariance of the difference is the difference of the covariances (Hausman 1978, lemma 2.1):

    cov(q_k - q) = cov(q_k) - cov(q)                                                                    (1)

with q a projection of a point held to the boards of the views of fold k (`uncertainty.py`). Over the image and
the folds,

    ratio² = mean |q_k - q|² / tr cov(q_k - q)                                                          (2)

is 1 if the model holds and the noise is white, as the covariance assumes; a larger ratio indicates an invalid model,
errors of the board, or noise that is correlated between neighbouring points.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from camcal.assess.covariance import covariance
from camcal.assess.difference import image_grid
from camcal.assess.holdout import HoldOut
from camcal.assess.uncertainty import projection_uncertainty
from camcal.geometry import hull
from camcal.geometry.numbers import median
from camcal.solve.calibration import Calibration, Estimate

Array = np.ndarray

COLUMNS = 12  #: of the grid over the covered part of the picture, for a map of the report


def difference_of_folds(solution: Calibration, held: HoldOut) -> Mapping[str, Any] | None:
    """Equation (2) at infinity over the part of the picture that points cover; None if it cannot be computed.

    Outside of it the lens is extrapolated, and its uncertainty no longer linear.

    Returns
    -------
    mapping
        median_px, max_px: of the differences between each fold's camera and that of all views; predicted_px:
        the median of what the uncertainty predicts; ratio; map: both over the picture.
    """
    grid, covered = covered_grid(solution)
    pixels = grid[covered]
    accuracy, rays = covariance(solution), solution.camera.unproject(pixels)
    found, expected = [], []
    jacobians = None
    for fit, views in zip(held.fits, held.trained, strict=True):
        assert isinstance(fit, Calibration)
        moved = seen_by_fold(solution, fit, views, rays) - pixels
        uncertainty = projection_uncertainty(solution, accuracy, views)
        jacobians = uncertainty.jacobians(rays, at_infinity=True) if jacobians is None else jacobians
        whole = uncertainty.of_points(rays, at_infinity=True, jacobians=jacobians)
        own = covariance(fit)
        # with the derivatives of the full camera: those of the fold differ by a fraction of the difference to be found
        part = projection_uncertainty(fit, own).of_points(rays, at_infinity=True, jacobians=jacobians)
        # a common noise estimate: a fold with little noise would otherwise yield a negative difference
        with np.errstate(invalid="ignore"):  # infinite minus infinite is NaN and is omitted
            spread = part * (accuracy.sigma_0 / own.sigma_0) ** 2 - whole
        found.append(np.einsum("ni,ni->n", moved, moved))
        expected.append(np.einsum("nii->n", spread))
    squares, variances = np.array(found), np.array(expected)
    good = np.isfinite(squares) & np.isfinite(variances) & (variances > 0)
    if not good.size or good.sum() < 0.5 * good.size:  # the median has to be that of most of the pixels
        return None
    return {
        "median_px": float(np.sqrt(median(squares[good]))),
        "max_px": float(np.sqrt(squares[good].max())),
        "predicted_px": float(np.sqrt(median(variances[good]))),
        "ratio": float(np.sqrt(np.mean(squares[good] / variances[good]))),
        "map": _map(grid, covered, np.where(good, squares, np.nan), np.where(good, variances, np.nan)),
    }


def _map(grid: Array, covered: Array, squares: Array, variances: Array) -> dict[str, Any]:
    """Root mean squares over the folds (K, N) on the grid, NaN where no points cover it."""
    rows = len(grid) // COLUMNS
    made: dict[str, Any] = {"u": grid[:COLUMNS, 0].tolist(), "v": grid[::COLUMNS, 1].tolist()}
    for name, values in (("found_px", squares), ("predicted_px", variances)):
        some = np.isfinite(values).any(0)
        mean = np.full(values.shape[1], np.nan)
        mean[some] = np.sqrt(np.nanmean(values[:, some], axis=0))
        whole = np.full(len(grid), np.nan)
        whole[covered] = mean
        made[name] = whole.reshape(rows, COLUMNS).tolist()
    return made


def covered_pixels(solution: Estimate, camera: int = 0) -> Array:
    """The pixels (N, 2) of a grid that lie within the hull of the used points of a camera."""
    grid, covered = covered_grid(solution, camera)
    return grid[covered]


def covered_grid(solution: Estimate, camera: int = 0) -> tuple[Array, Array]:
    """A grid (N, 2) over the bounding box of the used points, row by row, and which of it lies within their hull."""
    uv = solution.observations.uv[solution.used & (solution.observations.camera == camera)]
    pixels = image_grid(uv.min(0), uv.max(0), columns=COLUMNS)
    return pixels, hull.within(uv, pixels)


def seen_by_fold(solution: Calibration, fit: Calibration, views: Array, rays: Array) -> Array:
    """The pixels (N, 2) at which the camera of a fold sees directions (N, 3) of the full camera, at infinity.

    The directions are held to the boards of the fold's views and averaged over them.
    """
    turns = fit.poses.rotations @ solution.poses.rotations[views].transpose(0, 2, 1)
    return fit.camera.project(rays @ turns.mean(0).T)
