"""The ratio between the robot's and the board's units of length."""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError
from camcal.model.pose import Array
from camcal.routes.hand_eye.recognise import Reading
from camcal.routes.hand_eye.shah import rotations_of
from camcal.routes.hand_eye.views import Views

#: millimetres in the units that a length may have
MILLIMETRES = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
UNKNOWNS = 4  #: the translation and the ratio of the lengths
#: Units of length differ by 2.54 (cm and in) or more; boards are printed true to a few percent.
SAME_UNIT = 1.5
#: largest relative difference between the ratio of lengths and that of two units: a tenth, for the same reason
NEAR_UNIT = 0.1
#: Standard deviations above which the board's and the robot's lengths differ: once in two million by chance.
DIFFERENT = 5.0


def scale(views: Views) -> tuple[float, float]:
    """The ratio of the robot's translations to those predicted from the board's lengths, and its standard deviation.

    Least squares for (R_A − I) t_X − k R_X t_B = −t_A with an unknown k, which is 1 if both have the same unit.
    Without rotations about two axes k is undetermined: NaN.
    """
    a, b = views.motions
    rotation: Array = rotations_of(views.robot.rotation, views.camera.rotation)[0]
    left = np.concatenate([a.rotation - np.eye(3), -(b.translation @ rotation.T)[:, :, None]], 2).reshape(
        -1, 4
    )
    unit = np.sqrt(np.square(left).sum(0))
    left = left / np.where(unit > 0, unit, 1.0)
    right = -a.translation.ravel()
    solved, _, rank, _ = np.linalg.lstsq(left, right, rcond=1e-6)
    freedom = 3 * (len(views) - 1) - UNKNOWNS
    if rank < UNKNOWNS or freedom < 1:
        return float("nan"), float("nan")
    # M pairs, but V - 1 independent motions: matrix and squares grow with M, the degrees of freedom do not
    rest = np.square(left @ solved - right).sum() / freedom
    return float(solved[3] / unit[3]), float(np.sqrt(np.linalg.inv(left.T @ left)[3, 3] * rest) / unit[3])


def require_same_unit(factor: float, unit: str | None, other: Reading | None = None) -> None:
    """Raise an error if the poses' lengths are in another unit than the board's.

    Parameters
    ----------
    factor : float
        From `scale`.
    unit : str or None
        Unit of the report.
    other : Reading, optional
        A reading that fits the poses far better than the requested one.

    Raises
    ------
    DataError
    """
    if not np.isfinite(factor) or 1 / SAME_UNIT < abs(factor) < SAME_UNIT:
        return
    if other is not None:
        raise DataError(
            f"the robot moves {abs(factor):.4g} times as far as the pictures imply, and its poses fit far better as "
            f"{other.words}.",
            f"Try: --setup {other.setup} --rotation {other.form.name}",
        )
    guess = next((u for u, mm in MILLIMETRES.items() if _is(factor, mm, unit)), None)
    of = f"the report's unit ({unit})" if unit in MILLIMETRES else "the report's unit"
    raise DataError(
        f"the robot moves {abs(factor):.4g} times as far as the pictures imply in {of}: the poses are in another unit"
        + ("." if guess else ", or their rotations have another convention."),
        f"If the poses are in {guess}, specify --poses-unit {guess}."
        if guess
        else "Give the side of a square with its unit (--square 25mm), and --poses-unit; check the order of the "
        "rotation's numbers (--rotation).",
    )


def _is(factor: float, millimetres: float, unit: str | None) -> bool:
    """Return whether poses in a given unit would explain the ratio."""
    return unit in MILLIMETRES and abs(abs(factor) * millimetres / MILLIMETRES[unit] - 1) < NEAR_UNIT
