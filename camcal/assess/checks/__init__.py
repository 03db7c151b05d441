"""Conditions that reduce the value of a calibration, each a warning with a code, what was found and a hint.

A check is a function `Facts -> iterable of CalibrationWarning` and a line in `CHECKS`. Every threshold stands
beside its reason; tests hold it against degenerate data (it must speak) and good data (it must not).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from camcal.assess.causes import Found
from camcal.assess.checks import (
    board,
    border,
    cause,
    circles,
    coverage,
    film,
    fit,
    folds,
    group,
    lens,
    mirror,
    noise,
    parameters,
    pictures,
    rejected,
    views,
)
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning
from camcal.solve.calibration import Calibration

F = TypeVar("F")

CHECKS = (
    fit.not_converged,
    cause.cause,
    film.rolling_shutter,
    views.single_view,
    views.few_views,
    views.fronto_parallel,
    views.duplicates,
    views.repeated,
    views.mirrored,
    mirror.mirrored_pictures,
    parameters.undetermined,
    parameters.weak,
    parameters.correlated,
    lens.outside_domain,
    lens.fold_in_image,
    coverage.poor,
    coverage.outside_image,
    coverage.image_size,
    fit.little_redundancy,
    fit.outliers,
    group.shifted_group,
    rejected.many_rejected,
    pictures.poor_pictures,
    fit.large_residuals,
    fit.systematic,
    board.not_flat,
    circles.circle_centres,
    border.noise_by_radius,
    noise.tails,
    noise.rounded,
    folds.views_disagree,
)


def check(
    solution: Calibration,
    known: Sequence[CalibrationWarning] = (),
    holdout: Mapping[str, Any] | None = None,
    found: Found | None = None,
) -> tuple[CalibrationWarning, ...]:
    """All warnings about a calibration, the most severe kinds first.

    Parameters
    ----------
    solution : Calibration
    known : sequence of CalibrationWarning
        Those that are there already: they come first, and their codes are not said again. A doubt of the closed form is
        left out where the refinement settled it: a closed form for pinhole cameras can be all but lost on a wide lens,
        and what was refined from another start be good to a thousandth.
    holdout : mapping, optional
        The report's figures on views held out.
    found : Found, optional
        What all views have in common, `camcal.assess.causes.find`.
    """
    facts = Facts(solution, holdout, found)
    codes = {w.code for w in known}
    if "weak-geometry" in codes and parameters.focal_known(facts):
        known = [w for w in known if w.code != "weak-geometry"]
        codes.remove("weak-geometry")
    return (*known, *(w for w in spoken(CHECKS, facts) if w.code not in codes))


def spoken(
    checks: Iterable[Callable[[F], Iterable[CalibrationWarning]]], facts: F
) -> list[CalibrationWarning]:
    """What some checks say of some facts, in their order."""
    return [w for one in checks for w in one(facts)]
