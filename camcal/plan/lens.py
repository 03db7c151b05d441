"""The choice of the lens model if none is requested.

`opencv5` is taken where it holds: it compares with everybody's, and an ordinary lens costs nothing more. Where it
does not hold, the models of the other side are ranked (`selection.py`): wide ones where the lens folds inside the
picture, the fit does not converge, or its residuals follow the radius; smaller ones where the data do not determine
its coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from camcal.assess import figures
from camcal.assess.checks import fit as fit_checks
from camcal.assess.checks import lens as lens_checks
from camcal.assess.checks.facts import Facts
from camcal.data.observations import Observations
from camcal.errors import CamcalError, EstimationError, UsageError, caught, only
from camcal.model import lenses
from camcal.model.lenses import ORDINARY
from camcal.plan.minima import LOWEST
from camcal.plan.options import Options
from camcal.plan.progress import Progress, follow, follow_all
from camcal.plan.run import BETTER, begun, camera_plan, plan
from camcal.solve.starts import has

#: models ranked where it is too small for the lens, and where it is too large for the data
WIDE = ("opencv5", "opencv8", "kb4", "mei", "eucm", "ds")
SMALL = ("pinhole", "brown:radial=1,decentering=0", "brown:radial=2,decentering=0", "opencv4", "opencv5")
#: a coefficient known no better than to this moves a ray at 45 degrees by as many parts of the focal length: nothing
#: that was seen of the lens
UNKNOWN = 0.2
#: fewer residual degrees of freedom a parameter of the camera than this leave the coefficients to the noise of single
#: points (20 clicked points have 25 for 15 parameters)
LEAST_FREEDOM = 5.0


def solved_with_found(given: Observations, asked: Options) -> tuple[Progress, Mapping[str, Any]]:
    """All attempts of the plan with the model that the data require, and how it was found."""
    return only(solved_with_found_all([given], asked))


def solved_with_found_all(
    sets: Sequence[Observations], asked: Options
) -> list[tuple[Progress, Mapping[str, Any]] | CamcalError]:
    """`solved_with_found` of many cameras, whose default models are fitted together; an error in place of a result."""
    if asked.model == "select":
        from camcal.plan.selection import AUTO

        return [caught(_ranked, given, asked, AUTO, "") for given in sets]
    begins = [begun(given, replace(asked, model=ORDINARY)) for given in sets]
    few = [_too_few(_freedom(begin), _parameters(begin)) for begin in begins]
    # a smaller model is ranked anyway: no lower minimum of this one is searched for
    quick = [
        replace(b, options=replace(b.options, lowest=False))
        for b, why in zip(begins, few, strict=True)
        if not why
    ]
    fits = iter(follow_all(camera_plan(), quick))
    return [
        caught(
            _ranked, given, asked, SMALL, f"{ORDINARY} is unsuitable: {why}"
        )  # without the rejected points
        if why
        else caught(_ordinary_or_ranked, next(fits), begin, given, asked)
        for given, begin, why in zip(sets, begins, few, strict=True)
    ]


def _ordinary_or_ranked(
    progress: Progress | CamcalError, begin: Progress, given: Observations, asked: Options
) -> tuple[Progress, Mapping[str, Any]]:
    """What follows a fit of the default model: the rest of the plan if it holds, otherwise the ranking of others."""
    try:
        progress = only([progress])
        why, models = _does_not_hold(progress)
        if models != SMALL:
            progress = follow(LOWEST, replace(progress, options=begin.options))
            why, models = _does_not_hold(progress)
    except EstimationError as error:
        return _ranked(given, asked, WIDE, f"{ORDINARY} finds no camera ({error.message.rstrip('.')})")
    if why:
        return _ranked(given, asked, models, f"{ORDINARY} is unsuitable: {why}")
    found = {"chosen": ORDINARY, "why": "an ordinary lens, whose coefficients the data determine"}
    return follow(BETTER, progress), found


def _too_few(freedom: int, parameters: int) -> str:
    """Say that the residuals have too few degrees of freedom for the parameters of the camera; empty if not."""
    if freedom >= LEAST_FREEDOM * parameters:
        return ""
    return f"{freedom} degrees of freedom are too few for {parameters} parameters"


def _parameters(begin: Progress) -> int:
    """Free parameters of the camera before the first attempt."""
    return len(begin.lens.names) - len(begin.how.fix)


def _freedom(begin: Progress) -> int:
    """Degrees of freedom of the residuals of all points."""
    return 2 * begin.data.point_count - 6 * len(begin.data.view_ids) - _parameters(begin)


def _does_not_hold(progress: Progress) -> tuple[str, tuple[str, ...]]:
    """The reason why the default model is unsuitable, and the models ranked instead; empty if it is suitable."""
    fit, facts = progress.fit, Facts(progress.fit)
    sigmas = facts.covariance.sigmas
    loose = [n for n in facts.groups("distortion") if not sigmas[n] < UNKNOWN]
    few = _too_few(figures.redundancy(fit), fit.free.shape[1])
    if few:
        return few, SMALL
    if any(fit_checks.large_residuals(facts)):
        return f"its rms is {fit.rms_point:.3g} px", WIDE
    if any(lens_checks.outside_domain(facts)):
        return "its distortion folds back within the radius of some points", WIDE
    if any(fit_checks.systematic(facts)):
        return "its residuals depend on the distance from the centre", WIDE
    if not fit.fit.converged:
        return "its refinement does not converge", WIDE
    if any(w.code == "fold-in-image" and w.severity != "note" for w in lens_checks.fold_in_image(facts)):
        return "its distortion folds back where there are no points", (*SMALL, *WIDE[1:])
    if loose:
        return f"the data do not determine {', '.join(loose)}", SMALL
    return "", ()


def _ranked(
    given: Observations, asked: Options, models: tuple[str, ...], why: str
) -> tuple[Progress, Mapping[str, Any]]:
    """The best of some models, with its whole plan; it holds those of the parameters to be held that it has."""
    from camcal.plan.selection import described, select  # few runs rank models

    models = _with_held(models, asked)
    options = {name: getattr(asked, name) for name in ("skew", "fix", "robust", "seed")}
    found = described(select(given, models, **options))
    if why:
        found["why"] = f"{why}; {found['why']}"
    lens = lenses.make(found["chosen"], asked.skew)
    held = {name: value for name, value in asked.fix.items() if has(lens, name)}
    return follow(plan(), begun(given, replace(asked, model=found["chosen"], fix=held))), found


def _with_held(models: Sequence[str], asked: Options) -> tuple[str, ...]:
    """The models that can hold the requested values: a model without a coefficient can hold it only at 0.

    Raises
    ------
    UsageError
        For a name that none of the models has, or values that no model of them has all.
    """
    made = {model: lenses.make(model, asked.skew) for model in models}
    for name in asked.fix:
        if not any(has(lens, name) for lens in made.values()):
            raise UsageError(
                f"none of the models to choose from has a parameter '{name}'.",
                f"They are: {', '.join(models)}. Name a model: --model NAME.",
            )
    wanted = [name for name, value in asked.fix.items() if value]
    able = tuple(m for m, lens in made.items() if all(has(lens, name) for name in wanted))
    if not able:
        raise UsageError(
            f"none of the models to choose from has all of {', '.join(wanted)}.",
            f"They are: {', '.join(models)}. Name a model: --model NAME.",
        )
    return able
