"""The interface of models: the quantity that is tracked and how points depend on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.track.decompose import Cameras
from camcal.track.frames import Frame
from camcal.track.keep import Kept

Array = np.ndarray

#: of the scale of a quantity (entries of M, focal length, distance): an estimate that is farther from the place of its
#: equations has moved
MOVED = 0.01


class Model(Kept, ABC):
    """Cameras with p local coordinates.

    What it has taken from the data (its normalisation) is `kept` in checkpoints.

    Attributes
    ----------
    size : int
        p.
    min_points : int
        The fewest points that say something about all of it.
    start_points : int
        The fewest points to start from.
    extra_names : tuple of str
        What it has beyond K, R, t.
    lens_name : str
        The lens model of its cameras.
    has_skew : bool
    """

    size: int
    min_points: int
    start_points: int
    extra_names: tuple[str, ...] = ()
    lens_name = "pinhole"
    has_skew = True

    @abstractmethod
    def linearise(self, x: Any, frame: Frame) -> tuple[Array, Array]:
        """Predict the points of a frame.

        Returns
        -------
        design : (p + 1, 2, N) array
            Rows 0 to p - 1: d(u, v) / d local coordinates; the last row: observed - predicted, px.
        valid : (N,) bool array
            Points that the camera can see; the columns of the others mean nothing.
        """

    @abstractmethod
    def retract(self, x: Any, delta: Array) -> Any:
        """Move an estimate by `delta` (p,) in its local coordinates."""

    @abstractmethod
    def local(self, origin: Any, x: Any) -> Array:
        """The `delta` (p,) with retract(origin, delta) = x."""

    @abstractmethod
    def motion(self, x: Any, figures: Mapping[str, float]) -> Array:
        """A factor (p, c) of the covariance of a motion (camcal.track.motion) in local coordinates."""

    @abstractmethod
    def moved(self, origin: Any, x: Any) -> bool:
        """Return whether x is so far from the origin that the derivatives have changed."""

    def carry(self, x: Any, walked: Array) -> Array | None:
        """The map (p, p) that preserves the physical meaning of uncertainties and velocities as the camera moves.

        None where there is nothing to do: where the local coordinates are physical already, or the camera has
        hardly moved.

        Parameters
        ----------
        walked : (p,) array
            How far the camera has moved, to x, since this was last done.
        """
        del x, walked
        return None

    @abstractmethod
    def settle(self, frame: Frame) -> None:
        """Take constants from the first frame: the position and size of the set of points."""

    @abstractmethod
    def start(self, frame: Frame) -> Any:
        """A rough estimate from one frame, robust against outliers.

        Raises
        ------
        EstimationError
            If the points do not determine a camera.
        DataError
            If they contradict every camera.
        """

    def prior(self, x: Any) -> Array | None:
        """A factor (p, p) of the prior covariance before the first frame, or None for no prior."""
        return None

    @abstractmethod
    def describe(self, estimates: Sequence[Any], factors: Sequence[Array]) -> Cameras:
        """K, R, t of many estimates at once, with the factors of their covariances."""
