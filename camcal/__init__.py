"""camcal: camera calibration on the command line, every result cross-checked with OpenCV.

The Python interface is small; the names below are loaded on first use, so that importing camcal is instant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from camcal.version import __version__

if TYPE_CHECKING:  # what `__getattr__` loads, for type checkers
    from camcal.data.observations import (
        Correspondences as Correspondences,
    )
    from camcal.data.observations import (
        Observations as Observations,
    )
    from camcal.data.observations import (
        View as View,
    )
    from camcal.data.points import read_points as read_points
    from camcal.data.rig_table import read_rig as read_rig
    from camcal.model.board import Board as Board
    from camcal.model.camera import Camera as Camera
    from camcal.model.pose import Pose as Pose
    from camcal.model.pose import Poses as Poses
    from camcal.model.rectification import Rectification as Rectification
    from camcal.model.rectification import rectify as rectify
    from camcal.model.rig import Rig as Rig
    from camcal.plan.calibrate import calibrate as calibrate
    from camcal.plan.calibrate import calibrate_many as calibrate_many
    from camcal.plan.images import calibrate_images as calibrate_images
    from camcal.plan.rig import calibrate_rig as calibrate_rig
    from camcal.plan.solution import RigSolution as RigSolution
    from camcal.plan.solution import Solution as Solution
    from camcal.report.hand_eye import HandEye as HandEye
    from camcal.report.hand_eye import hand_eye as hand_eye
    from camcal.report.opening import load as load
    from camcal.report.opening import save_camera as save_camera

_PUBLIC = {
    "Board": "camcal.model.board:Board",
    "Camera": "camcal.model.camera:Camera",
    "Correspondences": "camcal.data.observations:Correspondences",
    "HandEye": "camcal.report.hand_eye:HandEye",
    "Observations": "camcal.data.observations:Observations",
    "Pose": "camcal.model.pose:Pose",
    "Poses": "camcal.model.pose:Poses",
    "Rectification": "camcal.model.rectification:Rectification",
    "Rig": "camcal.model.rig:Rig",
    "RigSolution": "camcal.plan.solution:RigSolution",
    "Solution": "camcal.plan.solution:Solution",
    "View": "camcal.data.observations:View",
    "calibrate": "camcal.plan.calibrate:calibrate",
    "calibrate_many": "camcal.plan.calibrate:calibrate_many",
    "calibrate_images": "camcal.plan.images:calibrate_images",
    "calibrate_rig": "camcal.plan.rig:calibrate_rig",
    "hand_eye": "camcal.report.hand_eye:hand_eye",
    "load": "camcal.report.opening:load",
    "read_points": "camcal.data.points:read_points",
    "read_rig": "camcal.data.rig_table:read_rig",
    "rectify": "camcal.model.rectification:rectify",
    "save_camera": "camcal.report.opening:save_camera",
}

__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        from camcal.registry import load

        return load(_PUBLIC[name])
    raise AttributeError(f"module 'camcal' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
