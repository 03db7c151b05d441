"""Checks for conditions that degrade a calibration; each yields a warning with a code, a finding and a hint.

A check is a function `Facts -> iterable of CalibrationWarning` and a line in `CHECKS`; `ALSO` says which of them apply
to cameras that were not calibrated by their own views. Every threshold stands beside its reason; tests apply it to
degenerate data (which must give the warning) and to good data (which must not).
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
from camcal.assess.design import Design
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

#: uses of a camera whose own views do not determine it: other cameras see the same boards, or it is known
RIG, KNOWN = "a camera of a rig", "a known camera on new data"
#: the checks that also apply there: those of the lens, the points and the pictures. Those of the views and of what they
#: determine do not apply; they also take most of the time
ALSO = {
    views.mirrored: (KNOWN,),
    lens.outside_domain: (RIG, KNOWN),
    lens.fold_in_image: (RIG,),
    coverage.poor: (RIG,),
    coverage.outside_image: (RIG, KNOWN),
    fit.outliers: (RIG, KNOWN),
    rejected.many_rejected: (RIG, KNOWN),
    pictures.poor_pictures: (RIG, KNOWN),
    fit.large_residuals: (RIG, KNOWN),
    fit.systematic: (RIG, KNOWN),
    noise.tails: (RIG,),
    noise.rounded: (RIG, KNOWN),
}


def check(
    solution: Calibration,
    known: Sequence[CalibrationWarning] = (),
    holdout: Mapping[str, Any] | None = None,
    found: Found | None = None,
    design: Design | None = None,
) -> tuple[CalibrationWarning, ...]:
    """All warnings about a calibration, the most severe kinds first.

    Parameters
    ----------
    solution : Calibration
    known : sequence of CalibrationWarning
        Existing warnings: they come first, and their codes are not repeated. A warning about the closed form is dropped
        if the refinement resolved it: a closed form for pinhole cameras can be nearly useless for a wide-angle lens,
        while the refinement from another start is accurate to a thousandth.
    holdout : mapping, optional
        The report's figures on views held out.
    found : Found, optional
        Common cause of all views, from `camcal.assess.causes.find`.
    design : Design, optional
        The linearised problem of the solution, if it is already known.
    """
    facts = Facts(solution, holdout, found, design)
    codes = {w.code for w in known}
    if "weak-geometry" in codes and parameters.focal_known(facts):
        known = [w for w in known if w.code != "weak-geometry"]
        codes.remove("weak-geometry")
    return (*known, *(w for w in spoken(CHECKS, facts) if w.code not in codes))


def checks_of(use: str) -> tuple[Callable[[Facts], Iterable[CalibrationWarning]], ...]:
    """The checks that apply to one of the uses of `ALSO`, in the order of `CHECKS`."""
    return tuple(c for c in CHECKS if use in ALSO.get(c, ()))


def spoken(
    checks: Iterable[Callable[[F], Iterable[CalibrationWarning]]], facts: F
) -> list[CalibrationWarning]:
    """The warnings of some checks for some facts, in the order of the checks."""
    return [w for one in checks for w in one(facts)]
