"""Where sigmas do not hold because the parameters that fit do not lie on a straight line.

A covariance takes the sum of squares for a parabola. A model with more coefficients than the lens needs is not
like that: the denominator of a rational model can cancel its numerator, and then k1 = -0.3 fits as well as
k1 = -200, along a curve. Its tangent is short, so that k1 = -12 +- 1.3 is reported where the truth is -0.28.

With λ_k, v_k the eigenvalues and vectors of the reduced matrix, columns scaled by d (`covariance.py`), the ends of
the 95 % interval along one direction are

    δ = ±2 sigma_0 v_k / (√λ_k d),      poses following by -B_v δ and a Gauss-Newton step                (1)

where the sum of squares should have grown by 4 sigma_0² (Bates & Watts, Nonlinear Regression Analysis, 1988,
chapter 7, look at the same through second derivatives). Where it has grown by less than half or more than twice of
that, or a point has left the lens's domain, the interval along this direction says nothing, and a parameter that
owes it a part of its variance is as undetermined as if the direction were flat.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.covariance import NULL, Covariance, eliminate_poses, reduce
from camcal.assess.design import Design
from camcal.model.pose import Array
from camcal.solve.calibration import Calibration, NormalBlocks
from camcal.solve.problem import Blocks, Step

#: Ends of the interval in standard deviations.
REACH = 2.0
#: The sum of squares may have grown by so many times what was said: the interval is then right to a factor √2.
#: Regular models lie between 0.9 and 1.1 with eight views of .5 px.
GROWN = (0.5, 2.0)
#: Directions with a larger eigenvalue have at most three hundred times the sigma of a parameter alone: too
#: short to be curved, and not worth an evaluation.
WEAK = 1e-5
#: Part of a parameter's variance from which on it is lost with the direction. The truth lies ten tangents away
#: where it lies far along the curve (-12 ± 1.3 above), so that a hundredth of the variance is as much as all the rest.
SHARE = 0.01


def beyond_linear(solution: Calibration, accuracy: Covariance) -> Covariance:
    """The covariance with infinite variances where equation (1) shows that a sigma does not hold.

    `free` and `null` stay as they are: projections hardly move along such a direction.

    Parameters
    ----------
    solution : Calibration
    accuracy : Covariance
        That of the solution.
    """
    free = solution.free[:, solution.free.any(0)]
    if not free.shape[1] or not 0 < accuracy.sigma_0 < np.inf:
        return accuracy
    share = curved_share(solution, accuracy)
    lost = (np.abs(free[:, share > SHARE]) > 0).any(1) & np.isfinite(np.diag(accuracy.matrix))
    if not lost.any():
        return accuracy
    matrix = accuracy.matrix.copy()
    matrix[lost] = matrix[:, lost] = np.nan
    matrix[lost, lost] = np.inf
    names = tuple(n for n, v in zip(accuracy.names, np.diag(matrix), strict=True) if np.isinf(v))
    return replace(accuracy, matrix=matrix, undetermined=names)


def curved_share(solution: Calibration, accuracy: Covariance) -> Array:
    """Part (F,) of each free parameter's variance that comes from directions along which (1) fails.

    Zeros where a used point lies outside the lens's domain. A board whose shape was estimated counts as known.
    """
    size = int(solution.free.any(0).sum())
    normal, gain = solution.normal, accuracy.poses_reduced.gain[:, :, :size]
    own = NormalBlocks(normal.intrinsics[:size, :size], normal.coupling[:, :size], normal.poses)
    columns = np.diag(own.intrinsics)
    scale = np.sqrt(np.where(columns > 0, columns, 1.0))
    reduced = reduce(own, replace(accuracy.poses_reduced, gain=gain))
    values, vectors = np.linalg.eigh(reduced / np.outer(scale, scale))
    known = values > NULL
    variances = vectors**2 / np.where(known, values, np.inf)
    curved = np.zeros(size, bool)
    weak = np.flatnonzero(known & (values < WEAK))
    if len(weak):
        ends = REACH * accuracy.sigma_0 * vectors[:, weak] / np.sqrt(values[weak]) / scale[:, None]
        curved[weak] = _fails(Design(solution), gain, ends.T)
    total = variances.sum(1)
    return np.asarray(variances[:, curved].sum(1) / np.where(total > 0, total, 1.0))


def _fails(design: Design, gain: Array, ends: Array) -> Array:
    """Whether (1) fails along each of the steps (K, F) or its opposite, as (K,) bool."""
    problem = design.problem
    begin = problem.linearise(design.state)
    failed = np.zeros(len(ends), bool)
    if begin is None:
        return failed
    for k, end in enumerate(ends):
        for step in (end, -end):
            blocks = problem.linearise(problem.retract(design.state, Step(step, -gain @ step)))
            grown = (_settled(blocks) - begin.cost) / (0.5 * (REACH * design.sigma_0) ** 2)
            failed[k] |= not GROWN[0] <= grown <= GROWN[1]
    return failed


def _settled(blocks: Blocks | None) -> float:
    """The cost once the poses have followed, by the Gauss-Newton step of each; infinite without blocks."""
    if blocks is None:
        return float("inf")
    inverse = eliminate_poses(blocks.normal()).inverse
    gain = np.einsum("vi,vij,vj->", blocks.pose_gradients, inverse, blocks.pose_gradients)
    return float(blocks.cost - 0.5 * gain)
