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

#: errors that whole views share rather than single points (a bent board, blur in one direction) are as many as the
#: numbers of a homography
OF_A_VIEW = 8


def least_fall(views: int, numbers: int) -> float:
    """The part of itself that sigma has to fall to before a cause of so many numbers is sure in any kind of noise.

    The evidence for a cause, BIC = n ln(cost) + m ln n, takes each coordinate for independent. Where the noise has
    heavy tails it may be the errors of whole views instead, n = 8 V of them, and the criterion falls by `EVIDENCE`
    where

        sigma / sigma_before < exp(-(m ln n + EVIDENCE) / 2n)

    That is .90 for 17 views and the four numbers of another camera: a real set of that size with bent boards and blur
    (fourth moment 2.9) has .95 for two cameras that it does not show.
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
    ):  # known motion says it with one number
        return
    heavy = any(w.code == "heavy-tailed-residuals" for w in noise.tails(facts))
    trial, base = facts.found.trial, facts.found.base
    assert trial is not None
    unsure = heavy and facts.found.sigma > least_fall(len(base.poses), trial.numbers) * facts.found.before
    yield replace(said, severity="doubtful") if unsure and said.severity == "wrong" else said
