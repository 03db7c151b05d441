"""Damaged files of every format of cameras and of points.

    python -m benchmarks.damaged_files [COUNT]     prints the table of docs/formats.md

Each file begins as one that camcal, or the test that makes it, writes; bytes, numbers and parts are changed, cut,
repeated and put in (the two kinds of damage of the tests, half each). A reader may give cameras, or refuse with one
line; anything else, numpy's warnings included, is counted as a fault.
"""

from __future__ import annotations

import random
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from camcal.data.formats import files
from camcal.data.formats.source import Source
from camcal.data.points import read_points
from camcal.errors import CamcalError
from tests.data.corner_samples import samples as point_samples
from tests.data.formats.test_fuzz import mutated as scrambled
from tests.data.formats.test_fuzz import samples as camera_samples
from tests.hardening.mutate import mutated as misshapen


def outcome(read: Callable[[], object]) -> str:
    """What a reader makes of a file: `read`, `refused`, or a fault."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read()
    except CamcalError as error:
        return "refused" if "\n" not in error.message and error.hint else "fault"
    except Exception as error:  # noqa: BLE001  # whatever it is, it is counted
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return "fault"
    return "read"


def damaged(data: bytes, count: int, seed: str) -> list[bytes]:
    """Damaged copies of a file."""
    rng = random.Random(seed)
    return [(scrambled if i % 2 else misshapen)(data, rng) for i in range(count)]


def camera_row(name: str, data: bytes, count: int, label: str) -> Counter[str]:
    """The outcomes of a camera file, its format found out and then given."""
    form = files.named_format(label.partition(".")[0])
    found: Counter[str] = Counter()
    for content in damaged(data, count, label):
        source = Source(Path(name), content)
        found[outcome(lambda s=source: files.parsed(files.recognised(s), s))] += 1  # type: ignore[misc]
        other = Source(Path(name), content)
        again = outcome(lambda s=other: files.parsed(form, s))  # type: ignore[misc]
        found["fault"] += again == "fault"
    return found


def points_row(folder: Path, file: str, content: bytes, beside: dict[str, bytes], count: int) -> Counter[str]:
    """The outcomes of a file of points."""
    for name, data in beside.items():
        (folder / name).write_bytes(data)
    path, found = folder / file, Counter[str]()
    for data in damaged(content, count, file):
        path.write_bytes(data)
        found[outcome(lambda: read_points(path, board=(3, 2)))] += 1
    return found


def main(count: int) -> None:
    """Print the table."""
    print("| file | damaged copies | refused in one line | read | anything else |\n|---|---|---|---|---|")
    for sample in camera_samples():
        name, data = sample.values
        show(f"`{sample.id}`", count, camera_row(name, data, count, sample.id))
    for name, (file, content, beside) in point_samples().items():
        with tempfile.TemporaryDirectory() as folder:
            show(f"points: `{name}`", count, points_row(Path(folder), file, content, beside, count))


def show(label: str, count: int, found: Counter[str]) -> None:
    """Print a row."""
    print(
        f"| {label} | {count:,} | {found['refused']:,} | {found['read']:,} | {found['fault']} |", flush=True
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
