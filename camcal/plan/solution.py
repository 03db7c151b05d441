"""The result of a calibration: the fit that was kept, its stages, and its warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from os import PathLike
from typing import Any

from camcal.assess.warning import SEVERITIES, CalibrationWarning, Grade, grade
from camcal.data.observations import Observations
from camcal.records import dataclass
from camcal.registry import load
from camcal.solve.calibration import Calibration, Estimate, RigCalibration, Stage
from camcal.system.text import counted


@dataclass(frozen=True, repr=False, kw_only=True)
class Judged(Estimate):
    """A fit with its stages, warnings, hold-out and cross-check.

    Attributes
    ----------
    stages : tuple of Stage
        Every attempt on the way, the result itself last (`refine`).
    warnings : tuple of CalibrationWarning
    options : mapping
        The requested options; `{name: value}` or `{name: {value, from}}`.
    crosscheck : tuple of mappings
        Entries of the report: {stage, against, status, why, opencv, difference}.
    holdout : mapping or None
        Figures on views that took no part.
    selection : mapping or None
        How the lens model was found, if none was requested; for a rig by camera.
    """

    stages: tuple[Stage, ...] = ()
    warnings: tuple[CalibrationWarning, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    crosscheck: tuple[Mapping[str, Any], ...] = ()
    holdout: Mapping[str, Any] | None = None
    selection: Mapping[str, Any] | None = None

    def option(self, name: str) -> Any:
        """The value of an option; None if it was not given."""
        value = self.options.get(name)
        return value.get("value") if isinstance(value, Mapping) else value

    @property
    def failures(self) -> list[str]:
        """The failed gates, a sentence each: a failed cross-check, `max_rms`, a warning of `fail_on`."""
        fallen = [
            f"cross-check of stage '{e['stage']}' against {e['against']}: {e.get('why') or 'failed'}"
            for e in self.crosscheck
            if e["status"] == "fail" and e["stage"] == "refine"  # earlier stages do not decide
        ]
        bound = self.option("max_rms")
        # in this form the comparison also fails for NaN
        if bound is not None and not self.rms_point <= float(bound):
            fallen.append(f"rms_point {self.rms_point:.6g} px exceeds --max-rms {float(bound):g}")
        bar = self.option("fail_on") or "wrong"
        for warning in self.warnings if bar != "never" else ():
            if SEVERITIES.index(warning.severity) >= SEVERITIES.index(bar):
                fallen.append(f"graded {warning.severity}: {warning.message.rstrip('.')}")
        return fallen

    @property
    def grade(self) -> Grade:
        """The worst severity among the warnings: `good`, `doubtful` or `wrong`."""
        return grade(self.warnings)

    @property
    def verdict(self) -> str:
        """`pass`, or `fail` if a gate failed."""
        return "fail" if self.failures else "pass"


@dataclass(frozen=True, repr=False, kw_only=True)
class Solution(Judged, Calibration):
    """The calibration of a camera: the result of `camcal.calibrate`, and of `camcal.load` for a report.

    Attributes
    ----------
    camera : Camera
        The estimated camera.
    start : Camera
        The camera from which the refinement started.
    poses : Poses
        cam_from_board of each view (V); translations in the unit of the points.
    observations : Observations
        The data; `used` marks the points that the fit rests on.
    residuals : (N, 2) array
        Predicted - observed of every row of the observations, px; NaN outside the lens's domain.
    rms_point : float
        sqrt(Σ |r|² / N) over the used points, px.
    warnings : tuple of CalibrationWarning
        Each with `code`, `message`, `hint` and `severity`.
    verdict : str
        `pass`, or `fail` if a gate failed; `failures` has a sentence for each.
    grade : str
        `good`, `doubtful` or `wrong`: the worst severity of the warnings.
    stages : tuple of Stage
        Every attempt on the way, the result itself last (`refine`).
    holdout, crosscheck, selection, options
        As in the report (docs/report.md).
    board : ShapedBoard or None
        The estimated shape of the board.
    fit : Fit
        Statistics of the search; `normal` and `free` are its normal equations, for covariances.
    second_pass : mapping or None
        What the second pass over the pictures did.
    points : Observations or None
        All views that could be used, with the points as the second pass left them.
    """

    second_pass: Mapping[str, Any] | None = None
    points: Observations | None = None

    def __repr__(self) -> str:
        said = f", {counted(len(self.warnings), 'warning')}" if self.warnings else ""
        return (
            f"<Solution: {self.camera.lens.name}, {counted(len(self.poses), 'view')}, rms {self.rms_point:.4g} px, "
            f"{self.verdict}{said}>"
        )

    def _repr_html_(self) -> str:
        """Return the camera as an HTML table, for notebooks."""
        return str(load("camcal.report.notebook:table")(self))

    def save(self, path: str | PathLike, force: bool = False) -> None:
        """Write the report.

        Raises
        ------
        UsageError
            If the file exists and `force` is not given.
        """
        load("camcal.report.document:save")(load("camcal.report.document:document")(self), path, force)


@dataclass(frozen=True, repr=False, kw_only=True)
class RigSolution(Judged, RigCalibration):
    """The calibration of a rig: the result of `camcal.calibrate_rig`, and of `camcal.load` for a report of a rig.

    The other attributes are those of `Solution`.

    Attributes
    ----------
    rig : Rig
        The estimated cameras with their poses cam_from_rig.
    start : Rig
        The rig from which the refinement started.
    poses : Poses
        rig_from_board of each instant (V); translations in the unit of the points.
    links : mapping of (camera, camera) -> mapping
        What each two cameras that saw a board at the same instant know of each other.
    """

    links: Mapping[tuple[str, str], Mapping[str, Any]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (
            f"<RigSolution: {', '.join(self.rig.cameras)}; {len(self.poses)} instants, rms {self.rms_point:.4g} px, "
            f"{self.verdict}>"
        )

    def save(self, path: str | PathLike, force: bool = False) -> None:
        """Write the report; UsageError if the file exists and `force` is not given."""
        load("camcal.report.document:save")(load("camcal.report.rig:document")(self), path, force)


def of_fit(fit: Calibration, **more: Any) -> Solution:
    """A fit as a solution, with its warnings and other results."""
    return Solution(**{f.name: getattr(fit, f.name) for f in fields(Calibration)}, **more)
