"""Conditions that reduce the value of a rig calibration: its own, and those of each of its cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from camcal.assess.checks import RIG, checks_of, spoken
from camcal.assess.checks.facts import Facts
from camcal.assess.covariance import Covariance, covariance
from camcal.assess.rig import relative_sigmas
from camcal.assess.warning import CalibrationWarning
from camcal.solve.calibration import RigCalibration
from camcal.solve.rig_cameras import within

#: instants that two cameras share: of fewer, a single misread board decides
FEW_INSTANTS = 4
#: a relative rotation known no better than this, degrees, moves the pictures against each other by ten pixels at a
#: focal length of 1000 px
LOOSE_DEG = 0.5


def check(solution: RigCalibration, lags: Mapping[str, int]) -> tuple[CalibrationWarning, ...]:
    """All warnings about a rig; those of its cameras are prefixed with their names.

    Parameters
    ----------
    lags : mapping of camera -> frames
        What `camcal.solve.rig_lags.lags` found.
    """
    found = [out_of_step(lags)] if lags else []
    accuracy = covariance(solution)
    found += [*_not_converged(solution), *_undetermined(accuracy), *_few_instants(solution)]
    found += _loose(solution, accuracy)
    for name in solution.rig.cameras:
        for warning in spoken(checks_of(RIG), Facts(within(solution, name))):
            found.append(replace(warning, message=f"camera {name}: {warning.message}"))
    return tuple(found)


def out_of_step(lags: Mapping[str, int]) -> CalibrationWarning:
    """Cameras that lag behind the others, and by how much."""
    frames = [f"{n} by {abs(k)} frame{'s' * (abs(k) != 1)}" for n, k in lags.items() if k > 0]
    ahead = [f"{n} by {abs(k)} frame{'s' * (abs(k) != 1)}" for n, k in lags.items() if k < 0]
    said = [f"{' and '.join(frames)} late"] * bool(frames) + [f"{' and '.join(ahead)} early"] * bool(ahead)
    return CalibrationWarning(
        "cameras-out-of-step",
        f"the cameras are not synchronous: {', '.join(said)}. Each camera sees the board where the others do "
        "only after shifting these views.",
        f"Correct it with --lag {','.join(f'{n}={k}' for n, k in lags.items())}; or trigger the cameras together.",
        "wrong",
    )


def _not_converged(solution: RigCalibration) -> Iterator[CalibrationWarning]:
    if not solution.fit.converged:
        yield CalibrationWarning(
            "not-converged",
            f"the joint refinement did not converge: {solution.fit.stop_reason}.",
            "Check the residuals by camera; remove pictures that do not fit.",
        )


def _undetermined(accuracy: Covariance) -> Iterator[CalibrationWarning]:
    if accuracy.undetermined:
        yield CalibrationWarning(
            "undetermined-parameters",
            f"the data do not determine {', '.join(accuracy.undetermined)}.",
            "Add tilted views across the whole picture, fix parameters (--fix), or choose a smaller model.",
        )


def _few_instants(solution: RigCalibration) -> Iterator[CalibrationWarning]:
    """A camera that shares few instants with all others together."""
    blocks, names = solution.observations.blocks, solution.observations.cameras
    seen = np.zeros((len(names), len(solution.poses)), bool)
    seen[blocks.camera, blocks.view] = True
    for index, name in enumerate(names):
        count = int((seen[index] & (np.delete(seen, index, 0).any(0))).sum())
        if count < FEW_INSTANTS:
            yield CalibrationWarning(
                "few-shared-instants",
                f"camera {name} shares only {count} instant{'s' * (count != 1)} with the others: its pose is "
                "poorly determined.",
                "Take pictures in which this camera and another one see the board.",
            )


def _loose(solution: RigCalibration, accuracy: Covariance) -> Iterator[CalibrationWarning]:
    """Poorly determined relative poses."""
    for name in list(solution.rig.cameras)[1:]:
        turn = float(np.degrees(np.linalg.norm(relative_sigmas(solution, accuracy, name)[:3])))
        if not turn <= LOOSE_DEG:
            yield CalibrationWarning(
                "loose-relative-pose",
                f"the orientation of camera {name} relative to {solution.rig.reference} is known only to "
                f"{turn:.2g} degrees.",
                "Take pictures of the board close to both cameras, tilted in different directions.",
            )
