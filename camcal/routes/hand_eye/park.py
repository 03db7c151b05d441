"""F. Park & B. Martin, Robot sensor calibration: solving AX = XB on the Euclidean group, 1994."""

from __future__ import annotations

from camcal.geometry import rotations as so3
from camcal.model.pose import Pose
from camcal.routes.hand_eye.views import Views


def solve(views: Views) -> tuple[Pose, Pose]:
    """X and Z; the rotation minimises Σ |log A − R log B|², sec. IV, eq. (20)."""
    a, b = views.motions
    return views.from_rotation(so3.fit_rotation(so3.log(a.rotation), so3.log(b.rotation)))
