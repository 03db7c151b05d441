"""A hand-eye calibration as `hand_eye` of a report, as a table, and in Python."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.assess.warning import CalibrationWarning, Grade
from camcal.data.labelled import read_labelled
from camcal.data.robot_poses import RobotPoses, read_robot_poses
from camcal.model.pose import Array, Pose
from camcal.plan.hand_eye import Asked, Found, find
from camcal.plan.solution import RigSolution, Solution
from camcal.records import dataclass
from camcal.report.camera import sigma_entry
from camcal.report.document import document, save
from camcal.report.loading import from_document
from camcal.report.plain import plain
from camcal.report.rig import document as rig_document
from camcal.report.rig_loading import from_document as rig_of_document
from camcal.report.rig_loading import is_rig_report
from camcal.report.yaml import read_document
from camcal.routes.hand_eye import NAMES
from camcal.routes.hand_eye.estimate import Estimate, implied
from camcal.schema import check


@dataclass(frozen=True, repr=False)
class HandEye:
    """A hand-eye calibration.

    Attributes
    ----------
    solution : Solution or RigSolution
        The underlying calibration, with the warnings of both.
    section : mapping
        `hand_eye` of the report; docs/report.md explains its keys.
    """

    solution: Solution | RigSolution
    section: Mapping[str, Any]

    @property
    def setup(self) -> str:
        """`in-hand` or `to-hand`."""
        return str(self.section["setup"])

    @property
    def names(self) -> tuple[str, str]:
        """The names of `transform` and `other`: hand_from_camera and base_from_board, or the like."""
        return NAMES[self.setup]

    @property
    def transform(self) -> Pose:
        """hand_from_camera, or base_from_camera."""
        return self._pose(0)

    @property
    def other(self) -> Pose:
        """base_from_board, or hand_from_board."""
        return self._pose(1)

    @property
    def sigma_rotation_deg(self) -> Array:
        """Standard deviations (3,) of the rotation of `transform` about the axes of its first frame, degrees."""
        return np.array(self.section[self.names[0]]["sigma_rotation_deg"], float)

    @property
    def sigma_translation(self) -> Array:
        """Standard deviations (3,) of the translation of `transform`."""
        return np.array(self.section[self.names[0]]["sigma_translation"], float)

    @property
    def warnings(self) -> tuple[CalibrationWarning, ...]:
        """The warnings of the calibration and of the hand-eye calibration."""
        return self.solution.warnings

    @property
    def verdict(self) -> str:
        """`pass`, or `fail` if a gate failed."""
        return self.solution.verdict

    @property
    def grade(self) -> Grade:
        """The worst severity among the warnings."""
        return self.solution.grade

    def save(self, path: str | os.PathLike, force: bool = False) -> None:
        """Write the report; raises UsageError if the file exists and `force` is not given."""
        save(self.document(), path, force)

    def document(self, command: Sequence[str] = ()) -> dict[str, Any]:
        """The report of the calibration, with `hand_eye`."""
        if isinstance(self.solution, RigSolution):
            made = rig_document(self.solution, command=command)
        else:
            made = document(self.solution, command=command)
        return {**made, "hand_eye": plain(self.section)}

    def __repr__(self) -> str:
        """Return one line."""
        x, robot = self.transform, self.section["robot"]
        t = " ".join(f"{c:.5g}" for c in x.translation)
        return f"<HandEye {self.names[0]}: ({t}), robot {robot['translation_rms']:.3g}, {self.verdict}>"

    def _pose(self, which: int) -> Pose:
        return Pose.from_entry(self.section[self.names[which]])


def hand_eye(
    solution: Solution | RigSolution,
    poses: str | os.PathLike | RobotPoses,
    *,
    rotation: str | None = None,
    times: str | os.PathLike | Mapping[str, float] | None = None,
    **asked: Any,
) -> HandEye:
    """Calibrate a camera on a robot's hand, or one beside the robot that sees a board in its hand.

    Parameters
    ----------
    solution : Solution or RigSolution
        What `camcal.calibrate_images` or `camcal.calibrate_rig` returns, or `camcal.load` of a report of one camera.
    poses : path or RobotPoses
        base_from_hand of each view: a table `view,x,y,z,rx,ry,rz` (docs/hand-eye.md).
    rotation : str, optional
        How the robot writes rotations, as for `--rotation`; recognised by default.
    times : path or mapping, optional
        Times of views, s, if the poses have times instead of views.
    **asked
        setup ("in-hand", "to-hand"), inverse, poses_unit, max_offset, robust, crosscheck: the options of
        `camcal hand-eye`.

    Returns
    -------
    HandEye

    Raises
    ------
    DataError, UsageError, EstimationError
        See `camcal.plan.hand_eye.find`.
    """
    robot = poses if isinstance(poses, RobotPoses) else read_robot_poses(poses, rotation)
    given = times if times is None or isinstance(times, Mapping) else read_times(times)
    found = find(solution, robot, Asked(times=given, **asked))
    whole = replace(
        solution,
        warnings=(*solution.warnings, *found.warnings),
        crosscheck=(*solution.crosscheck, *found.crosscheck),
    )
    return HandEye(whole, plain(section(found)))


def load_calibration(path: str | os.PathLike) -> Solution | RigSolution:
    """The calibration of a report, of one camera or of a rig, with its data; raises DataError as `camcal.load`."""
    found = read_document(path)
    check(found, str(path))
    return (rig_of_document if is_rig_report(found) else from_document)(found, str(path))


def load_hand_eye(path: str | os.PathLike) -> HandEye:
    """The hand-eye calibration of a report; raises DataError as `camcal.load`."""
    return HandEye(load_calibration(path), read_document(path)["hand_eye"])


def read_times(path: str | os.PathLike) -> dict[str, float]:
    """Times of views, s, from a table view,time."""
    table = read_labelled(Path(path), ["view"], ["time"])
    names = (table.names["view"][i] for i in table.labels["view"])
    return dict(zip(names, table.values["time"].tolist(), strict=True))


def section(found: Found) -> dict[str, Any]:
    """The report's `hand_eye`."""
    made = found.estimate
    first, second = NAMES[made.setup]
    sigma, reach = made.sigma, made.half_width
    out: dict[str, Any] = {
        "setup": made.setup,
        first: _known(made.x, made.covariance[:6, :6], sigma[:6], reach[:6]),
        second: _known(made.z, made.covariance[6:, 6:], sigma[6:], reach[6:]),
        "robot": _robot(made),
        "image": {"rms_point": made.image_rms, "sigma": made.noise.image},
        "poses": len(made.used),
        "outliers": len(found.names) - len(made.used),
        "rotation": found.reading.form.name,
        "methods": [_method(m) for m in made.methods],
        "motions": {f: getattr(made.motions, f) for f in ("turns_deg", "axes", "noise_deg")},
        "scale": _estimated(found.scale, found.scale_sigma),
    }
    if found.camera:
        keys = ("value", "sigma", "before", "sigma_before")
        out["camera"] = {n: dict(zip(keys, row, strict=True)) for n, row in found.camera.items()}
    if made.offset is not None:
        out["time_offset"] = _estimated(made.offset, made.offset_sigma)
    return {**out, "views": _views(found), "next": [_next(s) for s in found.suggestions]}


def _known(pose: Pose, covariance: Array, sigma: Array, reach: Array) -> dict[str, Any]:
    return {
        **pose.entry(),
        **sigma_entry(sigma),
        "interval_rotation_deg": np.degrees(reach[:3]),
        "interval_translation": reach[3:],
        "covariance": covariance,
    }


def _robot(made: Estimate) -> dict[str, Any]:
    _, turn, shift = made.relative
    degrees = float(np.degrees(made.noise.rotation))
    return {
        "translation_rms": made.translation_rms,
        "rotation_rms_deg": float(np.degrees(made.rotation_rms)),
        "translation_sigma": _estimated(made.noise.translation, made.noise.translation * shift),
        "rotation_sigma_deg": _estimated(degrees, degrees * turn),
    }


def _estimated(value: float, sigma: float | None) -> dict[str, Any]:
    known = sigma is not None and np.isfinite(sigma)
    return {"value": value if np.isfinite(value) else None, "sigma": sigma if known else None}


def _method(method: Any) -> dict[str, Any]:
    pose = {"rotation_vector": None, "translation": None} if method.x is None else method.x.entry()
    known = method.x is not None
    return {
        "name": method.name,
        "paper": method.paper,
        **pose,
        "translation_rms": method.translation_rms if known else None,
        "rotation_rms_deg": float(np.degrees(method.rotation_rms)) if known else None,
    }


def _views(found: Found) -> list[dict[str, Any]]:
    made = found.estimate
    robot = implied(made)
    at = {int(place): i for i, place in enumerate(made.used)}
    out: list[dict[str, Any]] = []
    for place, name in enumerate(found.names):
        if place not in at:
            out.append({"id": name, "status": "outlier"})
            continue
        i = at[place]
        out.append(
            {
                "id": name,
                "status": "used",
                "base_from_hand": robot[i].entry(),
                "translation_residual": made.residuals[i, 3:],
                "rotation_residual_deg": float(np.degrees(np.linalg.norm(made.residuals[i, :3]))),
            }
        )
    return out


def _next(suggestion: Any) -> dict[str, Any]:
    return {
        "base_from_hand": suggestion.base_from_hand.entry(),
        "cam_from_board": suggestion.cam_from_board.entry(),
        **sigma_entry(suggestion.sigma),
    }
