"""All optimisers on one problem, from the same starts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.geometry import rotations
from camcal.records import dataclass
from camcal.solve import optimizers
from camcal.solve.coordinates import OtherRotations
from camcal.solve.optimizers.base import Options, Result
from camcal.solve.problem import Problem, State
from camcal.solve.schur import Reduced

#: costs whose relative difference is at most this are the same minimum
SAME = 1e-6
#: how often a start that does not project is halved towards the first: a millionth of its distance is left
HALVINGS = 20


@dataclass(frozen=True)
class Run:
    """One optimiser from one start.

    Attributes
    ----------
    name : str
        Spec of the optimiser.
    start : int
        0 is the closed form's, the others are perturbed.
    result : Result
    seconds : float
    """

    name: str
    start: int
    result: Result
    seconds: float


def run_all(
    problem: Problem,
    starts: Sequence[State],
    specs: Sequence[str],
    options: Options | None = None,
    rotation: str = "left",
    on_run: Callable[[str, int], None] | None = None,
    total_seconds: float | None = None,
) -> list[Run]:
    """Run every optimiser from every start.

    Parameters
    ----------
    rotation : str
        One of `coordinates.KINDS`. Other than `left` only for specs that need no more of a problem than its
        linearisations and retractions: lm:schur, dogleg:schur, gauss-newton:schur, lbfgs:scaled, ...
    on_run : callable, optional
        Called with (spec, index of the start) before each run.
    total_seconds : float, optional
        For all runs together. Each may take the remaining time divided by the number of remaining runs, within the
        limit of `options`, so that time not needed by quick runs is available to later ones.
    """
    seen: Any = problem if rotation == "left" else OtherRotations(problem, rotation)
    runs: list[Run] = []
    began, count = time.perf_counter(), len(starts) * len(specs)
    for index, state in enumerate(starts):
        for spec in specs:
            if on_run:
                on_run(spec, index)
            begin = time.perf_counter()
            limited = options
            if total_seconds is not None:
                limited = _limited(options, (total_seconds - (begin - began)) / (count - len(runs)))
            result = optimizers.make(spec)(seen, state, limited)
            runs.append(Run(spec, index, result, time.perf_counter() - begin))
    return runs


def _limited(options: Options | None, share: float) -> Options:
    """Options with a time limit, the smaller of their own and a share."""
    options = options or Options()
    limits = [max(share, 0.0)] + ([] if options.max_seconds is None else [options.max_seconds])
    return replace(options, max_seconds=min(limits))


def perturbed(problem: Problem, state: State, count: int, size: float, seed: int) -> list[State]:
    """Other starts near a given one, with parameters and poses perturbed at random.

    Focal length, depth and the principal point (by the focal length) move by `size` relative, rotations by
    `size` rad, distortion by `size` itself, each times a standard normal number. A start that does not
    project is halved towards the first.
    """
    rng = np.random.default_rng(seed)
    groups = np.array([p.group for p in problem.lens.parameters])
    focal = float(state.params[0])
    unit = np.select([groups == "focal", groups == "principal"], [state.params, focal], 1.0)
    moves = problem.free.any(1)
    made = []
    for _ in range(count):
        params = rng.normal(size=len(groups)) * unit * moves
        ties = problem.free @ np.linalg.lstsq(problem.free, params, rcond=None)[0]
        turn, shift = rng.normal(size=(2, len(problem.views), 3))
        shift *= state.centres[:, 2:]
        for factor in size * 0.5 ** np.arange(HALVINGS):
            start = replace(
                state,
                params=state.params + factor * ties,
                rotations=rotations.exp(factor * turn) @ state.rotations,
                centres=state.centres + factor * shift,
            )
            if problem.linearise(start) is not None:
                made.append(start)
                break
    return made


def judged(problem: Problem, runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A row for each optimiser: the run from the first start, and a summary of its perturbed starts.

    `distance` is the relative excess of the cost over the best of all runs; `distance_sigma` that of the
    camera, sqrt(Δᵀ S Δ) / σ, in standard deviations of the estimate.
    """
    best = min(runs, key=lambda r: r.result.blocks.cost).result
    lowest = best.blocks.cost
    points = sum(len(v) for v in problem.views)
    surplus = max(2 * points - problem.variables - 6 * len(problem.views), 1)
    reduced = Reduced(best.blocks)

    def excess(r: Result) -> float:
        return r.blocks.cost / lowest - 1.0 if lowest > 0 else 0.0

    def sigmas(r: Result) -> float | None:
        if not reduced.solvable:
            return None
        moved = np.linalg.lstsq(problem.free, r.state.params - best.state.params, rcond=None)[0]
        moved = np.concatenate([moved, r.state.shape - best.state.shape])
        return float(np.sqrt(max(moved @ reduced.matrix @ moved, 0.0) * surplus / (2 * lowest)))

    rows = []
    for spec in dict.fromkeys(r.name for r in runs):
        own = [r for r in runs if r.name == spec]
        first, rest = own[0], own[1:]
        r = first.result
        rows.append(
            {
                "name": spec,
                "cost": r.blocks.cost,
                "rms_point": float(np.sqrt(2 * r.blocks.cost / max(points, 1))),
                "converged": r.converged,
                "distance": excess(r),
                "distance_sigma": sigmas(r),
                "iterations": r.iterations,
                "evaluations": r.evaluations,
                "seconds": first.seconds,
                "stop_reason": r.stop_reason,
                "info": r.info,
                "perturbed": _summed_up(rest, excess),
                "curve": [list(s) for s in thinned(r.samples)],
            }
        )
    return rows


def _summed_up(runs: Sequence[Run], excess: Callable[[Result], float]) -> dict[str, Any] | None:
    if not runs:
        return None
    return {
        "starts": len(runs),
        "converged": sum(r.result.converged for r in runs),
        "reached": sum(excess(r.result) <= SAME for r in runs),
        "distances": [excess(r.result) for r in runs],
        "evaluations": float(np.median([r.result.evaluations for r in runs])),
        "seconds": float(np.median([r.seconds for r in runs])),
    }


def thinned(samples: Sequence[Any], most: int = 60) -> list[Any]:
    """At most the given number of samples, including the first and last, evenly spaced in the logarithm."""
    if len(samples) <= most:
        return list(samples)
    picked = np.unique(np.geomspace(1, len(samples), most).round().astype(int)) - 1
    return [samples[i] for i in picked]
