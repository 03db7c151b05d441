"""Fit a lens model to pairs of rays and pixels, starting from a rough camera or another model.

BabelCalib's idea (Lochman et al., ICCV 2021): solve for one general model, then regress to each target model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camcal.least_squares import Normal, Options, Small, minimise
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.containment import embed
from camcal.records import dataclass

Array = np.ndarray

#: parts of the rays, by their angle, that a fit takes in one after the other where its start does not hold all: the
#: inner two fifths suit every model, and each further cone is one that the fit before it nearly holds
CONES = (0.4, 0.7, 0.9, 1.0)
#: fits to a cone: each may bring more of its rays into the domain; after three the rest lies outside the model
ROUNDS = 3
#: steps for all rays, where flat valleys (mei, opencv8) take some forty, and for a cone, which gives a start only
LAST_STEPS, STEPS = 50, 12
#: part of the cost to which a fit approaches its minimum
SETTLED = 1e-9
#: px, far below what corners are found to: with an error this small no other start is tried
EXACT = 1e-6
#: results whose parameters agree to this part are the same minimum: `SETTLED` leaves sqrt(1e-9) = 3e-5 of them
#: undetermined, more in flat valleys
SAME = 1e-3
#: pairs that a fit is given at most, and the outermost ones that are always among them: 1400 equations for the 20
#: parameters of a model, or the hundred of a spline
ENOUGH, OUTERMOST = 700, 20
#: a linear solution that covers this part of the rays, with an error of this part of the image's extent (13 px of 640),
#: is the only start: an ordinary lens bends its picture by no more
COVERED, NEAR = 0.97, 0.02
#: a ray whose pixel is missed by more than this part of the image's extent counts as not covered: a
#: perspective model throws rays of nearly 90 degrees anywhere, and would give up all others for them
MISSED = 0.2
#: rays from which the camera matrix is found linearly: two unknowns in a coordinate, three with skew, and one to spare
LEAST_RAYS = 4


@dataclass(frozen=True)
class Regression:
    """The result of `regress`.

    Attributes
    ----------
    params : (P,) array
    covered : (N,) bool array
        Rays within the domain of the result that come near to their pixels.
    errors : (N,) array
        Distances in px between the pixels and the projected rays; NaN outside the domain.
    score : float
        Mean square of the errors, px², those that are not covered counted as `MISSED`: what starts and
        results are compared by.
    """

    params: Array
    covered: Array
    errors: Array
    score: float

    @property
    def rms(self) -> float:
        """Root mean square of the errors of the covered rays, px; inf without any."""
        e = self.errors[self.covered]
        return float(np.sqrt(np.mean(e * e))) if len(e) else np.inf


def regress(
    lens: Lens,
    rays: Array,
    uv: Array,
    image_size: tuple[int, int] | None = None,
    hold: Sequence[str] | None = None,
    start: Array | None = None,
) -> Regression:
    """Find the parameters with which a lens projects the given rays to the given pixels.

    Least squares in px. Without a start, from the shapes that the model suggests, each with its camera matrix found
    linearly, and from the optimum of a smaller model of its family.

    Parameters
    ----------
    lens : Lens
    rays : (N, 3) array, of any length
    uv : (N, 2) array, px
    image_size : (width, height), for models that have to know how far the image goes
    hold : sequence of str
        Parameters to hold where they start; by default the model's own `default_fixed`.
    start : (P,) array, optional
    """
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    if len(rays) > ENOUGH:
        some = regress(lens, *_thinned(rays, uv), image_size, hold, start)
        return measure(lens, some.params, rays, uv)
    held = lens.default_fixed if hold is None else hold
    free = np.array([n not in held for n in lens.names])
    starts = [start] if start is not None else _starts(lens, rays, uv, image_size, hold)
    measured = [measure(lens, s, rays, uv) for s in starts]
    found = []
    for i in np.argsort([m.score for m in measured]):
        found.append(_grow(lens, starts[i], rays, uv, free))
        if found[-1].score < EXACT**2:
            break
    return min(found, key=lambda r: r.score)


def minima(
    lens: Lens,
    rays: Array,
    uv: Array,
    image_size: tuple[int, int] | None = None,
    hold: Sequence[str] | None = None,
) -> list[Array]:
    """Parameters (P,) of all minima that `regress` finds from its starts, the best first."""
    rays, uv = _thinned(rays / np.linalg.norm(rays, axis=1, keepdims=True), uv)
    held = lens.default_fixed if hold is None else hold
    free = np.array([n not in held for n in lens.names])
    found: list[Regression] = []
    for start in _starts(lens, rays, uv, image_size, hold):
        result = _grow(lens, start, rays, uv, free)
        if result.covered.all() and not any(np.allclose(result.params, r.params, rtol=SAME) for r in found):
            found.append(result)
    return [r.params for r in sorted(found, key=lambda r: r.score)]


def _thinned(rays: Array, uv: Array) -> tuple[Array, Array]:
    """Thin the pairs to a sufficient number, always keeping the outermost."""
    order = np.argsort(rays[:, 2])  # from the rim inwards
    even = (np.arange(ENOUGH - OUTERMOST) * len(rays) / (ENOUGH - OUTERMOST)).astype(int)
    chosen = np.unique(np.r_[order[:OUTERMOST], order[even]])
    return rays[chosen], uv[chosen]


def measure(lens: Lens, params: Array, rays: Array, uv: Array) -> Regression:
    """Measure the errors with which a camera projects rays (N, 3) to pixels (N, 2)."""
    seen, covered = lens.project(params, rays)
    errors = np.linalg.norm(seen - uv, axis=1)
    missed = MISSED * float(np.ptp(uv, axis=0).max())
    with np.errstate(invalid="ignore"):
        covered &= errors <= missed
    score = float(np.mean(np.where(covered, errors, missed) ** 2))
    return Regression(params, covered, errors, score)


def _starts(
    lens: Lens, rays: Array, uv: Array, image_size: tuple[int, int] | None, hold: Sequence[str] | None
) -> list[Array]:
    shapes = lens.shapes(rays, uv, image_size)
    found = [_with_matrix(lens, shape, rays, uv) for shape in shapes]
    if "fx" in shapes[0] and _near(measure(lens, found[0], rays, uv), uv):
        return found[:1]  # a linear solution has no other minima
    nested = lens.smaller()
    if (
        len(shapes) <= 2 and {} in shapes and nested
    ):  # few starts of its own: begin at the optimum of a smaller one
        inner = make(nested[0], lens.has_skew)
        start = embed(lens, inner, regress(inner, rays, uv, image_size, hold).params)
        found += [] if start is None else [start]
    return found


def _near(start: Regression, uv: Array) -> bool:
    """Return whether a start is as close to a pinhole camera as an ordinary lens is."""
    return bool(start.covered.mean() > COVERED and start.rms < NEAR * float(np.ptp(uv, axis=0).max()))


def _with_matrix(lens: Lens, shape: dict[str, float], rays: Array, uv: Array) -> Array:
    """The parameters of a shape; the camera matrix by linear least squares unless the shape includes one."""
    params = lens.from_values(shape)
    if "fx" in shape:
        return params
    m, valid = lens.project(params, rays)  # the neutral matrix is the identity
    angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    valid &= angle <= np.quantile(angle, CONES[0])
    if valid.sum() < LEAST_RAYS:
        return params
    m, known = m[valid], uv[valid]
    one = np.ones(len(m))
    if lens.has_skew:
        params[[0, 4, 2]] = np.linalg.lstsq(np.c_[m, one], known[:, 0], rcond=None)[0]
    else:
        params[[0, 2]] = np.linalg.lstsq(np.c_[m[:, 0], one], known[:, 0], rcond=None)[0]
    params[[1, 3]] = np.linalg.lstsq(np.c_[m[:, 1], one], known[:, 1], rcond=None)[0]
    params[:2] = np.abs(params[:2])
    return params


def _grow(lens: Lens, params: Array, rays: Array, uv: Array, free: Array) -> Regression:
    """Fit to the rays within widening cones while the model covers them; return the best fit on the way."""
    angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    best = result = measure(lens, params, rays, uv)
    for part in CONES[-1:] if result.covered.all() else CONES:
        chosen = result.covered & (angle <= np.quantile(angle, part))
        for _ in range(ROUNDS):
            if 2 * chosen.sum() < free.sum():  # fewer equations than unknowns
                break
            steps = LAST_STEPS if part == CONES[-1] else STEPS
            params = _fit(lens, params, rays[chosen], uv[chosen], free, steps)
            result = measure(lens, params, rays, uv)
            best = min(best, result, key=lambda r: r.score)
            wider = chosen | (result.covered & (angle <= np.quantile(angle, part)))
            if wider.sum() == chosen.sum():
                break
            chosen = wider
    return best


def _fit(lens: Lens, params: Array, rays: Array, uv: Array, free: Array, steps: int) -> Array:
    """Least squares from a start at which all rays are in the domain; steps that leave it are rejected."""
    problem = _Pairs(lens, params, rays, uv, free)
    found = minimise(problem, params[None, free], Options(SETTLED, steps)).state[0]
    return problem.whole(found)


class _Pairs(Small):
    """Rays and pixels as a batch of one; the state (1, F) holds the free parameters, clipped to their ranges."""

    count = 1

    def __init__(self, lens: Lens, params: Array, rays: Array, uv: Array, free: Array):
        self.lens, self.params, self.uv, self.free = lens, params, uv, free
        self.x, self.y, self.z = (np.ascontiguousarray(c)[None] for c in rays.T)
        # a few units in the last place of each coordinate
        self.rounding = len(uv) * (4 * np.finfo(float).eps * float(np.abs(uv).max(initial=0.0))) ** 2
        self.lower = np.array([p.lower for p in lens.parameters])[free]
        self.upper = np.array([p.upper for p in lens.parameters])[free]

    def whole(self, own: Array) -> Array:
        """Return all parameters (P,) from the free ones."""
        params = self.params.copy()
        params[self.free] = own
        return params

    def linearise(self, state: Array, members: Array) -> Normal:
        """Residuals in px, and those of the lens's prior."""
        n, count, params = len(self.uv), state.shape[1], self.whole(state[0])
        out, d_xyz, rows = np.empty((1, 2, n)), np.empty((1, 3, 2, n)), np.empty((1, self.lens.size, 2, n))
        with np.errstate(all="ignore"):
            inside = self.lens.linearise(params, self.x, self.y, self.z, out, d_xyz, rows)
        if not inside:
            return Normal(np.array([np.inf]), np.zeros((1, count, count)), np.zeros((1, count)))
        r, j = (out[0] - self.uv.T).ravel(), rows[0][self.free].reshape(count, -1)
        prior = self.lens.prior(params)
        if prior is not None:
            r, j = np.r_[r, prior[0]], np.concatenate([j, prior[1][:, self.free].T], 1)
        return Normal.of(r[None], j[None])

    def retract(self, state: Array, step: Array) -> Array:
        """Clip the parameters to their ranges."""
        return np.clip(state + step, self.lower, self.upper)
