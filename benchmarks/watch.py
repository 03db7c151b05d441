"""From a picture's arrival to the answer of `camcal watch`: 2 megapixels, 30 views there.

    python benchmarks/watch.py

Pictures of a 9 x 6 board are rendered by `camcal simulate images`; the time is that from taking a picture up to the
answer, the report written, without the wait for a complete file (at most 0.1 s between two looks at the folder).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from camcal.batch.watch import Watcher
from camcal.report.document import document, save
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions

SIZE, VIEWS = "1920x1080", 31


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        command = [
            "simulate",
            "images",
            "--target",
            "checkerboard:9x6:25mm",
            "--image-size",
            SIZE,
            "--views",
            VIEWS,
        ]
        subprocess.run(
            [sys.executable, "-m", "camcal", *map(str, command), "-o", str(folder / "in")], check=True
        )
        search = {name: option.default for name, option in DetectionOptions.options().items()}
        told = {name: option.default for name, option in CalibrationOptions.options().items()}
        watcher = Watcher({**search, "board": (9, 6), "cache": False}, told)
        taken = []
        for path in sorted((folder / "in").glob("view*")):
            wall, processor = time.perf_counter(), time.process_time()
            step = watcher.take(path)
            if watcher.solution is not None:
                save(document(watcher.solution), folder / "r.yaml", force=True)
            taken.append((time.perf_counter() - wall, time.process_time() - processor))
            assert step.status == "found", step
        last = np.array(taken[-5:])
        wall, processor = last.mean(0)
        slowest = max(seconds for seconds, _ in taken)
        print(
            f"{len(taken)} pictures of {SIZE}; the last five: {wall:.2f} s, {processor:.2f} s of processor time;"
        )
        print(f"the slowest of all: {slowest:.2f} s")


if __name__ == "__main__":
    main()
