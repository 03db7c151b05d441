"""Covariance of the parameters and poses from the blocks of JᵀJ, without forming the whole matrix.

With U, W_v, A_v the blocks of `NormalBlocks` (camera; coupling; pose of view v), all of the weighted problem:

    S     = U - Σ_v W_v A_v⁻¹ W_vᵀ                          reduced by the poses (Schur complement)  (1)
    C_f   = sigma_0² S⁻¹                                    free parameters                          (2)
    C_p   = T C_f Tᵀ                                        all parameters, T = d params / d free    (3)
    C_v   = sigma_0² A_v⁻¹ + B_v C_f B_vᵀ,  B_v = A_v⁻¹ W_vᵀ       pose of view v                    (4)

Triggs et al., Bundle Adjustment - A Modern Synthesis (2000), section 6; sigma_0 is that of `figures.py`, so
that given sigmas count as relative weights and their common scale is estimated.

S⁻¹ does not exist for a direction that the data do not determine: its eigenvalue is 0 up to rounding, and a
pseudo-inverse would drop it and report the smallest sigma exactly where it should be largest. S is scaled by
the lengths of the Jacobian's columns; its eigenvalues then lie between 0 and F, whatever the units, and
rounding leaves about 1e-15 of the cancelled part. Directions below `NULL` get an infinite variance, and so
does each parameter that has a part in them.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from camcal.assess.figures import sigma_0
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.solve.calibration import Estimate, NormalBlocks

Array = np.ndarray

#: Eigenvalue of the column-scaled reduced matrix below which a direction counts as undetermined. Rounding in
#: (1) is 1e-15 to 1e-14; at 1e-12 a direction's sigma is a million times that of a parameter alone.
NULL = 1e-12
#: Component of a unit null direction (scaled columns) above which a parameter counts as affected by it.
TOUCHED = 1e-3
#: correlations beyond this are listed: one parameter then explains 90 % of the other's variance
STRONG = 0.95
#: squared sine of the angle between multiples: their products round to 1e-15
COUPLED = 1e-12


@dataclass(frozen=True)
class ReducedPoses:
    """The result of eliminating the poses.

    `inverse` is A_v⁻¹ (V, 6, 6), `gain` is B_v of (4) as (V, 6, F), `columns` the lengths of the pose columns
    of the Jacobian (V, 6), `undetermined` (V, 6) what the view's own points do not determine.
    """

    inverse: Array
    gain: Array
    columns: Array
    undetermined: Array


@dataclass(frozen=True)
class End:
    """The end of the 95 % interval along a curved direction (`curvature.py`).

    Attributes
    ----------
    direction : int
        Index of the curved direction; each has up to two ends.
    params : (P,) array
    poses : Poses
        cam_from_board of each view.
    part : float
        The end itself lies at this fraction of the way from the solution to these parameters.
    endless : bool
        No end was found up to here.
    """

    direction: int
    params: Array
    poses: Poses
    part: float
    endless: bool = False


@dataclass(frozen=True)
class Covariance:
    """The covariance of a solution.

    Attributes
    ----------
    names : tuple of str
        The camera's parameters.
    matrix : (P, P) array
        Covariance of all parameters; rows of zeros where fixed, infinite variances where undetermined (their
        covariances are NaN).
    transform : (P, F) array
        T = d params / d free parameters.
    free : (F, F) array
        Covariance of the determined part of the free parameters.
    null : (F, K) array
        Undetermined directions of the free parameters, as columns of unit length in scaled columns; K is
        usually 0.
    sigma_0 : float
        The factor of the covariance, see `figures.py`.
    condition : float
        Condition number of the column-scaled reduced matrix.
    undetermined : tuple of str
    ends : tuple of End
        Of the intervals along directions that are curved; empty for what `covariance` gives.
    """

    names: tuple[str, ...]
    matrix: Array
    transform: Array
    free: Array
    null: Array
    sigma_0: float
    condition: float
    undetermined: tuple[str, ...]
    poses_reduced: ReducedPoses
    ends: tuple[End, ...] = ()

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of each parameter: 0 where fixed, inf where undetermined."""
        return dict(zip(self.names, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    def poses(self) -> Array:
        """Equation (4): (V, 6, 6), inf where undetermined.

        In the coordinates of `NormalBlocks`: rotation on the left about the centroid of the view's points
        (rad), then that centroid's place in the camera's frame.
        """
        b = self.poses_reduced.gain
        out = b @ self.free @ b.transpose(0, 2, 1) + self.sigma_0**2 * self.poses_reduced.inverse
        lost = np.abs(b @ self.null).max(-1, initial=0.0) * self.poses_reduced.columns > TOUCHED
        for view, coordinate in np.argwhere(lost | self.poses_reduced.undetermined):
            out[view, coordinate, :] = out[view, :, coordinate] = np.nan
        for view, coordinate in np.argwhere(lost | self.poses_reduced.undetermined):
            out[view, coordinate, coordinate] = np.inf
        return out

    def strong_correlations(self, bound: float = STRONG) -> list[tuple[str, str, float]]:
        """Pairs of determined parameters whose correlation exceeds `bound`, the strongest first.

        Parameters that are coupled by choice (`--fix aspect`) are excluded.
        """
        d = np.sqrt(np.diag(self.matrix))
        ok = np.flatnonzero(np.isfinite(d) & (d > 0))
        r = self.matrix[np.ix_(ok, ok)] / np.outer(d[ok], d[ok])
        pairs = [
            (self.names[ok[i]], self.names[ok[j]], float(r[i, j]))
            for i, j in np.argwhere(np.triu(np.abs(r) > bound, 1))
            if not _coupled(*self.transform[ok[[i, j]]])
        ]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))


def _coupled(a: Array, b: Array) -> bool:
    """Whether two rows d parameter / d free parameters are multiples of each other, to rounding."""
    return bool((a @ a) * (b @ b) - (a @ b) ** 2 <= COUPLED * (a @ a) * (b @ b))


#: the covariance of a fit, with the sigma_0 and the free parameters that it was made with
_known: WeakKeyDictionary[NormalBlocks, tuple[float, Array, Covariance]] = WeakKeyDictionary()


def covariance(solution: Estimate) -> Covariance:
    """The covariance of a solution's parameters and poses; computed once per fit.

    If the redundancy is not positive (no more coordinates than parameters), the noise is unknown,
    and every free parameter's sigma is infinite.
    """
    scale = sigma_0(solution)
    known = _known.get(solution.normal)
    if known is None or known[0] != scale or known[1] is not solution.free:
        known = _known[solution.normal] = (scale, solution.free, _covariance(solution, scale))
    return known[2]


def _covariance(solution: Estimate, scale: float) -> Covariance:
    unknown_noise = not np.isfinite(scale)
    poses = eliminate_poses(solution.normal)
    columns = np.diag(solution.normal.intrinsics)
    free, null, condition = invert_determined(
        reduce(solution.normal, poses), columns, 1.0 if unknown_noise else scale
    )
    touched = np.abs(solution.free if unknown_noise else solution.free @ null).max(-1, initial=0.0) > 0
    matrix = solution.free @ free @ solution.free.T
    matrix[touched] = matrix[:, touched] = np.nan
    matrix[touched, touched] = np.inf
    names = solution.names
    undetermined = tuple(n for n, t in zip(names, touched, strict=True) if t)
    return Covariance(names, matrix, solution.free, free, null, scale, condition, undetermined, poses)


def eliminate_poses(normal: NormalBlocks) -> ReducedPoses:
    """Invert the pose blocks, all views at once.

    A pose that its own points do not determine (fewer than 3, or all on a line) has a singular block; its
    null directions take nothing from S and are noted.
    """
    d = np.sqrt(np.einsum("vii->vi", normal.poses))
    scale = np.where(d > 0, d, 1.0)
    values, vectors = np.linalg.eigh(normal.poses / (scale[:, :, None] * scale[:, None, :]))
    good = values > NULL
    weights = np.where(good, 1 / np.where(good, values, 1.0), 0.0)
    inverse = (vectors * weights[:, None, :]) @ vectors.transpose(0, 2, 1)
    inverse /= scale[:, :, None] * scale[:, None, :]
    undetermined = (np.abs(vectors) * ~good[:, None, :]).max(-1) > TOUCHED
    return ReducedPoses(inverse, inverse @ normal.coupling.transpose(0, 2, 1), d, undetermined)


def reduce(normal: NormalBlocks, poses: ReducedPoses) -> Array:
    """Equation (1), (F, F)."""
    f, rows = len(normal.intrinsics), 6 * len(normal.poses)  # f = 0 where the camera is known
    coupling = normal.coupling.transpose(1, 0, 2).reshape(f, rows)
    reduced = normal.intrinsics - coupling @ poses.gain.reshape(rows, f)
    return (reduced + reduced.T) / 2


def invert_determined(reduced: Array, columns: Array, scale: float = 1.0) -> tuple[Array, Array, float]:
    """The inverse over the determined directions, the others as columns, and the condition number."""
    if not len(reduced):
        return reduced, np.zeros((0, 0)), 1.0
    d = np.sqrt(np.where(columns > 0, columns, 1.0))
    values, vectors = np.linalg.eigh(reduced / np.outer(d, d))
    good = values > NULL
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    null = vectors[:, ~good]
    null[np.abs(null) < TOUCHED] = 0.0  # rounding leaves a component of a null direction in every parameter
    condition = float(values[-1] / values[0]) if values[0] > 0 else float("inf")
    return scale**2 * inverse / np.outer(d, d), null / d[:, None], condition
