"""Test that the motions determine a hand-eye transformation: at least three poses, rotated about different axes."""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations as so3
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.routes.hand_eye import NAMES
from camcal.routes.hand_eye.views import Views

#: Two motions, hence three poses, are needed (Tsai & Lenz 1989, sec. II).
LEAST_VIEWS = 3
#: Rotations about a second axis count if they exceed the noise of the camera's rotations by this factor. They appear on
#: both sides of A X = X B, so that relative noise of 1/k biases what they determine by 1/k²: a tenth at 3.
ABOVE_NOISE = 3.0
#: rad; an axis this close to a coordinate axis is named by its letter in messages, followed by its direction
ALONG = np.radians(5)


@dataclass(frozen=True)
class Motions:
    """The rotations of the camera between views.

    Attributes
    ----------
    turns_deg : (3,) array
        Root mean square rotation about the main axis and the two perpendicular ones, over all pairs of views, degrees.
    axes : (3, 3) array
        These axes in the camera's frame, as rows.
    noise_deg : (3,) array
        Standard deviation of the same figures due to image noise.
    """

    turns_deg: Array
    axes: Array
    noise_deg: Array


def measure(cameras: Poses, rotation_covariance: Array) -> Motions:
    """Measure the rotations of the camera.

    Parameters
    ----------
    cameras : Poses
        cam_from_board (V,).
    rotation_covariance : (V, 3, 3) array
        Of the rotation of each, rad², on the left.
    """
    v = so3.log(Views(cameras, cameras).motions[1].rotation)
    values, vectors = np.linalg.eigh(v.T @ v / len(v))
    order = values.argsort()[::-1]
    axes = vectors[:, order].T
    noise = 2 * np.einsum("ki,vij,kj->k", axes, rotation_covariance, axes) / len(cameras)
    return Motions(np.degrees(np.sqrt(np.maximum(values[order], 0))), axes, np.degrees(np.sqrt(noise)))


def require_enough(count: int) -> None:
    """Raise an error for fewer than three poses."""
    if count < LEAST_VIEWS:
        raise DataError(
            f"{count} poses have a view; a hand-eye calibration needs {LEAST_VIEWS}.",
            "Take ten or more poses, rotated about two axes, and check that the names of the views agree.",
        )


def require_two_axes(motions: Motions, setup: str | None = None) -> None:
    """Raise an error for motions that rotate about one axis only, or not at all.

    Raises
    ------
    EstimationError
    """
    first, second = (motions.turns_deg / np.maximum(motions.noise_deg, np.finfo(float).tiny))[:2]
    if second > ABOVE_NOISE:
        return
    unknown = "the hand-eye transformation" if setup is None else NAMES[setup][0]
    if first <= ABOVE_NOISE:
        raise EstimationError(
            f"the camera rotates by {motions.turns_deg[0]:.2g} deg between views, which is noise: without rotations "
            f"{unknown} is undetermined.",
            "Rotate the hand by 30 degrees or more, about two axes.",
        )
    raise EstimationError(
        f"all motions turn about parallel axes, the {_axis(motions.axes[0])} of the camera "
        f"({motions.turns_deg[0]:.3g} deg; {motions.turns_deg[1]:.2g} deg about others, which is noise): the "
        f"translation of {unknown} along that axis is undetermined.",
        "Add poses that are turned about another axis, by 30 degrees or more.",
    )


def _axis(axis: Array) -> str:
    """An axis in words: its letter if it is within 5 degrees of one, and its direction."""
    axis = axis * np.sign(axis[np.abs(axis).argmax()])
    letter = "xyz"[int(np.abs(axis).argmax())]
    words = "(" + " ".join(f"{a:.2f}" for a in axis.round(2) + 0.0) + ")"
    return f"axis {letter} {words}" if np.abs(axis).max() > np.cos(ALONG) else f"axis {words}"
