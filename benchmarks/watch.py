"""From a picture's arrival to the answer of `camcal watch`: 2 megapixels, 30 views there.

    nice -n 10 python benchmarks/watch.py [--pictures 6] [--write docs/figures/watch.txt]

`camcal watch` runs as a user starts it, on a folder with 30 pictures of a 9 x 6 board that `camcal simulate images`
renders. Then further pictures arrive, one after the other; the time is that from the moment a file has its name up to
the line that says where to hold the target next, on the wall clock, and in processor time of the whole process, the
renewed report and the page of --serve included.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

SIZE, THERE = "1920x1080", 30
TICK = os.sysconf("SC_CLK_TCK")


def processor(pid: int) -> float:
    """Processor seconds of a process, user and system."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def waited(pid: int) -> float:
    """Seconds that the main thread of a process was ready to run and had no processor (Linux)."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) * 1e-9


def answers(process: subprocess.Popen[str]) -> Iterator[str]:
    """The lines that say what a picture brought, each when what comes after it has been said, too."""
    assert process.stderr is not None
    what = ""
    for line in process.stderr:
        if line.strip().startswith("next:"):
            yield what
        what = line


def rendered(folder: Path, pictures: int) -> list[Path]:
    """The pictures in a folder; made first where it does not exist."""
    if not folder.exists():
        command = [sys.executable, "-m", "camcal", "simulate", "images", "--target", "checkerboard:9x6:25mm"]
        command += ["--image-size", SIZE, "--views", str(THERE + pictures), "-o", str(folder)]
        subprocess.run(command, check=True)
    return sorted(folder.glob("view*"))


def measured(made: list[Path], folder: Path) -> np.ndarray:
    """Seconds (pictures, 3) of each picture that arrives: wall, wall without waiting for a processor, processor."""
    (folder / "in").mkdir()
    for path in made[:THERE]:
        shutil.copy(path, folder / "in")
    command = [sys.executable, "-m", "camcal", "watch", str(folder / "in"), "-o", str(folder / "r.yaml")]
    process = subprocess.Popen(
        [*command, "--serve", "0", "--no-cache"], stderr=subprocess.PIPE, text=True, bufsize=1
    )
    try:
        said = answers(process)
        for _ in range(THERE):
            assert "points" in next(said)
        found = []
        for path in made[THERE:]:
            time.sleep(0.5)
            shutil.copy(path, folder / "arriving")
            before, queued, begin = processor(process.pid), waited(process.pid), time.perf_counter()
            (folder / "arriving").rename(folder / "in" / path.name)
            assert path.name in next(said)
            wall, queued = time.perf_counter() - begin, waited(process.pid) - queued
            time.sleep(0.5)  # the report and the page are renewed after the answer
            found.append((wall, wall - queued, processor(process.pid) - before))
        return np.array(found)
    finally:
        process.kill()
        process.communicate()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=6)
    parser.add_argument("--made", type=Path, help="the pictures, rendered before")
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        made = rendered(given.made or Path(place) / "made", given.pictures)
        wall, free, used = measured(made, Path(place)).T
    text = (
        f"{len(wall)} pictures of {SIZE} arrive, {THERE} and more are there: answer after "
        f"{np.median(wall):.2f} s (median; {wall.min():.2f} to {wall.max():.2f} s) on the wall clock, without the "
        f"time in which other work had the processors {np.median(free):.2f} s ({free.min():.2f} to {free.max():.2f}); "
        f"{np.median(used):.2f} s of processor time with report and page; "
        f"{os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}, {time.strftime('%Y-%m-%d')}\n"
    )
    print(text, end="")
    if given.write:
        given.write.write_text(text)


if __name__ == "__main__":
    main()
