"""A step length that satisfies the strong Wolfe conditions.

J. Nocedal and S. Wright, Numerical Optimization, 2nd ed. (2006), algorithms 3.5 and 3.6, with φ(α) the cost
along a direction:

    φ(α) ≤ φ(0) + c1 α φ'(0),   |φ'(α)| ≤ c2 |φ'(0)|                                                     (1)

Near the minimum, costs differ by rounding only, and the first of (1) cannot be tested; a step that changes
the cost by no more than that is then taken when its slope satisfies the second (as in W. Hager and H. Zhang,
SIAM J. Optim. 16, 2005, section 4).
"""

from __future__ import annotations

import numpy as np

from camcal.records import dataclass
from camcal.solve.optimizers.variables import Place, Variables

Array = np.ndarray

SUFFICIENT = 1e-4  #: c1
_SHORTEST = 1e-12  #: part of its ends to which a bracket is narrowed; the cost changes by the square of that
_MOST_GROWTH = (
    10.0  #: factor by which a length is extrapolated (Nocedal & Wright, section 3.5, demand such a limit)
)
_TRIALS = 30  #: a bracket that is halved 30 times is 1e-9 of its length


@dataclass(frozen=True)
class _Trial:
    """A step length with φ and φ'; φ = inf where the step leaves the domain."""

    length: float
    cost: float
    slope: float
    place: Place | None


def strong_wolfe(
    variables: Variables, place: Place, direction: Array, first: float, curvature: float
) -> tuple[Place, float] | None:
    """Search along a direction of descent.

    Parameters
    ----------
    variables : Variables
    place : Place
    direction : (n,) array
    first : float
        The first length to try.
    curvature : float
        c2: 0.9 for quasi-Newton methods, 0.1 for conjugate gradients.

    Returns
    -------
    The new place and the length, or None if no step decreases the cost. A place that satisfies only the
    first of (1) is accepted if the second cannot be reached.
    """
    return _Search(variables, place, direction, curvature).run(first)


class _Search:
    def __init__(self, variables: Variables, place: Place, direction: Array, curvature: float):
        self.variables, self.place, self.direction = variables, place, direction
        slope = float(place.gradient @ direction)
        self.zero = _Trial(0.0, place.cost, slope, place)
        self.flat = -curvature * slope
        self.noise = variables.noise * place.cost
        self.trials = 0

    def try_(self, length: float) -> _Trial:
        self.trials += 1
        reached = self.variables.move(self.place, length * self.direction)
        if reached is None:
            return _Trial(length, np.inf, np.inf, None)
        return _Trial(length, reached.cost, float(reached.gradient @ self.direction), reached)

    def decreases(self, t: _Trial) -> bool:
        """Return whether the first of (1) holds, or the change is within rounding."""
        enough = self.zero.cost + SUFFICIENT * t.length * self.zero.slope
        return t.cost <= enough or abs(t.cost - self.zero.cost) <= self.noise

    def run(self, first: float) -> tuple[Place, float] | None:
        """Algorithm 3.5: increase the length until a minimum is bracketed."""
        previous, trial = self.zero, self.try_(first)
        while self.trials < _TRIALS:
            if not self.decreases(trial) or (
                previous.length > 0 and trial.cost >= previous.cost + self.noise
            ):
                return self.zoom(previous, trial)
            if abs(trial.slope) <= self.flat:
                break
            if trial.slope >= 0:
                return self.zoom(trial, previous)
            previous, trial = trial, self.try_(min(_MOST_GROWTH, _growth(previous, trial)) * trial.length)
        return self.taken(trial)

    def zoom(self, low: _Trial, high: _Trial) -> tuple[Place, float] | None:
        """Algorithm 3.6: `low` has the lower cost, and a minimum lies between."""
        while self.trials < _TRIALS and abs(high.length - low.length) > _SHORTEST * max(
            low.length, high.length
        ):
            trial = self.try_(_inside(low, high))
            if not self.decreases(trial) or trial.cost >= low.cost + self.noise:
                high = trial
                continue
            if abs(trial.slope) <= self.flat:
                return self.taken(trial)
            if trial.slope * (high.length - low.length) >= 0:
                high = low
            low = trial
        return self.taken(low)

    def taken(self, trial: _Trial) -> tuple[Place, float] | None:
        if trial.place is None or trial.length == 0.0 or not self.decreases(trial):
            return None
        return trial.place, trial.length


def _growth(a: _Trial, b: _Trial) -> float:
    """The growth factor of the next trial: by the secant of the slopes, at least 2."""
    bend = (b.slope - a.slope) / (b.length - a.length)
    return max(2.0, 1.0 - b.slope / bend / b.length) if bend > 0 else 4.0


def _inside(a: _Trial, b: _Trial) -> float:
    """A length between two: the minimum of the cubic through both (their eq. 3.59), kept away from the ends."""
    width = b.length - a.length
    middle = a.length + 0.5 * width
    if not np.isfinite(b.cost):
        return a.length + 0.2 * width
    d1 = a.slope + b.slope - 3 * (a.cost - b.cost) / (a.length - b.length)
    square = d1 * d1 - a.slope * b.slope
    if not square >= 0:
        return middle
    d2 = np.sign(width) * np.sqrt(square)
    below = b.slope - a.slope + 2 * d2
    if below == 0:
        return middle
    length = b.length - width * (b.slope + d2 - d1) / below
    low, high = sorted((a.length + 0.1 * width, b.length - 0.1 * width))
    return float(np.clip(length, low, high)) if np.isfinite(length) else middle
