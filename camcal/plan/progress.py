"""The progress of a calibration, and the loop over its plan.

An attempt gets the progress so far and gives a `Change`; the loop takes it in, by the one rule for what is better
(`camcal.plan.better`), and notes the attempt as a stage of the report. Nothing else carries state from one attempt to
the next.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any

from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import Observations
from camcal.errors import CamcalError, DataError, EstimationError, caught, only
from camcal.model.camera import Camera
from camcal.model.lenses.base import Lens
from camcal.model.pose import Poses
from camcal.plan.better import Candidate, better
from camcal.plan.options import Options
from camcal.records import dataclass
from camcal.solve.calibration import Calibration, Estimate, Stage
from camcal.solve.refine import How

#: attempts after others of the same points failed
SECOND_THOUGHTS = ("radial", "from-radial", "other-starts")


@dataclass(frozen=True)
class Begin:
    """A starting point of the refinement: the camera of the current lens, poses, and the closed form's
    assumptions.
    """

    name: str
    camera: Camera
    poses: Poses
    rms_point: float
    held: Mapping[str, float | None] = field(default_factory=dict)
    warnings: tuple[CalibrationWarning, ...] = ()


@dataclass(frozen=True)
class Change:
    """The result of an attempt; None means unchanged.

    Attributes
    ----------
    start : Begin, optional
        Where a refinement may begin from now on.
    fit : Candidate, optional
        A fit; kept where it is better than the one so far, or where `instead` says that it rests on other points.
    instead : bool
        The fit is taken for the one so far without comparing them.
    refused : str
        Why the fit is not taken, whatever it is compared with; empty = it is compared.
    best : Candidate, optional
        The fit so far, with what the attempt found out about it.
    data, given : Observations, optional
        What later attempts work on: the current rows, and all views.
    again : bool
        The camera is to be re-estimated from `data`.
    stage : Stage, optional
        What the report says of the attempt; made from the fit otherwise.
    before : tuple of Stage, optional
        The stages so far, where what they rest on was put another way.
    notes : mapping
        More to keep, by name.
    """

    start: Begin | None = None
    fit: Candidate | None = None
    instead: bool = False
    refused: str = ""
    best: Candidate | None = None
    data: Observations | None = None
    given: Observations | None = None
    again: bool = False
    stage: Stage | None = None
    before: tuple[Stage, ...] | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Progress:
    """The state of a calibration after some attempts.

    Attributes
    ----------
    options : Options
    lens : Lens
    how : How
        How fits are made.
    given : Observations
        All usable views, with the sigmas that were given.
    data : Observations
        What the attempts work on.
    start : Begin or None
    best : Candidate or None
        The best fit so far to `data`.
    plain : Calibration or None
        The least squares fit to all points.
    restarts : int
        How often the camera was re-estimated from points that agree.
    stages : tuple of Stage
    error : CamcalError or None
        Why there is no fit to all points.
    notes : mapping
        `trials` of board shapes, `second_pass`, ...
    """

    options: Options
    lens: Lens
    how: How
    given: Observations
    data: Observations
    start: Begin | None = None
    best: Candidate | None = None
    plain: Calibration | None = None
    restarts: int = 0
    stages: tuple[Stage, ...] = ()
    error: CamcalError | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def estimate(self) -> Estimate:
        """The best fit so far, of a camera or of a rig; attempts that use it apply only if there is one."""
        assert self.best is not None
        return self.best.calibration

    @property
    def fit(self) -> Calibration:
        """The best fit so far of a camera."""
        assert isinstance(self.estimate, Calibration)
        return self.estimate

    def made(self, name: str) -> bool:
        """Return whether an attempt was made since the camera was last re-estimated."""
        return any(s.name == name for s in self.stages[self.notes.get("since", 0) :])

    def after(self, name: str, change: Change, seconds: float) -> Progress:
        """Return the progress after an attempt's result."""
        now, kept, why = self, True, ""
        if change.data is not None:
            now = replace(now, data=change.data)
        if change.given is not None:
            now = replace(now, given=change.given)
        if change.before is not None:
            now = replace(now, stages=change.before)
        if change.again:
            notes = {**now.notes, "since": len(now.stages)}
            now = replace(now, start=None, best=None, restarts=now.restarts + 1, notes=notes)
        if change.best is not None:
            now = replace(now, best=change.best)
        if change.start is not None:
            how = self.options.how(self.lens, change.start.held)
            now = replace(now, start=change.start, how=replace(how, board=self.how.board))
        if change.fit is not None:
            if change.refused:
                kept, why = False, change.refused
            elif not change.instead and now.best is not None:
                kept, why = better(change.fit, now.best)
            if kept:
                now = replace(now, best=change.fit, data=change.fit.calibration.observations)
            made = change.fit.calibration
            if now.plain is None and not now.restarts and isinstance(made, Calibration):
                now = replace(now, plain=made)
        stage = change.stage
        if stage is None and change.fit is not None:
            stage = stage_of(
                name, change.fit.calibration, seconds, {"kept": kept, **({"why": why} if why else {})}
            )
        if stage is not None:
            now = replace(now, stages=(*now.stages, stage))
        return replace(now, notes={**now.notes, **change.notes})

    def failed(self, name: str, error: CamcalError) -> Progress:
        """Return the progress after a failed attempt.

        The error is kept where it says why all points give no camera: that of a second thought (another start, points
        that agree) does not.
        """
        failures = {**self.notes.get("failures", {}), name: error.message}
        now = replace(self, notes={**self.notes, "failures": failures})
        first = not self.restarts and self.best is None and name not in SECOND_THOUGHTS
        return replace(now, error=error) if first else now


def stage_of(name: str, calibration: Estimate, seconds: float, info: Mapping[str, Any]) -> Stage:
    """A fit as a stage of the report."""
    camera = calibration.camera if isinstance(calibration, Calibration) else None
    return Stage(
        name,
        calibration.rms_point,
        None if camera is None else camera.matrix,
        seconds,
        camera=camera,
        poses=calibration.poses,
        view_ids=calibration.observations.view_ids,
        info=info,
    )


@dataclass(frozen=True)
class Attempt:
    """A line of the plan.

    Attributes
    ----------
    name : str
        In the report, and the same for attempts that do the same.
    applies : callable
        Whether it is to be made, from the progress so far.
    make : callable
        What it gives; None where it finds nothing to change.
    together : callable, optional
        `make` for several calibrations at once, in less time; an error in place of what one of them gives.
    """

    name: str
    applies: Callable[[Progress], bool]
    make: Callable[[Progress], Change | None]
    together: Callable[[Sequence[Progress]], Sequence[Change | CamcalError | None]] | None = None


def advance(plan: Iterable[Attempt], progress: Progress) -> Progress:
    """Make the applicable attempts of a plan, in order."""
    return only(advance_all(plan, [progress]))


def advance_all(
    plan: Iterable[Attempt], members: Sequence[Progress | CamcalError]
) -> list[Progress | CamcalError]:
    """Make the applicable attempts of a plan with several calibrations, each attempt with all of them.

    What happens to one of them does not change the others; those that ended with an error are left as they are.
    """
    found = list(members)
    for attempt in plan:
        apply: dict[int, Progress] = {}
        for i, member in enumerate(found):
            if isinstance(member, Progress):
                applies = caught(attempt.applies, member)
                if isinstance(applies, CamcalError):
                    found[i] = applies
                elif applies:
                    apply[i] = member
        if attempt.together is not None and len(apply) > 1:
            begin = time.perf_counter()
            changes = attempt.together(list(apply.values()))
            seconds = (time.perf_counter() - begin) / len(apply)
            for (i, member), change in zip(apply.items(), changes, strict=True):
                found[i] = _after(attempt, member, change, seconds)
            continue
        for i, member in apply.items():
            begin = time.perf_counter()
            change = caught(attempt.make, member)
            found[i] = _after(attempt, member, change, time.perf_counter() - begin)
    return found


def _after(
    attempt: Attempt, progress: Progress, change: Change | CamcalError | None, seconds: float
) -> Progress | CamcalError:
    """The progress after an attempt; an error that does not concern the data ends it."""
    if isinstance(change, EstimationError | DataError):
        return progress.failed(attempt.name, change)
    if isinstance(change, CamcalError):
        return change
    if change is None:
        return progress
    return progress.after(attempt.name, change, seconds)


def follow(plan: Iterable[Attempt], progress: Progress) -> Progress:
    """Make all attempts of a plan.

    Raises
    ------
    CamcalError
        The one that kept all points from giving a camera, where no other attempt found one.
    """
    return only(follow_all(plan, [progress]))


def follow_all(
    plan: Iterable[Attempt], members: Sequence[Progress | CamcalError]
) -> list[Progress | CamcalError]:
    """`follow` a plan with several calibrations, as `advance_all`; the error of one in place of its result."""
    return [_ended(p) if isinstance(p, Progress) else p for p in advance_all(plan, members)]


def _ended(progress: Progress) -> Progress | CamcalError:
    if progress.best is None and progress.plain is not None:
        progress = replace(progress, best=Candidate(progress.plain))
    if progress.best is None:
        assert progress.error is not None
        return progress.error
    return progress
