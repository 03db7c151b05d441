"""Optimisers by name. Adding one = a file, a line in `OPTIMIZERS` and a line in `SUMMARIES`.

Each is a function `minimise(problem, state, options, on_step) -> Result` (camcal.refine.optimizers.base).
"""

OPTIMIZERS = {
    "lm": "camcal.refine.optimizers.lm:minimise",
}

SUMMARIES = {
    "lm": "Levenberg-Marquardt, poses eliminated by the Schur complement",
}
