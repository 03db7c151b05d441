"""Views of a board by a camera, or by a rig of several cameras."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from camcal.data.observations import View
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.poses import solve_poses
from camcal.solve.problem import Problem, Seen, State

#: eigenvalues of correlations, relative to the largest, that count as 0 (rounding)
RANK = 1e-12
#: px²; lower limit of a sum of squares, (1e-12 px)²: the noise of exact pictures would be 0, and is a divisor
EXACT = 1e-24


@dataclass(frozen=True)
class Mount:
    """The cameras of a rig.

    Attributes
    ----------
    cameras : tuple of C Camera
        The reference first.
    places : Poses
        cam_from_rig (C,).
    seen : Seen
        Which camera took each picture, and at which instant.
    """

    cameras: tuple[Camera, ...]
    places: Poses
    seen: Seen


@dataclass(frozen=True)
class Pictures:
    """The pictures of V instants.

    Attributes
    ----------
    camera : Camera
        For a rig, its reference camera.
    views : tuple of B View
        The points used: one view per instant, or several for a rig.
    poses : Poses
        Initial cam_from_board (V,), for a rig that of its reference.
    weights : B arrays (N,), or None
    gain : (V, 6, F) array
        Derivatives of the pose of each instant by the F free parameters of the calibration, as `ReducedPoses.gain`.
    camera_covariance : (F, F) array
        Of these.
    mount : Mount or None
        Of a rig.
    """

    camera: Camera
    views: tuple[View, ...]
    poses: Poses
    weights: list[Array] | None
    gain: Array
    camera_covariance: Array
    mount: Mount | None = None

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def seen(self) -> Seen:
        """The camera and the instant of each view."""
        return Seen.alone(len(self.views)) if self.mount is None else self.mount.seen

    def take(self, rows: Array) -> Pictures:
        """Select some of the instants by their indices."""
        place = np.full(len(self), -1)
        place[rows] = np.arange(len(rows))
        instant = place[self.seen.instant]
        kept = np.flatnonzero(instant >= 0)
        if self.mount is None:
            kept = np.asarray(rows, int)
            mount = None
        else:
            mount = replace(self.mount, seen=Seen(self.seen.camera[kept], instant[kept]))
        return replace(
            self,
            views=tuple(self.views[i] for i in kept),
            poses=self.poses[rows],
            weights=None if self.weights is None else [self.weights[i] for i in kept],
            gain=self.gain[rows],
            mount=mount,
        )

    def problem(self) -> Problem:
        """The least-squares problem with the cameras held fixed."""
        if self.mount is None:
            return Problem(self.camera.lens, self.views, np.zeros((self.camera.lens.size, 0)), self.weights)
        lenses = [c.lens for c in self.mount.cameras]
        held = [np.zeros((lens.size, 0)) for lens in lenses]
        return Problem(lenses, self.views, held, self.weights, seen=self.mount.seen)

    def begin(self, problem: Problem) -> State:
        """The state at `poses`."""
        if self.mount is None:
            return problem.state(self.camera.params, self.poses)
        params = np.concatenate([c.params for c in self.mount.cameras])
        return problem.state(params, self.poses, self.mount.places)

    @cached_property
    def camera_root(self) -> Array:
        """L (F, K) with L Lᵀ = `camera_covariance`: it maps unknowns of variance 1 to errors of the camera."""
        values, vectors = np.linalg.eigh(self._scaled_covariance)
        kept = values > RANK * values.max(initial=0.0)
        return np.asarray(self._camera_sigma[:, None] * vectors[:, kept] * np.sqrt(values[kept]))

    @property
    def _camera_sigma(self) -> Array:
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.camera_covariance), 0.0)))

    @property
    def _scaled_covariance(self) -> Array:
        unit = np.where(self._camera_sigma > 0, self._camera_sigma, 1.0)
        return np.asarray(self.camera_covariance / np.outer(unit, unit))

    @property
    def shifts(self) -> Array:
        """d pose / d those unknowns (V, 6, K): rotation about the centroid of a view's points, and its position."""
        return np.asarray(-self.gain @ self.camera_root)

    @property
    def freedom(self) -> int:
        """The number of coordinates minus that of pose parameters and estimated calibration parameters."""
        return 2 * sum(map(len, self.views)) - 6 * len(self) - len(self.camera_covariance)


@dataclass(frozen=True)
class Alone:
    """The poses of the instants from the pictures alone."""

    problem: Problem
    state: State
    sigma: float  #: of an image coordinate, px
    rotation_covariance: Array  #: (V, 3, 3), rad²

    @property
    def poses(self) -> Poses:
        """cam_from_board (V,)."""
        return self.problem.poses(self.state)


def alone(pictures: Pictures) -> Alone:
    """Fit the pose of each instant."""
    problem = pictures.problem()
    found = solve_poses(problem, pictures.begin(problem))
    sigma = float(np.sqrt(max(2 * found.costs.sum(), EXACT) / max(pictures.freedom, 1)))
    normal = problem.pose_normals(found.state, np.arange(problem.instants))[:, :6, :6]
    return Alone(problem, found.state, sigma, sigma**2 * np.linalg.inv(normal)[:, :3, :3])
