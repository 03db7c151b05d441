"""The state of an iteration, its steps, and the normal equations there."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.solve.calibration import NormalBlocks

Array = np.ndarray


def _alone() -> Poses:
    return Poses(np.eye(3)[None], np.zeros((1, 3)))


@dataclass(frozen=True)
class State:
    """The state of an iteration.

    Attributes
    ----------
    params : (P,) array
        Those of all cameras, one camera after the other.
    rotations : (V, 3, 3) array
        rig_from_board of each instant; cam_from_board for a single camera.
    centres : (V, 3) array
        The centroid of each instant's points in the rig's frame.
    shape : (B,) array
        Coordinates of the board's shape, if it is also estimated.
    rig : Poses
        cam_from_rig of each camera; the first one's is the identity.
    """

    params: Array
    rotations: Array
    centres: Array
    shape: Array = field(default_factory=lambda: np.zeros(0))
    rig: Poses = field(default_factory=_alone)


@dataclass(frozen=True)
class Step:
    """A step.

    Attributes
    ----------
    intrinsics : (F,) array
        In the free parameters of all cameras, then in cam_from_rig of all but the first (six each: rotation on the
        left, translation), then in the board's shape.
    poses : (V, 6) array
        In the poses of the instants: rotation on the left about the centroid, translation.
    """

    intrinsics: Array
    poses: Array


@dataclass(frozen=True)
class Blocks:
    """The normal equations at a state, by blocks: `JᵀJ` and the gradient `Jᵀr` of half the squared cost.

    Attributes
    ----------
    cost : float
        ½ Σ w |r|².
    intrinsics : (F, F) array
        In the order of `Step.intrinsics`.
    coupling : (V, F, 6) array
        Zero for the cameras that did not see an instant.
    poses : (V, 6, 6) array
    gradient : (F,) array
    pose_gradients : (V, 6) array
    view_costs : array
        Of each view, without priors.
    """

    cost: float
    intrinsics: Array
    coupling: Array
    poses: Array
    gradient: Array
    pose_gradients: Array
    view_costs: Array

    def normal(self) -> NormalBlocks:
        """The part needed for a covariance."""
        return NormalBlocks(self.intrinsics, self.coupling, self.poses)
