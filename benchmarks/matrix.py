"""Run the tests with other versions of Python, NumPy and OpenCV: one environment each, in a folder that stays.

    python benchmarks/matrix.py                   the quick tests of the border to other libraries
    python benchmarks/matrix.py --all             the whole suite
    python benchmarks/matrix.py --only 4.10       the combinations with that in their name

A Python or a release that cannot be had is named, not skipped in silence. Exit code 1 where a test fails.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: what depends on the versions of the libraries: readers and writers, lenses, targets, cv2 as the peer, streams
QUICK = [
    "tests/system",
    "tests/data",
    "tests/contracts",
    "tests/peers",
    "tests/hardening/test_fuzz.py",
    "tests/test_api.py",
]
OTHERS = ["scipy>=1.11", "click", "pyyaml", "rich", "msgspec", "platformdirs", "matplotlib", "jinja2", "h5py"]
OTHERS += ["pytest", "hypothesis", "pytest-xdist", "types-PyYAML"]


@dataclass(frozen=True)
class Combination:
    """Versions that are tested together: the oldest, those between, the newest of each."""

    python: str
    numpy: str
    opencv: str

    @property
    def name(self) -> str:
        """For the command line and the table."""
        return f"py{self.python}-np{self.numpy}-cv{self.opencv}"


COMBINATIONS = [
    Combination("3.11", "1.26", "4.10"),
    Combination("3.11", "2.2", "4.12"),
    Combination("3.12", "2.0", "4.10"),
    Combination("3.12", "2", "4.14"),
    Combination("3.13", "2", "5.0"),
    Combination("3.14", "2", "5.0"),
]


def interpreter(version: str) -> str | None:
    """A Python of a version: on the PATH, of pyenv, or of uv."""
    found = shutil.which(f"python{version}")
    if found and subprocess.run([found, "-c", ""], capture_output=True).returncode == 0:
        return found
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    places = sorted(root.glob(f"{version}.*/bin/python")) if root.is_dir() else []
    if places:
        return str(places[-1])
    if shutil.which("uv"):
        done = subprocess.run(["uv", "python", "find", version], capture_output=True, text=True)
        return done.stdout.strip() or None
    return None


def environment(combination: Combination, folder: Path) -> Path | str:
    """The Python of an environment with these versions; a sentence where it cannot be made."""
    base = interpreter(combination.python)
    if base is None:
        return f"Python {combination.python} is not here"
    place = folder / combination.name
    python = place / "bin" / "python"
    if (place / "ready").exists():
        return python
    subprocess.run([base, "-m", "venv", "--clear", str(place)], check=True)
    versions = [f"numpy=={combination.numpy}.*", f"opencv-contrib-python-headless=={combination.opencv}.*"]
    install = [str(python), "-m", "pip", "install", "-q", "--only-binary", ":all:", *versions, *OTHERS]
    done = subprocess.run(install, capture_output=True, text=True)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        return said[-1] if said else "the packages cannot be installed"
    (place / "ready").touch()
    return python


def run(combination: Combination, folder: Path, tests: list[str]) -> tuple[str, bool]:
    """What came out, and whether it is good."""
    python = environment(combination, folder)
    if isinstance(python, str):
        return python, True
    command = [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", *tests]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    for line in lines:
        print("   ", line)
    versions = "import cv2, numpy, sys; print(sys.version.split()[0], numpy.__version__, cv2.__version__)"
    found = subprocess.run([str(python), "-c", versions], capture_output=True, text=True).stdout.strip()
    said = "passed" if done.returncode == 0 else f"{len(lines)} failed"
    return f"{said} (Python, NumPy, OpenCV {found})", done.returncode == 0


def main() -> int:
    """Run what is asked for and print a line for each combination."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--all", action="store_true", help="the whole suite")
    parser.add_argument("--only", default="", help="part of the name of a combination")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "camcal-matrix")
    parser.add_argument("tests", nargs="*", help="tests in place of the quick ones")
    given = parser.parse_args()
    tests = given.tests or (["tests"] if given.all else QUICK)
    good = True
    for combination in COMBINATIONS:
        if given.only in combination.name:
            said, fine = run(combination, given.folder, tests)
            good = good and fine
            print(f"{combination.name}: {said}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
