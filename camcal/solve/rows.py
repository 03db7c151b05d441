"""The rows of the Jacobian, for methods that do not use normal equations.

Points of weight 0, which pad shorter views, are rows of zeros. The prior of a lens model adds rows at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from camcal.solve.problem import Group, Problem, State

Array = np.ndarray


def by_group(problem: Problem, state: State) -> Iterator[tuple[Group, Array | None]]:
    """Rows (G, F + 6 + 1, 2 N) of each group of views: free parameters, pose, residual; None as in `fill`."""
    with np.errstate(all="ignore"):
        for group in problem.groups:
            yield group, problem.free_rows(group, state)


def count(problem: Problem) -> int:
    """Number of rows, excluding those of the prior."""
    return sum(2 * g.uv.shape[0] * g.uv.shape[2] for g in problem.groups)


def residuals(problem: Problem, state: State) -> Array | None:
    """All weighted residuals in the order of `jacobian`; None if a point leaves the lens's domain."""
    parts = []
    for _, rows in by_group(problem, state):
        if rows is None or not np.isfinite(rows[:, -1]).all():
            return None
        parts += list(rows[:, -1])
    own = problem.prior(state)
    return np.concatenate(parts if own is None else [*parts, own[0]])


def jacobian(problem: Problem, state: State, turn: Array | None = None, sparse: bool = False) -> Any:
    """The Jacobian (M, F + 6 V) of `residuals`; None if a point leaves the lens's domain.

    Parameters
    ----------
    problem : Problem
    state : State
    turn : (V, 6, 6) array, optional
        d (left perturbation of a pose) / d (coordinates of the caller).
    sparse : bool
        Return a scipy CSR array in place of a dense one.
    """
    free, instants = problem.variables, problem.instants
    blocks = []
    for group, rows in by_group(problem, state):
        if rows is None:
            return None
        for view, row in zip(problem.seen.instant[group.members], rows, strict=True):
            pose = row[free : free + 6].T
            blocks.append((view, row[:free].T.copy(), pose.copy() if turn is None else pose @ turn[view]))
    own = problem.prior(state)
    if sparse:
        from scipy import sparse as sparse_  # slow to import, and only for optimizers that ask for it

        left = sparse_.csr_array(np.concatenate([b[1] for b in blocks] + ([] if own is None else [own[1]])))
        right = _pose_columns(blocks, instants, 0 if own is None else len(own[0]))
        return sparse_.hstack([left, right], format="csr")
    length = sum(len(b[1]) for b in blocks) + (0 if own is None else len(own[0]))
    out = np.zeros((length, free + 6 * instants))
    at = 0
    for view, left, right in blocks:
        out[at : at + len(left), :free] = left
        out[at : at + len(left), free + 6 * view : free + 6 * view + 6] = right
        at += len(left)
    if own is not None:
        out[at:, :free] = own[1]
    return out


def _pose_columns(blocks: list[tuple[int, Array, Array]], instants: int, more: int) -> Any:
    """The pose columns as a CSR array, with `more` empty rows at the end."""
    data = np.concatenate([b[2].ravel() for b in blocks])
    columns = np.concatenate([np.tile(6 * v + np.arange(6), len(b)) for v, _, b in blocks])
    length = sum(len(b) for _, _, b in blocks)
    starts = np.r_[6 * np.arange(length + 1), np.full(more, 6 * length)]
    from scipy import sparse as sparse_  # as above

    return sparse_.csr_array((data, columns, starts), shape=(length + more, 6 * instants))
