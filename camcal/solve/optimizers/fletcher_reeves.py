"""Conjugate gradients of R. Fletcher and C. M. Reeves, Computer J. 7 (1964)."""

from __future__ import annotations

from camcal.solve.optimizers.base import OnStep, Options, Result
from camcal.solve.optimizers.conjugate_gradients import Array, conjugate_gradients
from camcal.solve.optimizers.variables import VARIANTS
from camcal.solve.problem import Problem, State

__all__ = ["VARIANTS", "minimise"]


def minimise(
    problem: Problem, state: State, options: Options | None = None, on_step: OnStep | None = None
) -> Result:
    """Minimise with β = |g'|² / |g|²."""

    def beta(old: Array, new: Array) -> float:
        return float((new @ new) / (old @ old))

    return conjugate_gradients(problem, state, options, on_step, beta)
