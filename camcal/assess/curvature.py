"""Invalid sigmas: parameters that fit equally well but do not lie on a straight line.

A covariance takes the sum of squares for a parabola. A model with more coefficients than the lens needs is not
like that: the denominator of a rational model can cancel its numerator, and then k1 = -0.3 fits as well as
k1 = -200, along a curve. Its tangent is short, so that k1 = -12 +- 1.3 is reported where the truth is -0.28.

With λ_k, v_k the eigenvalues and vectors of the reduced matrix, columns scaled by d (`covariance.py`), the ends of
the 95 % interval along one direction are

    δ = ±2 sigma_0 v_k / (√λ_k d),      poses following by -B_v δ and a Gauss-Newton step                (1)

where the sum of squares should have grown by 4 sigma_0² (Bates & Watts, Nonlinear Regression Analysis, 1988,
chapter 7, look at the same through second derivatives). Where it has grown by less than half or more than twice of
that, or a point has left the lens's domain, the interval along this direction may be longer than said: less growth says
so itself, and more growth is also what leaving a curved valley along its tangent looks like. The valley is then
followed outwards, all other parameters and the poses refined at each step (the profile of the sum of squares, op. cit.
section 6.1.2), to where the sum has grown by 4 sigma_0². Half the way that a parameter has gone by then is its sigma,
where that is larger than the one of the covariance by more than √2. Where the sum does not grow as far within
`FARTHEST`, no finite interval exists on that side, and the sigma is infinite.

Such a valley has branches, and the truth may lie on one that no step from the solution leads into. One place in it is
known: a model inside (opencv5 in opencv8) whose own optimum fits as well, by the likelihood ratio. Where the lens needs
no more than that, the intervals reach to it, and as far beyond as the covariance there says (`_inside`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from camcal.assess.covariance import NULL, Covariance, End, covariance, eliminate_poses, reduce
from camcal.assess.design import Design
from camcal.errors import CamcalError
from camcal.geometry.numbers import TINY
from camcal.least_squares.distributions import chi2_quantile
from camcal.model.lenses import make
from camcal.model.lenses.containment import contained, embed
from camcal.model.pose import Array
from camcal.solve import optimizers, starts
from camcal.solve.calibration import Calibration, NormalBlocks
from camcal.solve.optimizers.base import Options
from camcal.solve.problem import Blocks, Problem, State, Step
from camcal.solve.refine import How, refine

#: Ends of the interval in standard deviations: 95 % of a Gaussian distribution.
REACH = 2.0
#: The sum of squares may have grown by so many times what was said at the ends: the interval is then right to a factor
#: √2. Regular models lie between 0.9 and 1.1 with eight views of .5 px.
GROWN = (0.5, 2.0)
#: Directions with a larger eigenvalue have at most three hundred times the sigma of a parameter alone: too
#: short to be curved, and not worth an evaluation.
WEAK = 1e-5
#: Part of a parameter's variance from which on it is changed with the direction. The truth lies ten tangents away
#: where it lies far along the curve (-12 ± 1.3 above), so that a hundredth of the variance is as much as all the rest.
SHARE = 0.01
#: The profile is looked at here first, in parts of the interval of (1), and then so many times as far each time: eight
#: steps to `FARTHEST`. A valley that bends is lost by longer steps.
FIRST, STRIDE = 0.5, 2.0
#: A step that takes the root of the growth to more than so many times what is wanted is halved: from further off the
#: end of the interval cannot be found in proportion.
OVERSHOT = 1.5
#: Part of the first step down to which steps are halved: there the lens's domain, or the valley, ends.
SHORTEST = 0.25
#: An interval that is longer than stated by this factor is not reported: what is off by a hundred stated sigmas was not
#: measured.
FARTHEST = 100.0
#: A step of the profile ends where what is left to gain is below this part of the wanted growth (a hundredth of it
#: moves the end of the interval by half a hundredth), or after so many iterations; it takes three to ten, in the valley
#: of a needless rational model up to 28.
SETTLED, ITERATIONS = 0.01, 30

#: The likelihood ratio below which a model inside is taken to fit as well would be exceeded with this probability if
#: it held. Coefficients that a lens does not need are not identified, and ratios then exceed their χ² more often
#: (Davies, Biometrika 74, 1987): of 13 simulated lenses without a denominator the largest was that of .01.
REJECTED = 1e-3
#: iterations of the fit of a model inside, which begins next to the solution
INSIDE_ITERATIONS = 50

_known: WeakKeyDictionary[NormalBlocks, tuple[float, Covariance]] = WeakKeyDictionary()


def accuracy(solution: Calibration) -> Covariance:
    """The covariance corrected for curvature; computed once per fit.

    Fits that share their normal equations and their sigma_0 are one fit, whatever a solution says besides.
    """
    plain = covariance(solution)
    known = _known.get(solution.normal)
    if known is None or known[0] != plain.sigma_0:
        known = _known[solution.normal] = (plain.sigma_0, beyond_linear(solution, plain))
    return known[1]


def beyond_linear(solution: Calibration, linear: Covariance) -> Covariance:
    """The covariance with the variances from the profile of (1), infinite where it has no end.

    `free` and `null` stay as they are; `ends` hold the cameras at the ends of the curved directions, which projections
    take into account. A board whose shape was estimated counts as known.

    Parameters
    ----------
    solution : Calibration
    linear : Covariance
        That of the solution.
    """
    free = solution.free[:, solution.free.any(0)]
    if not free.shape[1] or not 0 < linear.sigma_0 < np.inf:
        return linear
    matrix, ends = linear.matrix.copy(), []
    for share, reached, found in _curved(solution, linear):
        ends += found
        own = free**2 @ share / np.maximum((free**2).sum(1), TINY)
        variances = np.diag(matrix)
        wider = np.maximum(variances, (1 - own) * variances + (reached / REACH) ** 2)
        # below that the linear sigma is used
        touched = np.isfinite(variances) & (wider > GROWN[1] * variances)
        if any(end.endless for end in found):
            touched |= (own > SHARE) & np.isfinite(variances)
            wider[touched] = np.inf
        _widen(matrix, wider, touched)
    inside = _inside(solution, linear) if ends else None
    if inside is not None:
        end, own = inside
        ends.append(end)
        variances = np.diag(matrix)
        wider = (np.abs(end.params - solution.camera.params) / REACH + own) ** 2
        _widen(matrix, wider, np.isfinite(variances) & (wider > GROWN[1] * variances))
    names = tuple(n for n, v in zip(linear.names, np.diag(matrix), strict=True) if np.isinf(v))
    return replace(linear, matrix=matrix, undetermined=names, ends=tuple(ends))


def _widen(matrix: Array, variances: Array, some: Array) -> None:
    """Scale some rows and columns to other variances, keeping correlations, or make them infinite."""
    endless = some & ~np.isfinite(variances)
    finite = some & ~endless
    scale = np.ones(len(variances))
    scale[finite] = np.sqrt(variances[finite] / np.diag(matrix)[finite])
    matrix *= np.outer(scale, scale)
    matrix[endless] = matrix[:, endless] = np.nan
    matrix[endless, endless] = np.inf


def _inside(solution: Calibration, linear: Covariance) -> tuple[End, Array] | None:
    """The optimum of the smallest nested model that fits as well, and the sigmas (P,) of the larger model there.

    None where the data need what the larger model has more, or parameters are tied to one another.
    """
    lens, data = solution.camera.lens, solution.observations
    if (solution.free != 0).sum(0).max() > 1:
        return None
    held: dict[str, float | None] = {n: solution.camera.values[n] for n in solution.held}
    size = int(solution.free.any(0).sum())
    for spec in reversed(contained(lens)):
        inner = make(spec, lens.has_skew)
        how = How(
            {n: v for n, v in held.items() if n in inner.names},
            stopping=Options(max_iterations=INSIDE_ITERATIONS),
        )
        try:
            begin = starts.regressed(inner, solution.camera, data.kept(), how.fix)
            fit = refine(begin, solution.poses, data, how)
        except CamcalError:
            continue
        ratio = 2 * (fit.fit.cost - solution.fit.cost) / linear.sigma_0**2
        params = embed(lens, inner, fit.camera.params)
        fewer = size - int(fit.free.any(0).sum())
        if params is not None and fewer > 0 and ratio < chi2_quantile(1 - REJECTED, fewer):
            camera = replace(solution.camera, params=params)
            there = refine(camera, fit.poses, data, How(held, stopping=Options(max_iterations=0)))
            return End(-1, params, fit.poses, 1.0), np.sqrt(np.diag(covariance(there).matrix))
    return None


def _curved(solution: Calibration, linear: Covariance) -> Iterator[tuple[Array, Array, list[End]]]:
    """For each direction whose interval is longer than (1) predicts, its share (F,) of each free parameter's
    variance.

    With it how far each parameter (P,) goes until the sum of squares has grown as said, or as far as was looked, and
    the cameras at the ends. Nothing where a used point lies outside the lens's domain.
    """
    size = int(solution.free.any(0).sum())
    normal, gain = solution.normal, linear.poses_reduced.gain[:, :, :size]
    own = NormalBlocks(normal.intrinsics[:size, :size], normal.coupling[:, :size], normal.poses)
    columns = np.diag(own.intrinsics)
    scale = np.sqrt(np.where(columns > 0, columns, 1.0))
    reduced = reduce(own, replace(linear.poses_reduced, gain=gain))
    values, vectors = np.linalg.eigh(reduced / np.outer(scale, scale))
    known = values > NULL
    variances = vectors**2 / np.where(known, values, np.inf)
    total = variances.sum(1)
    weak = np.flatnonzero(known & (values < WEAK))
    if not len(weak):
        return
    valley = _Valley(Design(solution), gain)
    if valley.begin is None:
        return
    for k in weak:
        end = REACH * linear.sigma_0 * vectors[:, k] / np.sqrt(values[k]) / scale
        sides = [side for side in (end, -end) if not GROWN[0] <= valley.grown(side) <= GROWN[1]]
        if sides:
            yield variances[:, k] / np.where(total > 0, total, 1.0), *valley.reached(sides, int(k))


class _Valley:
    """The sum of squares about a solution, along steps of the camera's free parameters."""

    def __init__(self, design: Design, gain: Array):
        self.design, self.gain = design, gain
        self.begin = design.problem.linearise(design.state)
        self.wanted = 0.5 * (REACH * design.sigma_0) ** 2

    def _moved(self, step: Array, state: State | None = None) -> State:
        return self.design.problem.retract(state or self.design.state, Step(step, -self.gain @ step))

    def grown(self, step: Array) -> float:
        """The growth of the cost after a step, with poses following, relative to the prediction; inf outside the
        domain.
        """
        assert self.begin is not None
        return (_settled(self.design.problem.linearise(self._moved(step))) - self.begin.cost) / self.wanted

    def reached(self, sides: list[Array], direction: int) -> tuple[Array, list[End]]:
        """The distance of each parameter (P,) along given sides at which the cost has grown by the target.

        And where that is, or the last place looked at.
        """
        begin, ends = self.design.state.params, []
        for side in sides:
            state, grown = self._followed(side)
            part = 1 / max(grown, 1.0)
            ends.append(End(direction, state.params, self.design.problem.poses(state), part, grown < 1))
        ways = [np.abs(end.part * (end.params - begin)) for end in ends]
        return np.max(ways, axis=0), ends

    def _followed(self, end: Array) -> tuple[State, float]:
        """The state where the cost has grown enough, or the last one, and the growth in roots."""
        begin, design = self.begin, self.design
        assert begin is not None
        across = np.linalg.svd(end[None])[2][1:].T  # the directions at right angles to the step, (F, F - 1)
        held = Problem(design.problem.lens, design.views, design.transform @ across, design.problem.weights)
        stopping = Options(tolerance=SETTLED * self.wanted / begin.cost, max_iterations=ITERATIONS)
        state, at, reach, grown = design.state, 0.0, FIRST, 0.0
        while at < FARTHEST:
            moved = self._moved((reach - at) * end, state)
            outside, found = held.linearise(moved) is None, 0.0
            if not outside:
                result = optimizers.make("lm")(held, moved, stopping)
                found = float(np.sqrt(max(result.blocks.cost - begin.cost, 0.0) / self.wanted))
            if outside or found > OVERSHOT:
                if reach - at < SHORTEST * FIRST:
                    return state, max(grown, 1.0)
                reach = (reach + at) / 2
                continue
            state, at, grown = result.state, reach, found
            if grown >= 1:
                break
            reach *= STRIDE
        return state, grown


def _settled(blocks: Blocks | None) -> float:
    """The cost after one Gauss-Newton step of each pose; infinite without blocks."""
    if blocks is None:
        return float("inf")
    inverse = eliminate_poses(blocks.normal()).inverse
    gain = np.einsum("vi,vij,vj->", blocks.pose_gradients, inverse, blocks.pose_gradients)
    return float(blocks.cost - 0.5 * gain)
