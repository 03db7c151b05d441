"""The images of tracks that agree with a bundle: a test against the noise of those that are in."""

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

#: px; images nearer than this to their points are never left out
LEAST_FAR = 0.5
ROUNDS = 6  #: of adjusting and leaving out images, at most


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
    """How far each image (N,) may be from its point, px: `reach`.

    A point in two views has one residual left, across the epipolar lines, and each image half of its variance;
    images of points in more views are taken to keep all of theirs, as some of them nearly do.
    """
    part = np.where(_seen(bundle, tracks) <= 2, np.sqrt(0.5), 1.0)
    return np.maximum(reach(len(tracks), sigma, left) * part, LEAST_FAR)


def reach(images: int, sigma: float, left: float) -> float:
    """How far an image may be from its point, px, for noise `sigma`, px, known from `left` degrees of freedom.

    The F test at `LEVEL` over all images (Bonferroni), as for the pose of a known camera. A robust deviation in place
    of `sigma` leaves out right images: the unknown points make the residuals of some small and those of others not.
    """
    level = LEVEL / images
    return sigma * float(np.sqrt(-2 * np.log(level) if np.isinf(left) else 2 * f_bound(level, 2, left)))


def _first_sigma(bundle: Bundle, tracks: Tracks) -> float:
    """The noise, px, from the median of the residuals of images of which some may be wrong.

    Of the two coordinates of each of k images, their point takes 3 / 2k of the variance; two views leave a normal
    variable with half of it in each.
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
    """The bundle with points of which images were left out placed by all of these, where all then agree.

    Beside a point that moves with the others alone, an image misses by more than its noise, and would never come back.
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
