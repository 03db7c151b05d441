"""The shape of the points of each view: on a line, on a plane, or in space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from camcal.geometry import homography, projective
from camcal.records import dataclass

if TYPE_CHECKING:
    from camcal.data.views import View
    from camcal.model.pose import Poses

Array = np.ndarray

#: Points count as lying on a plane when their extent out of it is below this part of their largest extent: a bowed
#: sheet is a plane to start from, and a DLT of points so near a plane follows the noise.
NEARLY_PLANAR = 0.02

#: Some 40 numbers a point are in use at a time in the fit of homographies: 2 to 3 MB.
POINTS_AT_A_TIME = 8_000


@dataclass(frozen=True)
class Shapes:
    """The shape of each view's points.

    Attributes
    ----------
    planar : (V,) bool array
        Points on a plane or nearly so; False is a view of points in space.
    origins : (V, 3) array
        Centroids, in the frame of the data.
    axes : (V, 3, 3) array
        Rotations whose columns are the directions of largest, middle and least extent.
    spreads : (V, 3) array
        Root mean square extent along these, unit of the data.
    image_spreads : (V, 2) array
        The same in the image, px.
    """

    planar: Array
    origins: Array
    axes: Array
    spreads: Array
    image_spreads: Array


def sides(found: Shapes, poses: Poses) -> Array:
    """The views (V,) of one planar target seen from the minority side; all must be planar."""
    centres = -np.einsum("vji,vj->vi", poses.rotations, poses.translations)
    normals = found.axes[:, :, 2]
    # the normal of a fitted plane has no sign of its own
    normals = normals * np.where(normals @ normals[0] < 0, -1.0, 1.0)[:, None]
    side = np.einsum("vi,vi->v", centres - found.origins, normals) > 0
    return np.asarray(side if side.mean() < 0.5 else ~side)


def batches(views: Sequence[View]) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Stack views with the same number of points, in batches that fit into the cache.

    Yields
    ------
    index (G,), xyz (G, N, 3), uv (G, N, 2), weights (G, N) = 1 / sigma², 1 where no sigma is given
    """
    for index in _some_at_a_time(homography.by_count(len(v) for v in views), views):
        group = [views[i] for i in index]
        # concatenate and reshape: several times faster than stack on hundreds of small arrays
        xyz = np.concatenate([v.xyz for v in group]).reshape(len(group), -1, 3)
        uv = np.concatenate([v.uv for v in group]).reshape(len(group), -1, 2)
        weights = np.ones(xyz.shape[:2])
        for row, view in enumerate(group):
            if view.sigma is not None:
                weights[row] = view.sigma**-2.0
        yield index, xyz, uv, weights


def _some_at_a_time(groups: Iterator[Array], views: Sequence[View]) -> Iterator[Array]:
    for index in groups:
        most = max(1, POINTS_AT_A_TIME // max(len(views[index[0]]), 1))
        for begin in range(0, len(index), most):
            yield index[begin : begin + most]


def shapes_of(sets: Sequence[Sequence[View]]) -> Iterator[Shapes]:
    """The shapes of the views of several cameras, which are fitted together."""
    every = shapes([view for views in sets for view in views])
    begin = 0
    for views in sets:
        rows = slice(begin, begin + len(views))
        begin = rows.stop
        yield Shapes(*(getattr(every, f.name)[rows] for f in fields(Shapes)))


def shapes(views: Sequence[View]) -> Shapes:
    """Fit a plane to the points of each view."""
    count = len(views)
    out = Shapes(
        np.zeros(count, bool),
        np.zeros((count, 3)),
        np.zeros((count, 3, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )
    for index, xyz, uv, _ in batches(views):
        if xyz.shape[1] == 0:
            continue
        out.origins[index], out.axes[index], out.spreads[index] = projective.fit_plane(xyz)
        out.image_spreads[index] = projective.principal_spreads(uv)
    out.planar[:] = out.spreads[:, 2] <= NEARLY_PLANAR * out.spreads[:, 0]
    return out
