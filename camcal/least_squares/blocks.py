"""Normal equations of shared parameters and many small blocks coupled only to these, and their minimiser.

Poses, lines and scene points are such blocks. With the shared part A (F, F), the blocks D (B, K, K) and what
couples them C (B, F, K), the blocks are eliminated first (Schur complement; Triggs et al., Bundle adjustment:
a modern synthesis, 2000, section 6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from camcal.least_squares import loop
from camcal.least_squares.problem import Options, Trial
from camcal.records import dataclass

Array = np.ndarray
State = TypeVar("State")

#: λ at least: frame and scale of a world that nothing holds have no curvature, and the loop's undamped step would
#: follow what rounding makes of it. It slows a direction whose curvature is 1e-8 of its parameters' own by half
FLOOR = 1e-8

#: converged where a step promises less than this part of the cost: 7 digits of the root mean square and more
PROMISED = 1e-12
#: a cost that rounding makes: residuals are px, or standard deviations, and 1e-9 of either means nothing
ROUNDING = 1e-18
#: of the largest eigenvalue of a normal matrix with unit diagonal: rounding error of sums over some thousand rows
RANK = 1e-14


def bounded_inverse(normal: Array) -> Array:
    """The inverse (P, P) of a normal matrix, positive definite despite rounding.

    The eigenvalues of undetermined directions are rounding errors and may be negative; they are replaced by the limit
    of rounding, so that the parameters that depend on these directions have very large variances. A parameter without
    any effect has one, too, whose products are still finite.
    """
    values, vectors, units = unit_eigen(normal)
    return np.asarray((vectors / np.maximum(values, RANK * values[-1])) @ vectors.T / units)


def unit_eigen(normal: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues (..., P) and vectors (..., P, P) of normal matrices whose diagonals are scaled to 1, and the products
    of the scales (..., P, P) by which the matrices were divided.
    """
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    scale = np.sqrt(np.maximum(diagonal, np.sqrt(np.finfo(float).tiny)))
    units = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(normal / units)
    return values, vectors, units


@dataclass(frozen=True)
class BlockNormal:
    """JᵀJ and Jᵀr of the cost ½ Σ r², by blocks."""

    cost: float
    shared: Array  #: (F, F)
    gradient: Array  #: (F,)
    coupling: Array  #: (B, F, K)
    blocks: Array  #: (B, K, K)
    block_gradients: Array  #: (B, K)

    @classmethod
    def dense(cls, residual: Array, jacobian: Array) -> BlockNormal:
        """Return the equations of residuals (M,) and their Jacobian (M, F), without blocks."""
        f = jacobian.shape[1]
        empty = np.zeros((0, f, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0))
        return cls(0.5 * residual @ residual, jacobian.T @ jacobian, jacobian.T @ residual, *empty)

    @classmethod
    def of_groups(cls, residual: Array, shared: Array, own: Array, group: Array, groups: int) -> BlockNormal:
        """Return the equations of residuals (M,) with Jacobians by the shared (M, F) and each group's own (M, K)
        parameters.

        `group` (M,) says which block each residual belongs to; residuals of a group stand together.
        """
        f, k = shared.shape[1], own.shape[1]
        rows = np.concatenate([shared, own, residual[:, None]], 1)
        starts = np.searchsorted(group, np.arange(groups))
        outer = own[:, :, None] * rows[:, None]
        sums = np.add.reduceat(outer, starts, 0) if groups else np.zeros((0, k, rows.shape[1]))
        return cls(
            0.5 * float(residual @ residual),
            shared.T @ shared,
            shared.T @ residual,
            np.swapaxes(sums[:, :, :f], 1, 2),
            sums[:, :, f : f + k],
            sums[:, :, -1],
        )

    def step(self, damping: float) -> tuple[Array, Array, float] | None:
        """Return the damped step, shared (F,) and of the blocks (B, K), and the decrease that it predicts.

        None where the damped equations are not positive definite.
        """
        a, d = _damped(self.shared[None], damping)[0], _damped(self.blocks, damping)
        try:
            inverse = np.linalg.inv(d) if len(d) else d
            reduced = (
                np.tensordot(self.coupling @ inverse, self.coupling, ([0, 2], [0, 2])) if len(d) else 0.0
            )
            inner = (inverse @ self.block_gradients[..., None])[..., 0] if len(d) else self.block_gradients
            carried = np.einsum("bfk,bk->f", self.coupling, inner) if len(d) else 0.0
            factor = np.linalg.cholesky(a - reduced)
        except np.linalg.LinAlgError:
            return None
        shared = -np.linalg.solve(factor.T, np.linalg.solve(factor, self.gradient - carried))
        if len(d):
            onto = self.block_gradients + np.einsum("bfk,f->bk", self.coupling, shared)
            own = -np.einsum("bkl,bl->bk", inverse, onto)
        else:
            own = np.zeros_like(self.block_gradients)
        if not (np.isfinite(shared).all() and np.isfinite(own).all()):
            return None
        damped = damping * (np.diagonal(self.shared) @ shared**2)
        damped += damping * (np.einsum("bkk->bk", self.blocks) * own**2).sum()
        promised = 0.5 * (damped - self.gradient @ shared - (self.block_gradients * own).sum())
        return shared, own, float(promised)

    def reduced(self) -> Array:
        """The normal matrix (F, F) of the shared parameters with the blocks eliminated."""
        if not len(self.blocks):
            return self.shared
        inverse = np.linalg.pinv(self.blocks, hermitian=True)
        return self.shared - np.tensordot(self.coupling @ inverse, self.coupling, ([0, 2], [0, 2]))


def _damped(matrices: Array, damping: float) -> Array:
    """Matrices (B, K, K) with their diagonals scaled by 1 + damping, each parameter in its own unit."""
    out = matrices.copy()
    index = np.arange(matrices.shape[-1])
    diagonal = out[:, index, index]
    # the floor keeps a parameter without influence solvable: its step is then 0
    out[:, index, index] = diagonal * (1 + damping) + np.finfo(float).tiny ** 0.5
    return out


@dataclass(frozen=True)
class Fitted(Generic[State]):
    """The end of a minimisation, with the normal equations there."""

    state: State
    normal: BlockNormal
    iterations: int
    converged: bool


class _Equations(NamedTuple):
    cost: Array  #: (1,)
    normal: BlockNormal | None


class _One(Generic[State]):
    """A problem with one member and a state of any type."""

    count = 1
    rounding: Any = ROUNDING

    def __init__(
        self,
        linearised: Callable[[State], BlockNormal | None],
        moved: Callable[[State, Array, Array], State],
    ):
        self.linearised, self.moved = linearised, moved

    def linearise(self, state: State, members: Array) -> _Equations:
        normal = self.linearised(state)
        known = normal is not None and np.isfinite(normal.cost)
        return _Equations(np.array([normal.cost if normal is not None and known else np.inf]), normal)

    def solve(self, state: State, equations: _Equations, damping: Array) -> tuple[Any, Array]:
        step = None if equations.normal is None else equations.normal.step(max(float(damping[0]), FLOOR))
        return (None, np.array([np.nan])) if step is None else (step[:2], np.array([step[2]]))

    def retract(self, state: State, step: tuple[Array, Array]) -> State:
        return self.moved(state, *step)

    def tried(self, trial: Trial) -> None:
        """Do nothing: the base class does not learn from trials."""


def minimise(
    linearise: Callable[[State], BlockNormal | None],
    moved: Callable[[State, Array, Array], State],
    state: State,
    iterations: int = 100,
) -> Fitted[State] | None:
    """Return the minimum near a state, by `camcal.least_squares.minimise`; None if the start cannot be linearised.

    Parameters
    ----------
    linearise : state -> BlockNormal
        None where a state is outside the domain: the step there is then shortened.
    moved : (state, shared (F,), own (B, K)) -> state
    """
    options = Options(tolerance=PROMISED, max_iterations=iterations)
    found = loop.minimise(_One(linearise, moved), state, options)
    normal = found.equations.normal
    if normal is None or not np.isfinite(normal.cost):
        return None
    stats = found.stats
    return Fitted(found.state, normal, int(stats.iterations[0]), bool(stats.converged[0]))
