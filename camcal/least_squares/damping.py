"""Marquardt's λ for each member of a batch."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: below the first no digit of a step changes, above the second a step moves nothing
SMALLEST, LARGEST = 1e-14, 1e12


class Damping:
    """The λ of each member: it falls quickly, but slowly for a while after a failed step.

    The gain ratio ρ steers it by the factor 1 − (2ρ − 1)³ of H. B. Nielsen, Damping parameter in Marquardt's method
    (1999), eq. 2.5. From `GOOD` on λ falls by `FALL`, as these problems start close by. In the curved, narrow valleys
    of the larger lens models it would then be too small every other step, so it falls by `CAUTIOUS` until `CALM` steps
    have been taken since one failed. Among a dozen choices of the numbers, for 150 refinements of simulated and real
    data (opencv5 to opencv14, kb4, ds), these converged most often, and took the fewest linearisations of those that
    did so; other choices took up to a third more.
    """

    GOOD, FALL, CAUTIOUS, CALM, GROWTH = 0.75, 0.01, 0.5, 3, 10.0

    def __init__(self, start: Array):
        self.value = start
        self.growth = np.full(len(start), self.GROWTH)
        self.since_failure = np.full(len(start), self.CALM)

    def update(self, accepted: Array, gain: Array) -> None:
        """Update λ after a trial of all members."""
        fall = np.where(self.since_failure >= self.CALM, self.FALL, self.CAUTIOUS)
        good = gain > self.GOOD
        if good.all():  # as nearly always
            self.value = np.maximum(self.value * fall, SMALLEST)
            self.growth.fill(self.GROWTH)
            self.since_failure += 1
            return
        factor = np.where(good, fall, 1.0 - (2.0 * np.clip(gain, 0.0, 1.0) - 1.0) ** 3)
        moved = np.maximum(self.value, SMALLEST) * np.where(accepted, factor, self.growth)
        self.value = np.maximum(moved, SMALLEST)  # as above: a member does not depend on the others
        self.growth = np.where(accepted, self.GROWTH, 2.0 * self.growth)
        self.since_failure = np.where(accepted, self.since_failure + 1, 0)

    def keep(self, rows: Array) -> None:
        """Drop all other members."""
        self.value, self.growth = self.value[rows], self.growth[rows]
        self.since_failure = self.since_failure[rows]
