"""The part of the Hessian that Gauss-Newton omits, estimated from changes of the gradient.

    C ≈ Σ r ∇²r of the reduced problem (poses eliminated), C s = g' - g - S' s                            (1)

J. Dennis, D. Gay and R. Welsch, An adaptive nonlinear least-squares algorithm, ACM TOMS 7 (1981): the update
of section 3 with its sizing, and the choice between the models with and without C by which of them predicted
the last decrease better. If parameters are nearly interchangeable, as those of a rational lens, convergence without it
is only linear.
"""

from __future__ import annotations

import numpy as np

from camcal.solve.schur import Reduced

Array = np.ndarray


class Curvature:
    """C (F, F), and whether the last step supports its use."""

    def __init__(self, size: int):
        self.matrix = np.zeros((size, size))
        self.trusted = False

    def along(self, step: Array) -> float:
        """½ sᵀ C s: the additional decrease that the model with C predicts."""
        return float(0.5 * step @ self.matrix @ step)

    def learn(self, step: Array, before: Reduced, after: Reduced) -> None:
        """Update C by a step (F,) of the camera between two undamped reductions."""
        change = after.gradient - before.gradient
        along = float(step @ change)
        if not along > 0:
            return
        missing = change - after.matrix @ step
        own = float(step @ self.matrix @ step)
        size = min(1.0, abs(float(step @ missing) / own)) if own != 0 else 1.0
        rest = missing - size * self.matrix @ step
        mixed = np.outer(rest, change) / along
        self.matrix = size * self.matrix + mixed + mixed.T
        self.matrix -= (rest @ step) / along**2 * np.outer(change, change)
