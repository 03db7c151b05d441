"""Refinements of many cameras at once; those with equations of the same size form one batch."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from camcal.data.observations import Observations
from camcal.errors import CamcalError, caught
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.solve.calibration import Calibration
from camcal.solve.optimizers import lm
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import How, Posed, calibration, posed, refine
from camcal.solve.stack import alike, stackable


class Task(NamedTuple):
    """The arguments of `refine` for one camera."""

    start: Camera
    poses: Poses
    observations: Observations
    how: How


def refine_all(tasks: Sequence[Task]) -> list[Calibration | CamcalError]:
    """`refine` every camera; the error of a camera in place of its result.

    Cameras of one lens with as many free parameters and views as others are one batch, and the result of each is the
    same in any company. The others, and those that end in a way of their own, are refined by themselves.
    """
    found: dict[int, Calibration] = {}
    alike_: dict[Any, list[int]] = {}
    made: dict[int, Posed] = {}
    for i, task in enumerate(tasks):
        if not _ordinary(task.how):
            continue
        one = caught(posed, *task)
        if isinstance(one, CamcalError):
            continue  # raised again below
        if stackable(one.problem):
            made[i] = one
            alike_.setdefault((alike(one.problem), task.how.stopping), []).append(i)
    for some in alike_.values():
        begin = time.perf_counter()
        problems, states = ([getattr(made[i], n) for i in some] for n in ("problem", "state"))
        results = lm.minimise_together(problems, states, tasks[some[0]].how.stopping)
        seconds = (time.perf_counter() - begin) / len(some)
        for i, result in zip(some, results, strict=True):
            if result is not None:
                fit = calibration(
                    made[i].start, made[i].problem, result, tasks[i].observations, "lm", seconds
                )
                assert isinstance(fit, Calibration)
                found[i] = fit
    return [found[i] if i in found else caught(_alone, task) for i, task in enumerate(tasks)]


def _ordinary(how: How) -> bool:
    """Return whether a search is one by the default method, without limits of its own, for a board as designed."""
    stopping = how.stopping or Options()
    unlimited = stopping.max_iterations is None and stopping.max_seconds is None
    return unlimited and (how.optimizer, stopping.variant, how.board) == ("lm", "", "flat")


def _alone(task: Task) -> Calibration:
    return refine(*task)
