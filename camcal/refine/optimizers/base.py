"""What every optimiser takes and gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from camcal.refine.problem import Blocks, State


@dataclass(frozen=True)
class Options:
    """When to stop.

    Attributes
    ----------
    tolerance : float
        Converged where the decrease that the quadratic model predicts is below this part of the cost. 1e-14
        leaves the parameters within 1e-5 of their standard deviations at 1e4 points.
    max_iterations : int
        Accepted and rejected steps.
    """

    tolerance: float = 1e-14
    max_iterations: int = 200


@dataclass(frozen=True)
class Result:
    """Where an optimiser ended.

    `trace` is the cost after each iteration, the start first; `blocks` belong to `state`.
    """

    state: State
    blocks: Blocks
    converged: bool
    stop_reason: str
    iterations: int
    evaluations: int
    trace: tuple[float, ...]
    info: dict[str, Any] = field(default_factory=dict)


#: called with (iteration, cost) after every accepted step
OnStep = Callable[[int, float], None]
