"""Optimisers by name. To add one, write a file, a line in `OPTIMIZERS` and a line in `SUMMARIES`.

Each is a function `minimise(problem, state, options, on_step) -> Result` (camcal.solve.optimizers.base). Its
module's `VARIANTS` name what may follow a colon (`lbfgs:varpro`), the default first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from camcal.errors import UsageError
from camcal.registry import load, look_up, split_spec

if TYPE_CHECKING:
    from collections.abc import Callable

    from camcal.solve.optimizers.base import Options, Result

OPTIMIZERS = {
    "lm": "camcal.solve.optimizers.lm:minimise",
    "dogleg": "camcal.solve.optimizers.dogleg:minimise",
    "gauss-newton": "camcal.solve.optimizers.gauss_newton:minimise",
    "fletcher-reeves": "camcal.solve.optimizers.fletcher_reeves:minimise",
    "polak-ribiere": "camcal.solve.optimizers.polak_ribiere:minimise",
    "leapfrog": "camcal.solve.optimizers.leapfrog:minimise",
    "lbfgs": "camcal.solve.optimizers.lbfgs:minimise",
    "scipy": "camcal.solve.optimizers.scipy_:minimise",
}

SUMMARIES = {
    "lm": "Levenberg-Marquardt, poses eliminated by the Schur complement; lm:qr by orthogonal factors",
    "dogleg": "Powell's dogleg in a trust region; dogleg:qr by orthogonal factors",
    "gauss-newton": "Gauss-Newton with step halving; gauss-newton:qr by orthogonal factors",
    "fletcher-reeves": "conjugate gradients (Fletcher & Reeves), strong Wolfe; :varpro, :scaled, :plain",
    "polak-ribiere": "conjugate gradients (Polak & Ribiere), strong Wolfe; :varpro, :scaled, :plain",
    "leapfrog": "Snyman's dynamic method, gradients only; :varpro, :scaled, :plain",
    "lbfgs": "limited-memory BFGS, strong Wolfe; :varpro, :scaled, :plain",
    "scipy": "scipy.optimize.least_squares (trf): an independent reference, slow",
}


def make(spec: str) -> Callable[..., Result]:
    """Make the optimiser of a spec such as `lm` or `lbfgs:scaled`; it is called like the entries of the table.

    Raises
    ------
    UsageError
        For an unknown name or variant.
    """
    name, plain, named = split_spec(spec)
    minimise = look_up(OPTIMIZERS, name, "optimizer")
    if not plain and not named:
        return minimise
    variants = load(OPTIMIZERS[name].partition(":")[0] + ":VARIANTS")
    if named or len(plain) > 1 or plain[0] not in variants:
        raise UsageError(
            f"optimizer '{name}' has no variant '{spec.partition(':')[2]}'.",
            "Known: " + ", ".join(f"{name}:{v}" for v in variants) + ".",
        )

    def run(problem, state, options: Options | None = None, on_step=None) -> Result:  # type: ignore[no-untyped-def]
        from camcal.solve.optimizers.base import Options

        return minimise(problem, state, replace(options or Options(), variant=plain[0]), on_step)

    return run
