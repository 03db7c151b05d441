"""A lens from pairs of ideal and distorted image points, without poses: `camcal lens-fit`.

Ideal points are what a pinhole camera would have seen: coordinates on the plane z = 1, or pixels of a camera
whose matrix is given or assumed. Which one is assumed does not change the map between the two pictures, only
how it is split between the ideal camera and the lens.
"""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.lenses.regress import Regression, measure, regress
from camcal.records import dataclass

Array = np.ndarray

#: ideal coordinates that spread farther than this are pixels: on the plane z = 1 it would be a field of 168 degrees,
#: and no picture is only 20 px wide
PLANE = 20.0
#: part of the picture's extent: repeated measurements of one point scatter by a px or less, 1/10 of this in VGA
SCATTER = 0.01


@dataclass(frozen=True)
class PairFit:
    """A lens, and how well it maps the ideal points to the distorted ones.

    Attributes
    ----------
    camera : Camera
    ideal_matrix : (3, 3) array
        Of the ideal camera; the identity for points on the plane z = 1.
    assumed : bool
        Whether the ideal matrix was chosen here.
    direct : Regression or None
        The model's linear solution, where it has one.
    refined : Regression
        After least squares in px.
    """

    camera: Camera
    ideal_matrix: Array
    assumed: bool
    direct: Regression | None
    refined: Regression


def fit_pairs(
    lens: Lens,
    ideal: Array,
    distorted: Array,
    ideal_matrix: Array | None = None,
    image_size: tuple[int, int] | None = None,
) -> PairFit:
    """Fit a lens to pairs of points.

    Parameters
    ----------
    lens : Lens
    ideal : (N, 2) array, on the plane z = 1, or px
    distorted : (N, 2) array, px
    ideal_matrix : (3, 3) array, optional
    image_size : (width, height), optional

    Raises
    ------
    DataError
        If there are fewer pairs than the model has unknowns, or where one ideal point has several pixels.
    """
    _check_a_map(ideal, distorted)
    hold = [n for n in lens.default_fixed if n not in lens.turns]
    unknown = lens.size - len(hold)
    if 2 * len(ideal) < unknown:
        raise DataError(
            f"{len(ideal)} pairs give {2 * len(ideal)} equations for the {unknown} parameters of "
            f"'{lens.name}'.",
            f"Give at least {(unknown + 1) // 2} pairs, or choose a smaller model.",
        )
    assumed = ideal_matrix is None
    matrix = _ideal_camera(ideal) if ideal_matrix is None else ideal_matrix
    rays = np.c_[ideal, np.ones(len(ideal))] @ np.linalg.inv(matrix).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    first = lens.shapes(rays, distorted, image_size)[0]
    direct = measure(lens, lens.from_values(first), rays, distorted) if "fx" in first else None
    refined = regress(lens, rays, distorted, image_size, hold)
    camera = Camera(lens, refined.params, image_size)
    return PairFit(camera, matrix, assumed and bool((matrix != np.eye(3)).any()), direct, refined)


def _check_a_map(ideal: Array, distorted: Array) -> None:
    """Reject ideal points whose distorted positions are farther apart than measurement noise explains."""
    points, which, counts = np.unique(ideal, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    centres = np.stack([np.bincount(which, c) / counts for c in distorted.T], 1)
    apart = np.linalg.norm(distorted - centres[which], axis=1)
    worst = int(apart.argmax()) if len(apart) else 0
    if len(apart) and apart[worst] > SCATTER * float(np.ptp(distorted, axis=0).max()):
        x, y = points[which[worst]]
        raise DataError(
            f"the ideal point ({x:g}, {y:g}) is given {counts[which[worst]]} times, at pixels up to "
            f"{apart[worst]:.3g} px from their mean; a lens maps it to a single pixel.",
            "For several views of a target use: camcal estimate",
        )


def _ideal_camera(ideal: Array) -> Array:
    """The identity for points on the plane; for pixels, a camera of 53 degrees over their extent."""
    low, high = ideal.min(0), ideal.max(0)
    extent = float((high - low).max())
    if extent <= PLANE:
        return np.eye(3)
    cx, cy = (low + high) / 2
    return np.array([[extent, 0, cx], [0, extent, cy], [0, 0, 1]])
