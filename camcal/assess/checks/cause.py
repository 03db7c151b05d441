"""Causes that all views share and that one camera does not explain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from camcal.assess.causes.words import warning_of
from camcal.assess.checks import film, noise
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning

#: The evidence for a cause takes the noise for white and Gaussian. Where it has heavy tails and sigma falls to no
#: less than this part, the odds are overstated: a real set of 17 pictures with bent boards and blur (fourth moment
#: 2.9) has .95 for two cameras that it does not show; a zoom by 2 % in clean views has .91, without heavy tails.
SMALL_FALL = 0.9


def cause(facts: Facts) -> Iterator[CalibrationWarning]:
    """Zoom, resized pictures, several cameras, a rolling shutter, a stabiliser: see `camcal.assess.causes`."""
    said = warning_of(facts.found) if facts.found is not None else None
    if said is None or facts.found is None:
        return
    if (
        said.code == "rolling-shutter" and film.sure(facts) is not None
    ):  # known motion says it with one number
        return
    heavy = any(w.code == "heavy-tailed-residuals" for w in noise.tails(facts))
    unsure = heavy and facts.found.sigma > SMALL_FALL * facts.found.before
    yield replace(said, severity="doubtful") if unsure and said.severity == "wrong" else said
