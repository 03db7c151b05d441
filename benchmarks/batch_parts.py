"""Where the time of a whole job of `camcal batch` goes (see batch.py)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from camcal.batch.run import MOST_IN_GROUP
from camcal.batch.storage import Storage
from camcal.batch.summary import summary_row
from camcal.data.points import read_points
from camcal.plan.calibrate import calibrate_many
from camcal.report.document import compact_document
from camcal.report.yaml import dump_yaml

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
    calibration = f"calibration, up to {MOST_IN_GROUP} at once"
    for warm in (True, False):
        spent.clear()
        for first in range(0, 1 if warm else count, MOST_IN_GROUP):
            some = range(first, min(first + MOST_IN_GROUP, count))
            data = [
                timed("reading the table", read_points, folder / f"c{i}.csv", image_size=size) for i in some
            ]
            for i, solution in zip(some, timed(calibration, calibrate_many, data, **QUICK), strict=True):
                report = timed("report", compact_document, solution, command=["batch", f"c{i}"])
                timed("row of the summary", summary_row, report)
                text = timed("YAML", dump_yaml, report)
                timed("writing", storage.write, f"c{i}.yaml", text)
    return spent


def table(spent: dict[str, float], reference: float) -> str:
    """The parts in ms, and their sum beside a job of cv2, in seconds."""
    whole = sum(spent.values())
    lines = [
        "| part of a job, `checks: false`, `compact: true` | ms of processor time |", "|---|---|",
        *(f"| {name} | {1e3 * s:.2f} |" for name, s in spent.items()),
        f"| whole | {1e3 * whole:.2f} |",
        f"| a whole job of cv2 | {1e3 * reference:.2f} |",
    ]  # fmt: skip
    return "\n".join(lines)
