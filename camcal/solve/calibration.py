"""The result of a fit: the camera or the rig, the poses, the board, and statistics of the search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from camcal.data.observations import Observations
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.model.rig import Rig
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class Stage:
    """One attempt of the plan, with its own figures.

    Attributes
    ----------
    name : str
        Name of the attempt; for a closed form its key in the table of closed forms.
    rms_point : float
        px, over the points used by the solution.
    matrix : (3, 3) array or None
        K, px.
    seconds : float
    projection_matrix : (3, 4) array or None
        Of a single view.
    camera : Camera or None
    poses : Poses or None
        cam_from_board of each view.
    view_ids : tuple of str
        Which views these are.
    info : mapping
        Further results: condition numbers, why the attempt was chosen, whether it was kept.
    """

    name: str
    rms_point: float
    matrix: Array | None
    seconds: float
    projection_matrix: Array | None = None
    camera: Camera | None = None
    poses: Poses | None = None
    view_ids: tuple[str, ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """Statistics of the search for a minimum."""

    optimizer: str
    loss: str
    iterations: int
    evaluations: int
    converged: bool
    stop_reason: str
    cost: float  #: half the weighted sum of squares
    seconds: float
    #: (iteration, cost, evaluations, seconds) of the start and of every step that was kept
    samples: tuple[tuple[int, float, int, float], ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)  # compared by identity: derived quantities are cached by object
class NormalBlocks:
    """The blocks of JᵀJ at the solution, which suffice for a covariance; the rest of the matrix is zero.

    Attributes
    ----------
    intrinsics : (F, F) array
        Free parameters of the camera (and of the board's shape), all views added up.
    coupling : (V, F, 6) array
        Between those and the pose of each view; pose = (rotation on the left, translation).
    poses : (V, 6, 6) array
    """

    intrinsics: Array
    coupling: Array
    poses: Array


@dataclass(frozen=True)
class ShapedBoard:
    """A board whose shape was estimated together with the camera.

    Attributes
    ----------
    kind : str
    ideal : (M, 3) array
        The points as designed, unit of the data.
    points : (M, 3) array
        The estimated points, in the frame and at the scale in which they are closest to the ideal ones.
    size : int
        Number of parameters B of the shape.
    basis : (3 M, B) array, or (B,) int array
        As in `Board`.
    placed : int
        For several boards: number of leading parameters that are poses of boards.
    label, numbers : (M,) int arrays or None
        For several boards: the board of each point, and the point's number.
    """

    kind: str
    ideal: Array
    points: Array
    size: int
    basis: Array | None = None
    placed: int = 0
    label: Array | None = None
    numbers: Array | None = None

    def directions(self) -> Array:
        """d X / d θ (3 M, B) as a full matrix."""
        assert self.basis is not None
        return self.basis if self.basis.ndim == 2 else np.eye(3 * len(self.points))[:, self.basis]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The common part of a fit of one camera and of a rig.

    Attributes
    ----------
    poses : Poses
        cam_from_board of each view of the observations; for a rig, rig_from_board of each instant.
    observations : Observations
        `used` marks the points of the fit, `weight` holds their robust weights; if the board's shape was estimated,
        `xyz` are the estimated points.
    residuals : (N, 2) array
        Predicted - observed of every row, px, unused ones included; NaN outside the lens's domain.
    free : (P, F) array
        d params / d variables, the parameters of all cameras one after the other; a row of zeros is a fixed
        parameter, a column of zeros a variable of the rig or of the board's shape.
    normal : NormalBlocks
        Of the weighted problem at the solution, unit weight = 1 px.
    fit : Fit
    board : ShapedBoard or None
    """

    poses: Poses
    observations: Observations
    residuals: Array
    free: Array
    normal: NormalBlocks
    fit: Fit
    board: ShapedBoard | None = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, in the order of the observations."""
        raise NotImplementedError

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters; for a rig `left.fx`."""
        raise NotImplementedError

    @property
    def used(self) -> Array:
        """Return which rows (N,) the fit used."""
        return self.observations.used

    @property
    def used_residuals(self) -> Array:
        """Residuals (M, 2) of the points used in the fit, px."""
        return self.residuals if self.used.all() else self.residuals[self.used]

    @property
    def rms_point(self) -> float:
        """sqrt(Σ |r|² / N) over the used points, px: the rms as reported by cv2 and Zhang."""
        r = self.used_residuals
        return float(np.sqrt(np.einsum("ij,ij->", r, r) / max(len(r), 1)))

    @property
    def free_count(self) -> int:
        """Number of estimated parameters, including poses and the board's shape."""
        return self.free.shape[1] + 6 * len(self.poses)


@dataclass(frozen=True, kw_only=True)
class Calibration(Estimate):
    """A fit of one camera, with everything that later stages need; `start` is the starting point of the search."""

    camera: Camera
    start: Camera

    def __repr__(self) -> str:
        return f"<Calibration: {self.camera.lens.name}, {len(self.poses)} views, rms {self.rms_point:.4g} px>"

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The one camera."""
        return (self.camera,)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its parameters."""
        return tuple(self.camera.lens.names)

    @property
    def held(self) -> dict[str, float | None]:
        """The parameters that were not estimated, as `fix` of another fit that holds them at its start."""
        return {n: None for n, free in zip(self.names, np.any(self.free, axis=1), strict=True) if not free}


@dataclass(frozen=True, kw_only=True)
class RigCalibration(Estimate):
    """A fit of a rig; `start` is the starting point of the search.

    The cameras are in the order of the observations, the reference first. The variables are the free parameters of
    all cameras, six for each cam_from_rig but the reference's (rotation on the left, rad; translation), then the
    board's shape.
    """

    rig: Rig
    start: Rig

    def __repr__(self) -> str:
        names = ", ".join(self.rig.cameras)
        return f"<RigCalibration: {names}; {len(self.poses)} instants, rms {self.rms_point:.4g} px>"

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, the reference first."""
        return tuple(self.rig.cameras.values())

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters: `left.fx`."""
        return tuple(f"{n}.{p}" for n, c in self.rig.cameras.items() for p in c.lens.names)

    @property
    def extrinsics(self) -> Mapping[str, slice]:
        """The variables of each cam_from_rig; none for the reference or for poses that were held."""
        size, own = 0 if self.board is None else self.board.size, int(self.free.any(0).sum())
        begin = self.free.shape[1] - size - 6 * (len(self.cameras) - 1)
        if begin < own:
            return {}
        others = [n for n in self.rig.cameras if n != self.rig.reference]
        return {n: slice(begin + 6 * i, begin + 6 * i + 6) for i, n in enumerate(others)}
