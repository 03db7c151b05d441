"""Conditions that make a calibration less than it seems, each a warning with a code, what was found and a
hint.

A check is a function `Facts -> iterable of CalibrationWarning` and a line in `CHECKS`. Every threshold stands
beside its reason; tests hold it against degenerate data (it must speak) and good data (it must not).
"""

from __future__ import annotations

from camcal.assess.checks import (
    board,
    coverage,
    fit,
    folds,
    lens,
    mirror,
    noise,
    parameters,
    pictures,
    rejected,
    views,
)
from camcal.assess.checks.facts import Facts
from camcal.solve.solution import CalibrationWarning, Solution

CHECKS = (
    fit.not_converged,
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
    fit.little_redundancy,
    fit.outliers,
    rejected.many_rejected,
    pictures.poor_pictures,
    fit.large_residuals,
    fit.systematic,
    board.not_flat,
    noise.tails,
    noise.rounded,
    folds.views_disagree,
)


def check(solution: Solution) -> tuple[CalibrationWarning, ...]:
    """All warnings on a solution besides those it carries already, the gravest kinds first.

    Parameters
    ----------
    solution : Solution

    Returns
    -------
    tuple of CalibrationWarning
        A code that the solution carries is not said again.
    """
    known = {w.code for w in solution.warnings}
    facts = Facts(solution)
    return tuple(w for one in CHECKS for w in one(facts) if w.code not in known)


def still_true(solution: Solution) -> tuple[CalibrationWarning, ...]:
    """The warnings that a solution carries, without the doubts of the closed form that the refinement settled.

    A closed form for pinhole cameras can be all but lost on a wide lens, and what was refined from another start
    be good to a thousandth.
    """
    if all(w.code != "weak-geometry" for w in solution.warnings) or not parameters.focal_known(
        Facts(solution)
    ):
        return solution.warnings
    return tuple(w for w in solution.warnings if w.code != "weak-geometry")
