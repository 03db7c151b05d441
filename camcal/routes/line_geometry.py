"""Points on images of straight lines, their rays, and their distances from the images of planes.

With the ray d(u, v; p) of a pixel and the unit normal n of a line's plane, n · d = 0; the distance of a point from the
line's image is, to first order, (n · d) / |∂(n · d)/∂(u, v)| px (Sampson).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from camcal.model.camera import Camera
from camcal.model.lenses.inverse import InverseLens
from camcal.model.pose import Array
from camcal.records import dataclass

#: cosine of the angle to x (53 degrees) above which the cross product with y is used instead of x, so that the axis is
#: at least 37 degrees from the vector
NEAR_X = 0.6


@dataclass(frozen=True)
class Lines:
    """Points on images of straight lines.

    Attributes
    ----------
    uv : (N, 2) array, px
    line : (N,) int array
        Rows of one line are contiguous.
    names : tuple of str
    image_size : (width, height) or None
    """

    uv: Array
    line: Array
    names: tuple[str, ...]
    image_size: tuple[int, int] | None = None

    @classmethod
    def of(cls, parts: Sequence[Array], names: Sequence[str], image_size: tuple[int, int] | None) -> Lines:
        """Make the lines from the points (N, 2) of each."""
        counts = [len(p) for p in parts]
        uv = np.concatenate(parts) if parts else np.zeros((0, 2))
        return cls(uv, np.repeat(np.arange(len(parts)), counts), tuple(names), image_size)

    def __len__(self) -> int:
        return len(self.names)

    def take(self, chosen: Array) -> Lines:
        """Select some of the lines (a mask or indices)."""
        index = np.arange(len(self))[chosen]
        place = np.full(len(self), -1)
        place[index] = np.arange(len(index))
        rows = place[self.line] >= 0
        return Lines(
            self.uv[rows], place[self.line[rows]], tuple(self.names[i] for i in index), self.image_size
        )


class Nearest(NamedTuple):
    """The points of lines' images nearest to observed ones.

    Attributes
    ----------
    uv : (N, 2) array, px
    weight : (N,) array
        Px per unit of n · d there.
    distance : (N,) array
        Of the observed points, px, with the sign of n · d.
    """

    uv: Array
    weight: Array
    distance: Array


def nearest_points(camera: Camera, uv: Array, normals: Array) -> Nearest | None:
    """Two Newton steps along the gradient of n · d, (N, 3) normals; None outside the domain of the lens."""
    near, weight = uv, np.ones(len(uv))
    slope = np.zeros_like(uv)
    for _ in range(2):
        at = line_rays(camera, near)
        if at is None:
            return None
        slope = np.einsum("ni,nij->nj", normals, at[1])
        square = np.square(slope).sum(1)
        weight = 1 / np.sqrt(square)
        # to the line along the normal through the observed point
        across = slope * weight[:, None]
        off = (normals * at[0]).sum(1) * weight + ((uv - near) * across).sum(1)
        near = uv - off[:, None] * across
    return Nearest(near, weight, ((uv - near) * slope).sum(1) * weight)


def line_rays(camera: Camera, uv: Array) -> tuple[Array, Array, Array] | None:
    """Rays d (N, 3), ∂d/∂(u, v) (N, 3, 2), ∂d/∂params (N, 3, P): of a lens that is a projection, by the inverse of its
    derivatives.
    """
    if isinstance(camera.lens, InverseLens):
        *found, valid = camera.lens.rays_with_derivatives(camera.params, uv)
        return (found[0], found[1], found[2]) if valid.all() else None
    d = camera.unproject(uv)
    if not np.isfinite(d).all():
        return None
    _, d_xyz, d_params, valid = camera.lens.jacobians(camera.params, d)
    if not valid.all():
        return None
    across = tangents(d)
    onto = d_xyz @ across
    det = onto[:, 0, 0] * onto[:, 1, 1] - onto[:, 0, 1] * onto[:, 1, 0]
    if not (np.abs(det) > 0).all():
        return None
    by_uv = across @ np.linalg.inv(onto)
    return d, by_uv, -by_uv @ d_params


def slopes(at: tuple[Array, Array, Array], normals: Array) -> Array:
    """|∂(n · d)/∂(u, v)| (N,), per px."""
    return np.linalg.norm(np.einsum("ni,nij->nj", normals, at[1]), axis=1)


def tangents(vectors: Array) -> Array:
    """Two unit vectors (N, 3, 2) orthogonal to each vector (N, 3) and to each other."""
    helper = np.where(np.abs(vectors[:, :1]) < NEAR_X, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(vectors, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(vectors, first)], 2)


def best_normals(camera: Camera, lines: Lines) -> Array:
    """The normals (L, 3) of the planes nearest to the rays of each line."""
    return plane_normals(np.nan_to_num(camera.unproject(lines.uv)), lines.line, len(lines))


def plane_normals(rays: Array, line: Array, count: int) -> Array:
    """The unit vectors (L, 3) closest to orthogonal to the rays (N, 3) of each line."""
    scatter = np.zeros((count, 3, 3))
    np.add.at(scatter, line, rays[:, :, None] * rays[:, None])
    return np.linalg.eigh(scatter)[1][:, :, 0]


def distances(camera: Camera, lines: Lines) -> Array:
    """Distances (N,) of points from the images of the straight lines nearest to them, px; NaN outside the domain."""
    at = line_rays(camera, lines.uv)
    if at is None:
        return np.full(len(lines.uv), np.nan)
    n = plane_normals(at[0], lines.line, len(lines))
    for _ in range(2):  # the plane of least algebraic error, then of least distance in px
        weight = 1 / slopes(at, n[lines.line])
        n = plane_normals(at[0] * weight[:, None], lines.line, len(lines))
    return (n[lines.line] * at[0]).sum(1) / slopes(at, n[lines.line])
