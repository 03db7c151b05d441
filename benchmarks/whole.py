"""What a user waits for: whole commands and calls, beside the usual OpenCV script and cv2.calibrateCamera.

    python benchmarks/whole.py [--runs 5] [--only pictures clock calls start] [--pictures 13 30 100 12]
                               [--rows rows.json] [--folder PICTURES] [--update docs/figures.md]

Pictures are rendered here (of large ones 8, the others are copies of these; those of 12 megapixels are enlarged from
3). The script reads the pictures, runs findChessboardCorners and cornerSubPix (window 11, as OpenCV's tutorial has it)
and calibrateCamera, and prints the result; its time, and camcal's, are those of a process from start to end. The two
take turns; medians and the median of the ratios are printed. "cold" is without the cache. "of it" are the steps of the
command by themselves, beside those of the script.

Times are processor time, one process and one thread each, so that they hold on a busy machine, too; those of `clock`
are what passes between start and end with as many processes and threads as both take by default, and need an idle
machine. Megabytes are the peak of the process.
Modules are compiled before anything is timed, as they are after an installation. With `--rows` what was measured before
is read from that file and written to it again, so that the parts can be run one at a time.
"""

from __future__ import annotations

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
from refine import run_cv2, simulate
from tables import markdown, show

import camcal
from camcal.data.observations import Correspondences

SCRIPT = """
import sys, glob, cv2, numpy as np
grid = np.zeros((54, 3), np.float32)
grid[:, :2] = np.mgrid[0:9, 0:6].T.reshape(-1, 2)
criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
points, seen = [], []
for name in sorted(glob.glob(sys.argv[1] + '/*')):
    gray = cv2.imread(name, cv2.IMREAD_GRAYSCALE)
    ok, corners = cv2.findChessboardCorners(gray, (9, 6), None)
    if ok:
        points.append(grid)
        seen.append(cv2.cornerSubPix(gray, corners, (11, 11), (-1, -1), criteria))
print(cv2.calibrateCamera(points, seen, gray.shape[::-1], None, None)[:3])
"""
#: a run imports what its steps need; this imports the same
IMPORTS = """
import camcal.cli.boundary, camcal.cli.group, camcal.cli.checkerboard, camcal.detect.images, camcal.plan.calibrate
import camcal.report.document, camcal.report.table, camcal.peers.run, camcal.plan.second_pass
"""
LEAVE = "import os; os._exit(0)"  #: the command, too, leaves without taking modules apart
#: the steps of the command on pictures, each with the processor time that it takes, in a process of its own; `step`
#: keeps what the code took since the last call
STEPS = (
    """
import time
took = [time.process_time()]
import numpy, cv2
def step(value=None):
    took.append(time.process_time() - sum(took))
    return value
step()
"""
    + IMPORTS
    + """
step()
import sys
from pathlib import Path
from camcal.cli.output import emit
from camcal.detect.images import detect_images
from camcal.detect.search import search
from camcal.detect.sources import read_gray
from camcal.detect.targets.checkerboard import detection
from camcal.plan.calibrate import calibrate
from camcal.report.document import document, save
from camcal.report.table import tables
pictures = step([read_gray(path)[0] for path in sorted(Path(sys.argv[1]).iterdir())])
boards = step([search(gray, 60.0) for gray in pictures])
step([detection(gray, board, 9, 6) for gray, board in zip(pictures, boards)])
found = step(detect_images([sys.argv[1]], jobs=1, cache=False))
step(calibrate(found, checks=False, refine_points=False))
step(calibrate(found, checks=False, refine_points=None))
step(calibrate(found, refine_points=False))
step(calibrate(found, checks=False, refine_points=False, crosscheck=True))
solution = step(calibrate(found, refine_points=False, board_shape="auto"))
report = document(solution)
save(report, sys.argv[2], force=True)
step()
emit(report, "table", lambda: tables(report))
step()
print("took", *took)
"""
)
#: the steps of the script
SCRIPT_STEPS = """
import time
took = [time.process_time()]
import cv2, numpy as np, sys, glob
def step(value=None):
    took.append(time.process_time() - sum(took))
    return value
step()
criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
grid = np.zeros((54, 3), np.float32)
grid[:, :2] = np.mgrid[0:9, 0:6].T.reshape(-1, 2)
pictures = step([cv2.imread(name, cv2.IMREAD_GRAYSCALE) for name in sorted(glob.glob(sys.argv[1] + '/*'))])
boards = step([cv2.findChessboardCorners(gray, (9, 6), None) for gray in pictures])
shown = [(gray, corners) for gray, (ok, corners) in zip(pictures, boards) if ok]
seen = step([cv2.cornerSubPix(gray, corners, (11, 11), (-1, -1), criteria) for gray, corners in shown])
step(cv2.calibrateCamera([grid] * len(seen), seen, pictures[0].shape[::-1], None, None))
print("took", *took)
"""
#: pictures, their size, the limit that issue and docs state for the ratio cold
PICTURES = ((13, (640, 480), "png", 3.0), (30, (1632, 1224), "jpg", 1.5), (100, (1632, 1224), "jpg", 1.0),
            (12, (4000, 3000), "jpg", 1.0))  # fmt: skip
LARGE = 2000  #: px; wider pictures are rendered with half their size and enlarged
RENDERED = 8  #: large pictures that are rendered, which takes minutes; the others are copies of them
CALLS = ((13, 9, 6), (50, 9, 6), (200, 9, 6), (200, 20, 20))


#: what, camcal, its peer, the ratio, what is wanted
Row = tuple[object, ...]


def spent(command: list[str]) -> tuple[float, float]:
    """Processor time of a process, s, and its peak of memory, MB."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1, 3):
        raise SystemExit(f"{' '.join(command)}: exit {process.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def seconds(command: list[str]) -> float:
    """Processor time of a process."""
    return spent(command)[0]


def in_turn(first: Callable[[], float], second: Callable[[], float], runs: int) -> tuple[float, float, float]:
    """Medians of both and of their ratio."""
    pairs = [(first(), second()) for _ in range(runs)]
    a, b = zip(*pairs, strict=True)
    return statistics.median(a), statistics.median(b), statistics.median(x / y for x, y in pairs)


def tool(*words: object) -> list[str]:
    return [sys.executable, "-m", "camcal", *map(str, words)]


def pictures(runs: int, folder: Path, counts: list[int]) -> Iterator[Row]:
    """The command on folders of pictures, without and with the cache."""
    for count, width, place, script in folders(folder, counts):
        out = folder / "report.yaml"
        run = tool("checkerboard", place, "-o", out, "--force", "-q", "--jobs", 1)
        yield from both_ways(runs, count, f"checkerboard, {count} pictures {width}", run, script, seconds)
        if count == 13:
            yield from steps(runs, place, out)
        peaks = [spent(command)[1] for command in ([*run, "--no-cache"], script)]
        most = (1.5 * peaks[1] + 60) / peaks[1]
        what = f"its peak of memory, {count} pictures {width}"
        yield what, *(f"{p:.0f} MB" for p in peaks), f"{peaks[0] / peaks[1]:.2f}", f"{most:.1f}"


def clock(runs: int, folder: Path, counts: list[int]) -> Iterator[Row]:
    """The command on folders of pictures by the clock, with its processes, beside the script with its threads."""
    alone = {name: os.environ.pop(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}

    def passed(command: list[str]) -> float:
        begin = time.perf_counter()
        spent(command)
        return time.perf_counter() - begin

    for count, width, place, script in folders(folder, counts):
        run = tool("checkerboard", place, "-o", folder / "report.yaml", "--force", "-q")
        what = f"by the clock: checkerboard, {count} pictures {width}"
        yield from both_ways(runs, count, what, run, script, passed)
    os.environ.update(alone)


def folders(folder: Path, counts: list[int]) -> Iterator[tuple[int, str, Path, list[str]]]:
    """How many pictures, their size, the folder with them, which is made where it is missing, and the script on it."""
    for count, size, kind, _ in (p for p in PICTURES if p[0] in counts):
        place = folder / f"{count}-{size[0]}"
        if not place.exists():
            rendered(place, count, size, kind)
        yield count, f"{size[0]}x{size[1]}", place, [sys.executable, "-c", SCRIPT, str(place)]


def both_ways(
    runs: int,
    count: int,
    what: str,
    run: list[str],
    script: list[str],
    measured: Callable[[list[str]], float],
) -> Iterator[Row]:
    """The command without the cache and with it, beside the script; `measured` gives the time of a command, s."""
    limit = next(p[3] for p in PICTURES if p[0] == count)
    for name, command, most in (
        ("cold", [*run, "--no-cache"], limit),
        ("cached", run, 2.0 if count == 13 else ""),
    ):
        measured(command)  # compiles the modules, and fills the cache
        ours, theirs, ratio = in_turn(lambda c=command: measured(c), lambda: measured(script), runs)
        yield f"{what}, {name}", f"{ours:.2f} s", f"{theirs:.2f} s", f"{ratio:.2f}", most


def rendered(place: Path, count: int, size: tuple[int, int], kind: str) -> None:
    """Render pictures, of large ones some, and very large ones enlarged from half their size."""
    enlarged = 2 if size[0] > LARGE else 1
    width, height = (n // enlarged for n in size)
    some = count if size[0] < 1000 else min(count, RENDERED)
    made = tool("simulate", "images", "--target", "checkerboard:9x6:25mm", "--views", some, "-o", place)
    camera = {"fx": 533 * width / 640, "fy": 534 * width / 640, "cx": width / 2, "cy": height / 2}
    values = ",".join(f"{k}={v:.4g}" for k, v in camera.items())
    blur = f"{0.8 * max(1.0, width / 1600):.2g}"
    more = ("--image-size", f"{width}x{height}", "--set", values, "--type", kind, "--blur", blur, "-q")
    subprocess.run([*made, *more], check=True)
    for truth in place.glob("*.yaml"):
        truth.unlink()
    shown = sorted(place.iterdir())
    for path in shown if enlarged > 1 else ():
        gray = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(path), cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC))
    for i in range(some, count):
        # bytes behind the end of a picture change its hash: each is another one for what is kept by it
        (place / f"more{i:03d}.{kind}").write_bytes(shown[i % some].read_bytes() + bytes(i // some))


def steps(runs: int, place: Path, out: Path) -> Iterator[Row]:
    """What the command on small pictures does, step by step, beside the same step of the script where it has one."""

    def medians(code: str) -> list[float]:
        command = [sys.executable, "-c", code, str(place), str(out)]
        lines = []
        for _ in range(runs):
            said = subprocess.run(command, capture_output=True, check=True, text=True).stdout
            lines.append([float(word) for word in said.rpartition("took")[2].split()])
        return [statistics.median(times) for times in zip(*lines, strict=True)]

    start, base, modules, decoding, search, fits, found, bare, second, checks, peer, every, report, table = (
        medians(STEPS)
    )
    theirs = medians(SCRIPT_STEPS)
    parts = {
        "start of the interpreter": (start, theirs[0]),
        "imports of numpy and cv2": (base, theirs[1]),
        "other imports": (modules,),
        "decoding": (decoding, theirs[2]),
        "search for the board": (search, theirs[3]),
        "fit of its corners, twice": (fits, theirs[4]),
        "hashes, recognition, quality of the pictures": (found - decoding - search - fits,),
        "closed form and refinement": (bare, theirs[5]),
        "second pass over the pictures": (second - bare,),
        "checks": (checks - bare,),
        "cross-check": (peer - bare,),
        "shapes of the board": (every - checks,),
        "report": (report,),
        "tables on the terminal": (table,),
    }
    for name, (ours, *script) in parts.items():
        yield f"of it, {name}", f"{1e3 * ours:.0f} ms", "".join(f"{1e3 * t:.0f} ms" for t in script), "", ""


def timed(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def calls(runs: int) -> Iterator[Row]:
    """`camcal.calibrate` with its checks and without, beside cv2.calibrateCamera alone."""
    ways = (
        ("without checks", {"checks": False}, 0.5, 0.25),
        ("with checks", {}, 3.0, 1.0),
        ("without checks, with the full cross-check", {"checks": False, "crosscheck": "full"}, "", ""),
        (
            "with checks, the cross-check and the board's shape",
            {"crosscheck": True, "board_shape": "auto"},
            "",
            "",
        ),
    )
    for views, columns, lines in CALLS:
        data = simulate(views, columns, lines)
        for name, options, few, many in ways:
            work = lambda d=data, o=options: camcal.calibrate(d, model="opencv5", **o)  # noqa: E731
            work()
            ours, theirs, ratio = in_turn(
                lambda w=work: timed(w), lambda d=data: timed(lambda: run_cv2(d, "opencv5")), runs
            )
            limit = few if views < 50 else many
            what = f"calibrate {name}, {views} x {columns * lines}"
            yield what, f"{1e3 * ours:.0f} ms", f"{1e3 * theirs:.0f} ms", f"{ratio:.2f}", limit
        yield from of_parts(data, runs, f"{views} x {columns * lines}", 3.0 if columns * lines < 400 else 5.0)


def of_parts(data: Correspondences, runs: int, size: str, shape_limit: float) -> Iterator[Row]:
    """The cross-check by itself beside cv2, and the board's shape beside the flat calibration."""

    def ours(**options: Any) -> float:
        return timed(lambda: camcal.calibrate(data, model="opencv5", **options))

    def checked() -> float:
        return ours(checks=False, crosscheck=True) - ours(checks=False)

    pairs = (
        (f"cross-check alone, {size}", checked, lambda: timed(lambda: run_cv2(data, "opencv5")), 1.3, ""),
        (
            f"--board-shape auto, {size}",
            lambda: ours(board_shape="auto"),
            ours,
            shape_limit,
            " (camcal, flat)",
        ),
    )
    for what, one, other, limit, beside in pairs:
        a, b, ratio = in_turn(one, other, runs)
        yield what, f"{1e3 * a:.0f} ms", f"{1e3 * b:.0f} ms{beside}", f"{ratio:.2f}", limit


def start_up(runs: int, folder: Path) -> Iterator[Row]:
    """What is not calibration: starting, refusing, reporting."""
    points = folder / "points.csv"
    subprocess.run(tool("simulate", "points", "-o", points, "-q"), check=True)
    report = folder / "of_points.yaml"
    seconds(tool("estimate", points, "--image-size", "640x480", "-o", report, "-q"))
    page = folder / "page.html"
    cases = (
        ("python -c pass", [sys.executable, "-c", "pass"]),
        ("python -c 'import numpy, cv2'", [sys.executable, "-c", "import numpy, cv2"]),
        ("camcal --help", tool("--help")),
        ("importing what the command on pictures imports", [sys.executable, "-c", IMPORTS + LEAVE]),
        ("estimate, 12 views of a board", tool("estimate", points, "--image-size", "640x480", "-q")),
        ("report (page)", tool("report", report, "-o", page, "--force", "-q")),
        ("estimate, a path that does not exist", tool("estimate", folder / "absent.csv")),
    )
    bare = [sys.executable, "-c", "import numpy, cv2"]
    for name, command in cases:
        seconds(command)  # compiles the modules
        ours, theirs, ratio = in_turn(lambda c=command: seconds(c), lambda: seconds(bare), runs)
        yield name, f"{ours:.2f} s", f"{theirs:.2f} s (its imports)", f"{ratio:.1f}", ""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=("pictures", "clock", "calls", "start"),
        default=("pictures", "calls", "start"),
    )
    parser.add_argument("--pictures", nargs="+", type=int, default=[p[0] for p in PICTURES])
    parser.add_argument("--folder", type=Path, help="for pictures that other runs use again")
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    known = options.rows is not None and options.rows.exists()
    rows: dict[object, Row] = {r[0]: tuple(r) for r in json.loads(options.rows.read_text())} if known else {}
    with tempfile.TemporaryDirectory() as name:
        folder = options.folder or Path(name)
        folder.mkdir(exist_ok=True)
        os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "compiled")
        parts = {
            "pictures": lambda: pictures(options.runs, folder, options.pictures),
            "clock": lambda: clock(options.runs, folder, options.pictures),
            "calls": lambda: calls(options.runs),
            "start": lambda: start_up(options.runs, folder),
        }
        for part in options.only:
            for row in parts[part]():
                rows[row[0]] = row
                print(*row, sep=" | ", flush=True)
    if options.rows:
        options.rows.write_text(json.dumps(list(rows.values())))
    table = markdown(
        ("what", "camcal", f"OpenCV {cv2.__version__}", "ratio", "to reach"), list(rows.values())
    )
    show(options.update, "whole", table)


if __name__ == "__main__":
    main()
