"""The parameters: undetermined, weak, or determined only in combination."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning

#: Relative standard deviation of a focal length (and skew), and that of the principal point relative to the image's
#: diagonal, above which they are weak: ten times those of a dozen ordinary views of a board.
WEAK = 0.02
NAMED = 4  #: pairs named in a message, which thus fits on one line
_HINT = "Add tilted views across the whole picture, fix parameters (--fix), or choose a smaller model."


def undetermined(facts: Facts) -> Iterator[CalibrationWarning]:
    """Infinite standard deviations."""
    names = facts.covariance.undetermined
    if names:
        what = f"the data do not determine {', '.join(names)}: other values fit equally well"
        if not facts.covariance.null.size:
            what += ", along a curve; the other sigmas can be too small"
        yield CalibrationWarning("undetermined-parameters", f"{what}.", _HINT)


def weak(facts: Facts) -> Iterator[CalibrationWarning]:
    """Very large standard deviations."""
    sigmas, focal = facts.covariance.sigmas, float(np.abs(facts.camera.params[:2]).max())
    sizes = dict.fromkeys(facts.groups("focal", "skew"), focal)
    sizes |= dict.fromkeys(facts.groups("principal"), facts.diagonal)
    found = [f"{n} (± {sigmas[n]:.3g} px)" for n, size in sizes.items() if WEAK * size < sigmas[n] < np.inf]
    if found:
        yield CalibrationWarning("weak-parameters", f"poorly determined: {', '.join(found)}.", _HINT)


def focal_known(facts: Facts) -> bool:
    """Return whether the focal lengths were estimated and none of them is weak."""
    names = facts.groups("focal")
    focal = float(np.abs(facts.camera.params[:2]).max())
    return bool(names) and all(facts.covariance.sigmas[n] <= WEAK * focal for n in names)


def focal_sigma(facts: Facts) -> float:
    """The largest relative standard deviation of an estimated focal length; 0 if none was estimated."""
    names = facts.groups("focal")
    focal = float(np.abs(facts.camera.params[:2]).max())
    return max((facts.covariance.sigmas[n] / focal for n in names), default=0.0)


def correlated(facts: Facts) -> Iterator[CalibrationWarning]:
    """Strong correlation between parameters of different groups: neither is meaningful by itself.

    Within a group (fx with fy, k1 with k2) it is always high and harmless.
    """
    group = {p.name: p.group for p in facts.camera.lens.parameters}
    pairs = [p for p in facts.covariance.strong_correlations() if group[p[0]] != group[p[1]]]
    if pairs:
        named = ", ".join(f"{a} with {b} ({r:+.3f})" for a, b, r in pairs[:NAMED])
        yield CalibrationWarning(
            "correlated-parameters",
            f"determined only in combination: {named}{', ...' if len(pairs) > NAMED else ''}.",
            "Compare projections rather than these values; views rotated by 90 degrees separate them.",
            "note",
        )
