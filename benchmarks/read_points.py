"""Reading a table of points against numpy.loadtxt on the same file, and the memory it takes.

    python benchmarks/read_points.py [--rows 1000000] [--repeat 5]

Three files of the same rows: views named by numbers (loadtxt reads the whole file), views named by text
(loadtxt is spared that column: it can only read numbers), and the short decimals of a detector instead of
full float64. To reach: a ratio of at most 3. The memory is the growth of a fresh process's resident set
(VmHWM, Linux only) beyond its imports, over the size of the final arrays, 40 bytes per row.
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from camcal.data.points import read_points

POINTS_PER_VIEW = 1000
BYTES_PER_POINT = 5 * 8


def make_file(path: Path, rows: int, name: Callable[[int], str], digits: int | None) -> None:
    rng = np.random.default_rng(7)
    values = np.hstack([rng.uniform(-100, 100, (rows, 3)), rng.uniform(0, 2000, (rows, 2))])
    if digits is not None:
        values = values.round(digits)
    with path.open("w") as stream:
        stream.write("view,X,Y,Z,u,v\n")
        for i, row in enumerate(values.tolist()):
            stream.write(f"{name(i // POINTS_PER_VIEW)},{','.join(map(repr, row))}\n")


def median_seconds(jobs: list[Callable[[], object]], repeat: int) -> list[float]:
    """The jobs take turns, so that a slow spell of the machine meets all of them."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for _ in range(repeat):
        for job, taken in zip(jobs, seconds, strict=True):
            start = time.perf_counter()
            job()
            taken.append(time.perf_counter() - start)
    return [statistics.median(taken) for taken in seconds]


def peak_bytes(code: str) -> float:
    """How far a fresh process grows, at its peak, beyond what it has after its imports; NaN off Linux."""
    if not Path("/proc/self/status").exists():
        return math.nan
    program = (
        "import re, numpy as np; from pathlib import Path; from camcal.data.points import read_points\n"
        "peak = lambda: int(re.search(r'VmHWM:\\s*(\\d+) kB', Path('/proc/self/status').read_text())[1])\n"
        f"base = peak()\nkept = {code}\nprint(peak() - base)"
    )
    return 1024 * int(subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout)


def compare(path: Path, columns: range | None, rows: int, repeat: int) -> str:
    """The row of the table for one file."""
    numpy_s, camcal_s = median_seconds(
        [
            lambda: np.loadtxt(path, delimiter=",", skiprows=1, usecols=columns),
            lambda: read_points(path),
        ],
        repeat,
    )
    final = rows * BYTES_PER_POINT
    numpy_memory = (
        peak_bytes(f"np.loadtxt({str(path)!r}, delimiter=',', skiprows=1, usecols={columns})") / final
    )
    camcal_memory = peak_bytes(f"read_points({str(path)!r})") / final
    return (
        f"{path.stat().st_size / 1e6:8.1f} {numpy_s:10.3f} {camcal_s:10.3f} {camcal_s / numpy_s:8.2f} "
        f"{numpy_memory:14.2f} {camcal_memory:14.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    cases = {
        "numbers as views": (str, None, None),
        "text as views": ("picture_{:04d}.png".format, None, range(1, 6)),
        "4 decimals": ("picture_{:04d}.png".format, 4, range(1, 6)),
    }
    print(f"{options.rows} rows, medians of {options.repeat}; memory in sizes of the final arrays")
    print(f"{'file':18}       MB  loadtxt s   camcal s    ratio loadtxt memory  camcal memory")
    with tempfile.TemporaryDirectory() as folder:
        for title, (name, digits, columns) in cases.items():
            path = Path(folder) / "points.csv"
            make_file(path, options.rows, name, digits)
            print(f"{title:18} {compare(path, columns, options.rows, options.repeat)}")


if __name__ == "__main__":
    main()
