"""Which camera of a rig took each view, and when."""

from __future__ import annotations

import numpy as np

from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class Seen:
    """The camera and the instant of each of B views.

    Attributes
    ----------
    camera : (B,) int array
        Index of the camera; 0 is the reference, whose frame is the rig's.
    instant : (B,) int array
        Views of the same instant share the pose rig_from_board; all of 0, 1, ... occur, and no camera has two views of
        one instant. Boards that move independently have separate instants.
    """

    camera: Array
    instant: Array

    @classmethod
    def alone(cls, views: int) -> Seen:
        """The views of a single camera, each at its own instant."""
        return cls(np.zeros(views, int), np.arange(views))
