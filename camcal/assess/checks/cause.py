"""Causes that all views share and that one camera does not explain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import exp, log

from camcal.assess.causes.search import EVIDENCE
from camcal.assess.causes.words import warning_of
from camcal.assess.checks import noise
from camcal.assess.checks.facts import Facts
from camcal.assess.rolling import sure
from camcal.assess.warning import CalibrationWarning

#: independent errors per view if they are common to the view (a bent board, blur in one direction): the parameters of a
#: homography
OF_A_VIEW = 8


def least_fall(views: int, numbers: int) -> float:
    """The relative sigma at which a cause with this number of parameters is certain for any kind of noise.

    The evidence for a cause, BIC = n ln(cost) + m ln n, assumes independent coordinates. Heavy-tailed noise may instead
    consist of errors of whole views, n = 8 V of them, and the criterion then decreases by `EVIDENCE` if

        sigma / sigma_before < exp(-(m ln n + EVIDENCE) / 2n)

    This is .90 for 17 views and the four parameters of another camera: a real set of that size with bent boards and
    blur (fourth moment 2.9), taken by one camera, has .95 for two cameras.
    """
    n = OF_A_VIEW * views
    return exp(-(numbers * log(n) + EVIDENCE) / (2 * n))


def cause(facts: Facts) -> Iterator[CalibrationWarning]:
    """Zoom, resized pictures, several cameras, a rolling shutter, a stabiliser: see `camcal.assess.causes`."""
    said = warning_of(facts.found) if facts.found is not None else None
    if said is None or facts.found is None:
        return
    if (
        said.code == "rolling-shutter" and sure(facts.solution) is not None
    ):  # known motion describes it with one parameter
        return
    heavy = any(w.code == "heavy-tailed-residuals" for w in noise.tails(facts))
    trial, base = facts.found.trial, facts.found.base
    assert trial is not None
    unsure = heavy and facts.found.sigma > least_fall(len(base.poses), trial.numbers) * facts.found.before
    yield replace(said, severity="doubtful") if unsure and said.severity == "wrong" else said
