"""All closed forms on the same views."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.errors import EstimationError
from camcal.model.pose import Pose, Poses
from camcal.records import dataclass
from camcal.registry import load
from camcal.routes.hand_eye import CLOSED_FORM_SUMMARIES, CLOSED_FORMS
from camcal.routes.hand_eye.equation import residuals
from camcal.routes.hand_eye.views import Views


@dataclass(frozen=True)
class Method:
    """The result of a closed form.

    Attributes
    ----------
    name, paper : str
    x, z : Pose, or None if it failed
    translation_rms, rotation_rms : float
        Rms residuals of the robot's poses, in the unit of the data and in rad; NaN if it failed.
    """

    name: str
    paper: str
    x: Pose | None
    z: Pose | None
    translation_rms: float = float("nan")
    rotation_rms: float = float("nan")


def length_unit(views: Views) -> float:
    """The rms of the translations, used as unit because Andreff's and Li's systems mix lengths with numbers of
    order 1.
    """
    t = np.concatenate([views.robot.translation, views.camera.translation])
    return float(np.sqrt(np.square(t).sum(1).mean())) or 1.0


def scaled(views: Views, factor: float) -> Views:
    """Convert the views to another unit of length."""
    robot, camera = (Poses(p.rotation, p.translation * factor) for p in (views.robot, views.camera))
    return Views(robot, camera)


def solve_all(views: Views, setup: str, table: Mapping[str, str] = CLOSED_FORMS) -> list[Method]:
    """Every closed form on the same views, in the order of the table."""
    unit = length_unit(views)
    own = scaled(views, 1 / unit)
    return [_method(name, own, views, setup, unit) for name in table]


def _method(name: str, own: Views, views: Views, setup: str, unit: float) -> Method:
    paper = CLOSED_FORM_SUMMARIES[name].partition(":")[0]
    try:
        with np.errstate(all="ignore"):
            x, z = (Pose(p.rotation, p.translation * unit) for p in load(CLOSED_FORMS[name])(own))
            off = residuals(setup, x, z, views.camera, views.robot_poses(setup))
    except (np.linalg.LinAlgError, EstimationError):
        return Method(name, paper, None, None)
    if not np.isfinite(off).all():
        return Method(name, paper, None, None)
    turn, shift = (float(np.sqrt(np.square(part).sum(1).mean())) for part in (off[:, :3], off[:, 3:]))
    return Method(name, paper, x, z, shift, turn)


def best(methods: list[Method]) -> Method:
    """The closed form with the smallest product of both residuals of the robot's poses, whose order does not depend
    on units.

    Raises
    ------
    EstimationError
        If all failed.
    """
    made = [m for m in methods if m.x is not None]
    if not made:
        raise EstimationError(
            "no closed form yields a hand-eye transformation.", "Add poses rotated about other axes."
        )
    return min(made, key=lambda m: (m.rotation_rms + _TINY) * (m.translation_rms + _TINY))


#: prevents a residual of exactly 0 from hiding the other one
_TINY = float(np.finfo(float).tiny) ** 0.25
