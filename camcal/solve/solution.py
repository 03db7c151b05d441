"""What a calibration gives: the camera, the poses, and how they were found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences
from camcal.model.camera import Camera
from camcal.model.pose import Poses

Array = np.ndarray


@dataclass(frozen=True)
class CalibrationWarning:
    """Something that makes the result less than it seems; `code` names it for programs."""

    code: str
    message: str
    hint: str = ""


@dataclass(frozen=True)
class Stage:
    """One estimate on the way to the solution, with its own figures.

    `rms_point` is in px over the used points; `projection_matrix` (3, 4) only for a single view;
    `info` holds what the stage has to say besides (condition numbers, why it was chosen).
    """

    name: str
    rms_point: float
    matrix: Array | None
    seconds: float
    projection_matrix: Array | None = None
    camera: Camera | None = None
    poses: Poses | None = None
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """How the refinement went."""

    optimizer: str
    loss: str
    iterations: int
    evaluations: int
    converged: bool
    stop_reason: str
    cost: float  #: half the weighted sum of squares
    seconds: float
    trace: tuple[float, ...] = ()
    #: (iteration, cost, evaluations, seconds) of the start and of every step that was kept
    samples: tuple[tuple[int, float, int, float], ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class NormalBlocks:
    """The blocks of JᵀJ at the solution: what a covariance needs, without the matrix that is zero elsewhere.

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
class Solution:
    """A calibration with all that a later stage needs.

    Attributes
    ----------
    camera : Camera
    poses : Poses
        cam_from_board of each view in `correspondences.views`.
    correspondences : Correspondences
        The views that were used; those left out are in its `skipped`.
    residuals : tuple of (N, 2) arrays
        Predicted - observed of each view, px, rejected points included.
    inliers : tuple of (N,) bool arrays
        Which points the solution rests on.
    start : Camera
        Where the refinement began.
    free : (P, F) array
        d params / d free parameters; a row of zeros is a fixed parameter.
    normal : NormalBlocks
        Of the weighted problem at the solution, unit weight = 1 px.
    """

    camera: Camera
    poses: Poses
    correspondences: Correspondences
    residuals: tuple[Array, ...]
    inliers: tuple[Array, ...]
    start: Camera
    free: Array
    normal: NormalBlocks
    fit: Fit
    stages: tuple[Stage, ...] = ()
    warnings: tuple[CalibrationWarning, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    crosscheck: tuple[Mapping[str, Any], ...] = ()
    holdout: Mapping[str, Any] | None = None
    extras: Mapping[str, Any] = field(default_factory=dict)
    weights: tuple[Array, ...] | None = None  #: of a robust loss, 0 to 1, (N,) a view

    @property
    def used_residuals(self) -> Array:
        """Residuals (M, 2) of the points the solution rests on, px."""
        return np.concatenate(self.residuals)[np.concatenate(self.inliers)]

    @property
    def rms_point(self) -> float:
        """sqrt(sum |r|² / N) over the used points, px: the figure cv2 and Zhang print."""
        r = self.used_residuals
        return float(np.sqrt(np.einsum("ij,ij->", r, r) / max(len(r), 1)))

    @property
    def free_count(self) -> int:
        """Number of estimated parameters, poses and the board's shape included."""
        return self.free.shape[1] + 6 * len(self.poses)

    @property
    def failures(self) -> list[str]:
        """The gates that fell, each as a sentence: a cross-check, an rms_point above the option `max_rms`."""
        fallen = [
            f"cross-check of stage '{e['stage']}' against {e['against']}: {e.get('why') or 'failed'}"
            for e in self.crosscheck
            if e["status"] == "fail"
        ]
        bound = self.options.get("max_rms")
        if isinstance(bound, Mapping):
            bound = bound.get("value")
        # written so that a NaN falls, too
        if bound is not None and not self.rms_point <= float(bound):
            fallen.append(f"rms_point {self.rms_point:.6g} px exceeds --max-rms {float(bound):g}")
        return fallen

    @property
    def verdict(self) -> str:
        """`fail` where a gate fell, else `pass`."""
        return "fail" if self.failures else "pass"
