"""Where the time of a whole job of `camcal batch` goes, and what of it numpy takes alone (see batch.py)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from camcal.batch.storage import Storage
from camcal.batch.work import summary_row
from camcal.data.points import read_points
from camcal.plan.calibrate import calibrate
from camcal.report.document import compact_document
from camcal.report.yaml import dump_yaml
from camcal.solve.optimizers.lm import Linear
from camcal.solve.parameters import free_matrix
from camcal.solve.refine import How, make_problem

QUICK = {"model": "opencv5", "checks": False, "crosscheck": False, "robust": "none", "board_shape": "flat"}


def parts(folder: Path, count: int, size: tuple[int, int]) -> dict[str, float]:
    """Processor seconds of each part of a job, the mean over tables c0.csv ... of a folder."""
    spent: dict[str, float] = {}

    def timed(name: str, work: Callable[..., Any], *args: Any, **more: Any) -> Any:
        begin = time.process_time()
        made = work(*args, **more)
        spent[name] = spent.get(name, 0.0) + (time.process_time() - begin) / count
        return made

    storage = Storage(str(folder / "parts"))
    storage.make()
    for warm in (True, False):
        spent.clear()
        for i in range(1 if warm else count):
            data = timed("reading the table", read_points, folder / f"c{i}.csv", image_size=size)
            solution = timed("calibration", calibrate, data, **QUICK)
            report = timed("report", compact_document, solution, command=["batch", f"c{i}"])
            timed("row of the summary", summary_row, report)
            text = timed("YAML", dump_yaml, report)
            timed("writing", storage.write, f"c{i}.yaml", text)
            spent["least squares alone"] = spent.get("least squares alone", 0.0) + _alone(solution) / count
    return spent


def _alone(solution: Any) -> float:
    """Processor seconds of as many linearisations and solved normal equations as the refinement needed."""
    camera, data = solution.camera, solution.observations
    problem = make_problem([camera], data, [free_matrix(camera.lens, camera.params, {})], How())
    state = problem.state(camera.params, solution.poses, None)
    linear = Linear(problem, "schur")
    begin = time.process_time()
    for _ in range(solution.fit.evaluations):
        blocks = problem.linearise(state)
        assert blocks is not None
        linear.step(state, blocks, 1e-6)
    return time.process_time() - begin


def table(spent: dict[str, float], reference: float) -> str:
    """The parts in ms, and their sum beside a job of cv2, in seconds."""
    whole = sum(s for name, s in spent.items() if name != "least squares alone")
    rows = [f"| {name} | {1e3 * s:.2f} |" for name, s in spent.items() if name != "least squares alone"]
    alone = 1e3 * spent["least squares alone"]
    lines = [
        "| part of a job, `checks: false`, `compact: true` | ms of processor time |", "|---|---|", *rows,
        f"| whole | {1e3 * whole:.2f} |",
        f"| a whole job of cv2 | {1e3 * reference:.2f} |", "",
        f"Of the calibration, {alone:.1f} ms are as many projections, derivatives and solved normal equations as the",
        f"refinement needs to the rounding of its cost, in numpy {np.__version__} and with nothing around them.",
    ]  # fmt: skip
    return "\n".join(lines)
