"""Conjugate gradients of E. Polak and G. Ribière (1969), never with a negative β (Gilbert & Nocedal 1992)."""

from __future__ import annotations

from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.optimizers.conjugate_gradients import Array, conjugate_gradients
from camcal.solve.optimizers.variables import VARIANTS
from camcal.solve.problem import Problem, State

__all__ = ["VARIANTS", "minimise"]


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise with β = max(0, g'ᵀ (g' - g) / |g|²)."""

    def beta(old: Array, new: Array) -> float:
        return max(0.0, float(new @ (new - old) / (old @ old)))

    return conjugate_gradients(problem, state, options, on_step, beta)
