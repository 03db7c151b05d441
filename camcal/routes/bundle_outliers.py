"""Outlier rejection for bundles: a test of each image against the noise of the images in use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camcal.least_squares.distributions import f_bound
from camcal.least_squares.scales import NORMAL_MEDIAN
from camcal.model.pose import Array
from camcal.routes.bundle import Bundle, Tracks, adjust, freedom
from camcal.routes.outliers import LEVEL
from camcal.routes.reconstruct import usable, with_points
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.parameters import free_matrix

#: px; images nearer than this to their projected points are never removed
LEAST_FAR = 0.5
ROUNDS = 6  #: largest number of rounds of adjusting and removing images


def adjusted(bundle: Bundle, tracks: Tracks, fix: Mapping[str, float | None]) -> tuple[Bundle, Array, int]:
    """Alternate between adjusting and removing images until the choice is stable; return the used rows and the
    iterations.
    """
    free = free_matrix(bundle.camera.lens, bundle.camera.params, dict(fix))
    used = usable(bundle, tracks, farthest(bundle, tracks, _first_sigma(bundle, tracks), np.inf))
    total = 0
    for _ in range(ROUNDS):
        fitted = adjust(bundle, tracks.take(used), free)
        if fitted is None:
            break
        left = freedom(tracks.take(used), free)
        sigma = float(np.sqrt(2 * fitted.normal.cost / left))
        bound = farthest(bundle, tracks, sigma, left)
        bundle, total = _placed_again(fitted.state, tracks, used, bound), total + fitted.iterations
        again = usable(bundle, tracks, bound)
        if np.array_equal(again, used):
            break
        used = again
    return bundle, used, total


def farthest(bundle: Bundle, tracks: Tracks, sigma: float, left: float) -> Array:
    """Largest permitted distance of each image (N,) from its projected point, px: `reach`.

    A point in two views leaves one residual, across the epipolar lines, with half of the variance in each image. For
    points in more views, images are assumed to keep all of their variance, as some of them nearly do.
    """
    part = np.where(_seen(bundle, tracks) <= 2, np.sqrt(0.5), 1.0)
    return np.maximum(reach(len(tracks), sigma, left) * part, LEAST_FAR)


def reach(images: int, sigma: float, left: float) -> float:
    """Largest distance of an image from its point, px, for noise `sigma`, px, estimated with `left` degrees of freedom.

    The F test at `LEVEL` over all images (Bonferroni), as for the pose of a known camera. A robust deviation instead of
    `sigma` would reject correct images, because the unknown points absorb the residuals of some images only.
    """
    level = LEVEL / images
    return sigma * float(np.sqrt(-2 * np.log(level) if np.isinf(left) else 2 * f_bound(level, 2, left)))


def _first_sigma(bundle: Bundle, tracks: Tracks) -> float:
    """The noise, px, from the median of the residuals of images, some of which may be wrong.

    A point absorbs 3 / 2k of the variance of the coordinates of its k images; two views leave one normal variable,
    with half of its variance in each.
    """
    off, seen = np.linalg.norm(bundle.residuals(tracks), axis=1), _seen(bundle, tracks)
    median = np.where(
        seen <= 2, NORMAL_MEDIAN * np.sqrt(0.5), RAYLEIGH_MEDIAN * np.sqrt(1 - 1.5 / np.maximum(seen, 2))
    )
    return float(np.nanmedian(off / median))


def _seen(bundle: Bundle, tracks: Tracks) -> Array:
    """The number of images of the point of each image (N,)."""
    return np.bincount(tracks.point, minlength=len(bundle.points))[tracks.point]


def _placed_again(bundle: Bundle, tracks: Tracks, used: Array, bound: Array) -> Bundle:
    """Triangulate the points with removed images again from all of their images, and keep those where all then agree.

    A point fitted to the remaining images only is off for the removed image by more than noise, so that it would
    never be restored.
    """
    count = len(bundle.points)
    outside = np.ones(len(tracks), bool)
    outside[used] = False
    some = np.bincount(tracks.point[outside], minlength=count) > 0
    none = np.bincount(tracks.point[used], minlength=count) == 0
    trial = with_points(replace(bundle, points=np.where(some[:, None], np.nan, bundle.points)), tracks)
    off = np.linalg.norm(trial.residuals(tracks), axis=1)
    bad = np.bincount(tracks.point[~(off <= bound)], minlength=count) > 0
    return replace(bundle, points=np.where((some & ~bad | none)[:, None], trial.points, bundle.points))
