"""The model of the projection matrix: the 11 entries of Column(M), as Barranco & Medel track them.

Their equation Y = Central(X, Y) Column(M) + W has measured image points in its rows, so that least squares
on it is biased, and the noise of a row is the noise of a pixel times the depth of the point. Both are put
right here by dividing each row by the current depth and by taking the *projected* point for the measured one
in the regressors: row · (m - m̂) then equals u - û to first order, which is the true projective residual,
and the noise is that of the pixel.

Points and pixels are normalised (Hartley 1997) by the similarities of the first frames, once and for all. The
last element of the normalised matrix is the depth of the centroid of the points, which is never zero
in front of the camera, so that m34 = 1 costs nothing there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from camcal.geometry import projective
from camcal.track import decompose, first
from camcal.track.decompose import Cameras
from camcal.track.frames import Frame
from camcal.track.model import MOVED, Model
from camcal.track.motion import scaled

Array = np.ndarray

#: depths of the centroid of the points; nearer ones are at the camera or behind it
NEAREST = 1e-9
#: of the entries of M, which are about 1: a turn of 0.05 degrees or so, below which the covariance stays as it is
WALKED = 1e-3


class MatrixModel(Model):
    """M with m34 = 1 in normalised coordinates; an estimate is the (11,) array of the other entries, by rows."""

    size = 11
    min_points = 6
    start_points = 6
    kept: ClassVar[tuple[str, ...]] = ("world", "image")

    def __init__(self) -> None:
        self._set(np.eye(4), np.eye(3))

    def _set(self, world: Array, image: Array) -> None:
        """Set the similarities: normalised = T @ homogeneous."""
        self.world, self.image = world, image
        self._scale, self._shift = world[0, 0], world[:3, 3:]
        self._px = 1.0 / image[0, 0]
        self._tangents: list[tuple[Array, tuple[Array, Array, Array]]] = []
        self._centre = -image[:2, 2:] * self._px

    # ------------------------------------------------------------------ between the two frames
    def to_matrix(self, x: Array) -> Array:
        """M (..., 3, 4) in the units of the data, of estimates (..., 11)."""
        ones = np.ones((*x.shape[:-1], 1))
        normalised = np.concatenate([x, ones], -1).reshape(*x.shape[:-1], 3, 4)
        return np.linalg.inv(self.image) @ normalised @ self.world

    def from_matrix(self, matrix: Array) -> Array:
        """The estimate (11,) of a matrix (3, 4) in the units of the data."""
        normalised = (self.image @ matrix @ np.linalg.inv(self.world)).reshape(12)
        return normalised[:11] / normalised[11]

    def tangent(self, k: Array, pose: Array) -> Array:
        """d estimate / d physical coordinates (..., 11, 11)."""
        inverse = np.linalg.inv(self.world)
        d = np.swapaxes(decompose.tangent(k, pose), -1, -2)
        d = self.image @ d.reshape(*d.shape[:-1], 3, 4) @ inverse
        d = np.swapaxes(d.reshape(*d.shape[:-2], 12), -1, -2)
        matrix = (self.image @ k @ pose @ inverse).reshape(*k.shape[:-2], 12)
        return decompose.unit_last(matrix, d)[1]

    def normalise(self, frame: Frame, keep: Array) -> tuple[Array, Array]:
        """Kept points (K, 3) and pixels (K, 2) in normalised coordinates."""
        xyz = frame.xyz[keep] * self._scale + self._shift[:, 0]
        return xyz, (frame.uv[keep] - self._centre[:, 0]) / self._px

    @property
    def per_pixel(self) -> float:
        """The size of a pixel in normalised image units."""
        return 1.0 / self._px

    # ------------------------------------------------------------------ what a model has to say
    def linearise(self, x: Array, frame: Frame) -> tuple[Array, Array]:
        """See `Model.linearise`: Central's rows divided by the depth, with the projected instead of the measured
        point.
        """
        n = len(frame.xyz)
        points = np.empty((4, n))
        np.multiply(frame.xyz.T, self._scale, out=points[:3])
        points[:3] += self._shift
        points[3] = 1.0
        matrix = np.empty(12)
        matrix[:11], matrix[11] = x, 1.0
        image = matrix.reshape(3, 4) @ points
        valid = image[2] > NEAREST
        inverse = 1.0 / np.where(valid, image[2], 1.0)
        uv = image[:2] * inverse
        design = np.zeros((12, 2, n))
        rows = points * (self._px * inverse)
        design[0:4, 0] = rows
        design[4:8, 1] = rows
        np.multiply(rows[:3, None], -uv, out=design[8:11])
        uv *= self._px
        uv += self._centre
        np.subtract(frame.uv.T, uv, out=design[11])
        return design, valid

    def retract(self, x: Array, delta: Array) -> Array:
        """Return the sum."""
        return x + delta

    def local(self, origin: Array, x: Array) -> Array:
        """Return the difference."""
        return x - origin

    def motion(self, x: Array, figures: Mapping[str, float]) -> Array:
        """The physical motion, transformed by the derivative of M."""
        tangent, k, pose = self._tangent_at(x)
        centroid = np.linalg.solve(self.world, [0.0, 0.0, 0.0, 1.0])
        distance = float(np.linalg.norm(pose @ centroid))
        columns = decompose.noise_columns(scaled(figures, k[0, 0], distance), k[1, 1] / k[0, 0])
        return tangent @ columns

    def _tangent_at(self, x: Array) -> tuple[Array, Array, Array]:
        """d x / d physical coordinates, K and [R | t]; the last two estimates are cached."""
        for known, found in self._tangents:
            if known is x:
                return found
        k, rotation, translation = decompose.split(self.to_matrix(x))
        pose = np.c_[rotation, translation]
        found = self.tangent(k, pose), k, pose
        self._tangents = [*self._tangents[-1:], (x, found)]
        return found

    def moved(self, origin: Array, x: Array) -> bool:
        """Return whether the estimate moved by a hundredth of the entries' size, which is 1."""
        return bool(np.abs(x - origin).max() > MOVED)

    def carry(self, x: Array, walked: Array) -> Array | None:
        """See `Model.carry`: after a rotation of the camera, an error of the principal point is a different error
        of M.

        What the frames have said is linear in M itself, so that the covariance follows the motion of the
        camera only, not the corrections of its estimate.
        """
        if np.abs(walked).max() < WALKED:
            return None
        old, new = self._tangent_at(x - walked)[0], self._tangent_at(x)[0]
        return np.linalg.solve(old.T, new.T).T

    def settle(self, frame: Frame) -> None:
        """Set Hartley's normalisation."""
        self._set(projective.normalisation(frame.xyz), projective.normalisation(frame.uv))

    def start(self, frame: Frame) -> Array:
        """Least median of squares over DLTs of samples."""
        return self.from_matrix(first.projection_matrix(frame.xyz, frame.uv))

    def describe(self, estimates: Sequence[Array], factors: Sequence[Array]) -> Cameras:
        """Split by RQ; the covariance by the inverse of its derivative."""
        k, rotation, translation = decompose.split(self.to_matrix(np.stack(estimates)))
        pose = np.concatenate([rotation, translation[..., None]], -1)
        factor = np.linalg.solve(self.tangent(k, pose), np.stack(factors)[:, :11])
        return Cameras(k, rotation, translation, factor, np.zeros((len(k), 0)))

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore the normalisation."""
        self._set(state["world"], state["image"])
