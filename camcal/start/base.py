"""The result of a closed-form estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any, Protocol

import numpy as np

from camcal.data.dlt_table import NO_DEPTH
from camcal.data.observations import Correspondences
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class ClosedForm:
    """A pinhole camera and the pose of each view.

    Attributes
    ----------
    name : str
        Its key in `CLOSED_FORMS`.
    matrix : (3, 3) array
        K, px, with K[2, 2] = 1; its skew is the estimate, or 0 if that is assumed.
    poses : Poses
        cam_from_board of each view, in the order of the correspondences.
    projection_matrix : (3, 4) array or None
        For a single view; scaled to m34 = 1 unless m34 is near 0.
    info : mapping
        `why` (str), `assumptions` (list of str) and the estimator's own figures: condition numbers,
        `degenerate` (bool), `mirrored` (bool).
    camera : Camera or None
        With the distortion, if the estimator finds one; the refinement then starts from it.
    """

    name: str
    matrix: Array
    poses: Poses
    projection_matrix: Array | None = None
    info: Mapping[str, Any] = field(default_factory=dict)
    camera: Camera | None = None


class Estimator(Protocol):
    """An entry of the table."""

    def __call__(
        self, correspondences: Correspondences, skew: bool = False, normalise: bool = True
    ) -> ClosedForm:
        """Estimate from all views; `skew` allows a skew in the camera matrix.

        `normalise=False` leaves coordinates and columns unscaled, to show the benefit of their scaling.
        """
        ...


def scaled(matrix: Array) -> Array:
    """A projection matrix (3, 4) with m34 = 1 if possible, otherwise of unit norm.

    m34 counts as zero below `NO_DEPTH` of the matrix's largest entry.
    """
    if abs(matrix[2, 3]) > NO_DEPTH * np.abs(matrix).max():
        return matrix / matrix[2, 3]
    return matrix / np.linalg.norm(matrix)
