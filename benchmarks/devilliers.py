"""Brown's model of rising order by every optimiser: the experiment of de Villiers, Leuschner & Geldenhuys.

J. P. de Villiers, F. W. Leuschner, R. Geldenhuys, Centi-pixel accurate real-time inverse distortion correction,
Proc. SPIE 7266 (2008): a wide lens of strong barrel distortion is characterised by Brown's model, its *inverse*
(undistorted to distorted) by one of higher order fitted to the same points, and the optimisers are compared by
the residual in px. Here the lens is simulated (equidistant with its own coefficients, decentred), so that the
truth is known and fits can be judged on a dense grid that was not fitted.

    x = u - c, s = |x|² / L²
    d = c + x (1 + K1 s + ... + Kn sⁿ) + (P1 (s L² + 2 x²) + 2 P2 x y, ...) / L (1 + P3 s + ...)          (1)

Every optimiser gets the same residuals and derivatives, from the centre of the picture and no distortion, in
three kinds of variables: pixels (L = 1, unscaled), normalised (L = half the diagonal, otherwise unscaled), and
scaled (normalised, columns of unit length). For Levenberg-Marquardt the unscaled kinds are Levenberg's damping
by a multiple of the unit matrix.

Seconds are those of the processor. Usage: python benchmarks/devilliers.py [--steps 10000] [--update docs/solvers.md]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tables import markdown, update

from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.lenses.parameters import Parameter
from camcal.model.pose import Poses
from camcal.solve.optimizers import make
from camcal.solve.optimizers.base import Options, Result
from camcal.solve.problem import Problem

SIZE = (1600, 1200)
HALF_DIAGONAL = float(np.hypot(*SIZE)) / 2
#: radial and decentering terms; the paper's range and two beyond it
ORDERS = ((1, 0), (2, 0), (3, 0), (3, 1), (4, 1), (5, 1), (5, 2), (7, 2))
KINDS = ("pixels", "normalised", "scaled")
OPTIMIZERS = ("lm", "lm:qr", "gauss-newton", "fletcher-reeves", "polak-ribiere", "leapfrog", "lbfgs", "scipy")
FIRST_ORDER = ("fletcher-reeves", "polak-ribiere", "leapfrog", "lbfgs")


def true_pairs(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Undistorted and distorted points (N, 2), px, of a grid over the distorted picture."""
    lens = lenses.make("kb4")
    params = lens.from_values(
        {"fx": 1140.0, "fy": 1140.0, "cx": 811.0, "cy": 592.0, "k1": 0.02, "k2": -0.008, "k3": 0.002}
    )
    margin = 10
    x, y = np.linspace(margin, SIZE[0] - margin, columns), np.linspace(margin, SIZE[1] - margin, rows)
    seen = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    rays, valid = lens.unproject(params, seen)
    assert valid.all()
    plain = params[:2] * rays[:, :2] / rays[:, 2:]
    # a decentred element: some px at the corners
    x, y = plain.T
    p1, p2 = 1e-3 / HALF_DIAGONAL, -6e-4 / HALF_DIAGONAL
    bent = [p1 * (3 * x * x + y * y) + 2 * p2 * x * y, 2 * p1 * x * y + p2 * (x * x + 3 * y * y)]
    return plain + params[2:4], seen + np.stack(bent, 1)


class BrownMap:
    """Equation (1) as the rows of a lens without views: all that a problem asks of one."""

    def __init__(
        self, radial: int, decentering: int, length: float, u: np.ndarray, d: np.ndarray, dtype=float
    ):
        self.radial, self.decentering, self.length, self.dtype = radial, decentering, length, dtype
        self.u, self.d = u.astype(dtype), d.astype(dtype)
        count = decentering + 1 if decentering else 0
        names = ["xc", "yc", *(f"K{i + 1}" for i in range(radial)), *(f"P{i + 1}" for i in range(count))]
        self.parameters = tuple(Parameter(n, "distortion") for n in names)
        self.size = len(names)

    def start(self) -> np.ndarray:
        return np.r_[(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, np.zeros(self.size - 2)]

    def prior(self, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (2 N,) and Jacobian (2 N, P)."""
        p = params.astype(self.dtype)
        x, y = (self.u[:, i] - p[i] for i in (0, 1))
        length = self.dtype(self.length)
        s = (x * x + y * y) / length**2
        powers = [s**i for i in range(self.radial + 1)]
        k = p[2 : 2 + self.radial]
        f = 1 + sum((k[i] * powers[i + 1] for i in range(self.radial)), np.zeros_like(s))
        slope = sum(((i + 1) * k[i] * powers[i] for i in range(self.radial)), np.zeros_like(s))
        j = np.zeros((2, len(x), self.size), self.dtype)
        # d/dxc: the centre, then the shift of x in the rest
        sx, sy = 2 * x / length**2, 2 * y / length**2
        out = [p[0] + x * f, p[1] + y * f]
        along = [[f + x * slope * sx, x * slope * sy], [y * slope * sx, f + y * slope * sy]]
        for i in range(self.radial):
            j[0, :, 2 + i], j[1, :, 2 + i] = x * powers[i + 1], y * powers[i + 1]
        if self.decentering:
            self._decentre(p[2 + self.radial :], x, y, s, sx, sy, out, along, j[:, :, 2 + self.radial :])
        for axis in (0, 1):
            j[axis, :, 0], j[axis, :, 1] = -along[axis][0], -along[axis][1]
            j[axis, :, axis] += 1
        r = np.stack([out[0] - self.d[:, 0], out[1] - self.d[:, 1]])
        return r.reshape(-1).astype(float), j.reshape(-1, self.size).astype(float)

    def _decentre(self, p, x, y, s, sx, sy, out, along, j) -> None:
        length = self.dtype(self.length)
        h = 1 + sum((p[2 + i] * s ** (i + 1) for i in range(len(p) - 2)), np.zeros_like(s))
        dh = sum(((i + 1) * p[2 + i] * s**i for i in range(len(p) - 2)), np.zeros_like(s))
        a, b, c = (3 * x * x + y * y) / length, 2 * x * y / length, (x * x + 3 * y * y) / length
        t = [p[0] * a + p[1] * b, p[0] * b + p[1] * c]
        dt = [
            [(6 * p[0] * x + 2 * p[1] * y) / length, (2 * p[0] * y + 2 * p[1] * x) / length],
            [(2 * p[0] * y + 2 * p[1] * x) / length, (2 * p[0] * x + 6 * p[1] * y) / length],
        ]
        for axis in (0, 1):
            out[axis] = out[axis] + t[axis] * h
            along[axis][0] = along[axis][0] + dt[axis][0] * h + t[axis] * dh * sx
            along[axis][1] = along[axis][1] + dt[axis][1] * h + t[axis] * dh * sy
            j[axis, :, 0] = (a if axis == 0 else b) * h
            j[axis, :, 1] = (b if axis == 0 else c) * h
            for i in range(len(p) - 2):
                j[axis, :, 2 + i] = t[axis] * s ** (i + 1)


@dataclass(frozen=True)
class Fit:
    """One fit and what became of it."""

    optimizer: str
    kind: str
    order: tuple[int, int]
    result: Result
    seconds: float
    rms: float  #: over the fitted points, px
    check: float  #: over a dense grid that was not fitted, px


def problem_of(order: tuple[int, int], kind: str, pairs, dtype=float) -> Problem:
    length = 1.0 if kind == "pixels" else HALF_DIAGONAL
    model = BrownMap(*order, length, *pairs, dtype=dtype)
    problem = Problem(model, (), np.eye(model.size), normalise=kind == "scaled")  # type: ignore[arg-type]
    problem.rounding = len(pairs[0]) * 2e-25  # of residuals of 1e3 px
    return problem


def spec_of(optimizer: str, kind: str) -> str:
    """The optimiser's variant that leaves its variables as they are, or scales them."""
    if optimizer in FIRST_ORDER:
        return f"{optimizer}:{'scaled' if kind == 'scaled' else 'plain'}"
    return "lm:schur" if optimizer == "lm" else optimizer


def fit(optimizer: str, kind: str, order, pairs, dense, steps: int | None = None, dtype=float) -> Fit:
    """Fit from the centre of the picture and no distortion; the figures are in float64 in any case."""
    problem = problem_of(order, kind, pairs, dtype)
    state = problem.state(problem.lens.start(), Poses.stack([]))  # type: ignore[attr-defined]
    begin = time.process_time()
    with np.errstate(all="ignore"):
        result = make(spec_of(optimizer, kind))(problem, state, Options(max_iterations=steps))
    took = time.process_time() - begin
    figures = []
    for u, d in (pairs, dense):
        exact = BrownMap(*order, problem.lens.length, u, d)  # type: ignore[attr-defined]
        r, _ = exact.prior(result.state.params)
        figures.append(float(np.sqrt((r**2).sum() / len(u))))
    return Fit(optimizer, kind, order, result, took, *figures)


def stopped_early(found: Fit, least: float) -> float:
    """The rms where a rule stops that ends at the first step that gains less than this part of the cost."""
    costs = np.array(found.result.trace)
    small = np.flatnonzero((costs[:-1] - costs[1:]) < least * costs[:-1])
    cost = costs[small[0] + 1] if len(small) else costs[-1]
    return found.rms * float(np.sqrt(cost / costs[-1]))


def named(order: tuple[int, int]) -> str:
    return f"{order[0]}r" + (f" {order[1]}d" if order[1] else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=10_000, help="of the gradient methods, at most")
    parser.add_argument("--noise", type=float, default=0.02, help="px")
    parser.add_argument("--update", type=Path, help="a page whose tables are to be renewed")
    told = parser.parse_args()
    u, d = true_pairs(33, 25)
    noisy = d + np.random.default_rng(0).normal(0, told.noise, d.shape)
    pairs, dense = (u, noisy), true_pairs(101, 76)
    fits = [
        fit(optimizer, kind, order, pairs, dense, told.steps if optimizer in FIRST_ORDER else None)
        for order in ORDERS
        for kind in KINDS
        for optimizer in OPTIMIZERS
    ]
    best = {order: min(f.rms for f in fits if f.order == order) for order in ORDERS}
    tables: dict[str, Callable[[], str]] = {
        "devilliers-accuracy": lambda: accuracy(fits, best),
        "devilliers-excess": lambda: excess(fits, best),
        "devilliers-work": lambda: work(fits),
        "devilliers-causes": lambda: causes(fits, best, pairs, dense, told.steps),
    }
    for name, make_table in tables.items():
        text = make_table()
        print(f"\n{name}\n{text}", flush=True)
        if told.update:
            update(told.update, name, text)


def accuracy(fits: list[Fit], best: dict) -> str:
    """What the order of the model is worth, whoever finds the optimum."""
    rows = []
    for order in ORDERS:
        found = min((f for f in fits if f.order == order), key=lambda f: f.rms)
        rows.append([named(order), f"{found.rms:.4f}", f"{found.check:.4f}"])
    return markdown(["terms", "rms of the fit, px", "rms against the truth, px"], rows)


def excess(fits: list[Fit], best: dict) -> str:
    """How far each ends above the best, in px of rms; a star says that it did not converge by its own word."""
    header = ["optimiser", "variables", *(named(o) for o in ORDERS)]
    rows = []
    for optimizer in OPTIMIZERS:
        for kind in KINDS:
            cells = []
            for f in (g for g in fits if (g.optimizer, g.kind) == (optimizer, kind)):
                above = f.rms - best[f.order]
                text = "0" if above < 1e-6 * best[f.order] else f"{above:.1e}"
                cells.append(text + ("" if f.result.converged else "*"))
            rows.append([optimizer, kind, *cells])
    return markdown(header, rows)


def work(fits: list[Fit]) -> str:
    """Evaluations and seconds."""
    header = ["optimiser", "variables", *(named(o) for o in ORDERS)]
    rows = []
    for optimizer in OPTIMIZERS:
        for kind in KINDS:
            chosen = [g for g in fits if (g.optimizer, g.kind) == (optimizer, kind)]
            rows.append([optimizer, kind, *(f"{f.result.evaluations} / {f.seconds:.2g}" for f in chosen)])
    return markdown(header, rows)


def causes(fits: list[Fit], best: dict, pairs, dense, steps: int) -> str:
    """What can make Levenberg-Marquardt look bad: stopping rules, units, float32."""
    header = ["Levenberg-Marquardt ...", *(named(o) for o in ORDERS)]
    chosen = {kind: [f for f in fits if f.optimizer == "lm" and f.kind == kind] for kind in KINDS}
    rows = [["scaled, to the end", *(_above(f.rms, best[f.order]) for f in chosen["scaled"])]]
    patient = [fit("lm", "pixels", order, pairs, dense, steps) for order in ORDERS]
    rows.append([f"pixels, with {steps} steps", *(_above(f.rms, best[f.order]) for f in patient)])
    for least in (1e-3, 1e-1):
        for kind in ("scaled", "normalised", "pixels"):
            cells = [_above(stopped_early(f, least), best[f.order]) for f in chosen[kind]]
            rows.append([f"{kind}, stopped at a gain below {least:g} of the cost", *cells])
    for kind in KINDS:
        cells = [_single_precision(kind, order, best[order], pairs, dense) for order in ORDERS]
        rows.append([f"{kind}, residuals in float32", *cells])
    return markdown(header, rows)


def _single_precision(kind: str, order, best: float, pairs, dense) -> str:
    try:
        return _above(fit("lm", kind, order, pairs, dense, None, np.float32).rms, best)
    except EstimationError:  # powers of r in px beyond 3e38
        return "overflow"


def _above(rms: float, best: float) -> str:
    return "0" if rms - best < 1e-6 * best else f"{rms - best:.1e}"


if __name__ == "__main__":
    main()
