"""The installation: versions, OpenCV, extras, processors, the cache; and a calibration with known truth."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from camcal.records import dataclass
from camcal.report.doctor.findings import Finding, diagnosis
from camcal.version import __version__

#: packages that hold cv2; two of them in one environment overwrite each other's files
OPENCV = (
    "opencv-python",
    "opencv-python-headless",
    "opencv-contrib-python",
    "opencv-contrib-python-headless",
)
#: error of a calibration of exact points that rounding may leave, in px of the projection
EXACT_PX = 1e-6
#: grey levels of 235; largest error of a codec on a smooth ramp; that of cv2's JPEG is 1
LOSSY = 40


@dataclass(frozen=True)
class Check:
    """One checked item."""

    name: str
    found: str
    status: Literal["ok", "note", "wrong"] = "ok"
    todo: str = ""


def checks() -> list[Check]:
    """All checks; a check that raises an error is itself a finding."""
    made: list[Check] = []
    for one in (_versions, _opencv, _pictures, _calibration, _extras, _machine, _cache, _settings):
        try:
            made += one()
        except Exception as error:  # noqa: BLE001 - any failure is itself the result of the check
            made.append(
                Check(one.__name__.strip("_"), f"{type(error).__name__}: {error}", "wrong", _REINSTALL)
            )
    return made


_REINSTALL = "Install again: pip install --force-reinstall camcal"


def _versions() -> Iterator[Check]:
    yield Check("camcal", __version__)
    yield Check("python", platform.python_version())
    for name, least in _required():
        try:
            found = metadata.version(name)
        except metadata.PackageNotFoundError:
            if name not in OPENCV:  # any of the four is sufficient, see below
                yield Check(name, "missing", "wrong", f"pip install '{name}>={least}'")
            continue
        if _numbers(found) < _numbers(least):
            yield Check(name, f"{found}, needed {least}", "wrong", f"pip install --upgrade '{name}>={least}'")
        else:
            yield Check(name, found)


def _required() -> Iterator[tuple[str, str]]:
    """Names and minimum versions of camcal's requirements, without extras."""
    try:
        lines = metadata.requires("camcal") or []
    except metadata.PackageNotFoundError:  # run from its source folder
        return
    for line in lines:
        match = re.match(r"([A-Za-z0-9._-]+)\s*>=\s*([0-9.]+)", line)
        if match and "extra ==" not in line:
            yield match[1], match[2]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version.split("+")[0])[:3])


def _opencv() -> Iterator[Check]:
    import cv2

    installed = [n for n in OPENCV if _is_installed(n)]
    if len(installed) > 1:
        yield Check(
            "cv2",
            f"{cv2.__version__}, of {' and '.join(installed)}: they overwrite each other",
            "wrong",
            f"pip uninstall {' '.join(installed)}; then pip install {OPENCV[-1]}",
        )
    else:
        yield Check("cv2", f"{cv2.__version__}, {cv2.getNumThreads()} threads")
    lacking = [
        n for n in ("aruco", "fisheye", "calibrateCamera", "findChessboardCornersSB") if not _has(cv2, n)
    ]
    if lacking:
        yield Check("cv2 parts", f"lacking: {', '.join(lacking)}", "wrong", f"pip install {OPENCV[-1]}")


def _has(module: Any, name: str) -> bool:
    return hasattr(module, name)


def _is_installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def _pictures() -> Iterator[Check]:
    """Check that cv2 reads back what it writes."""
    import cv2
    import numpy as np

    gray = (np.add.outer(np.arange(32), np.arange(48)) * 3).astype(np.uint8)
    read: list[str] = []
    lost: list[str] = []
    for kind in ("png", "jpg", "tiff", "bmp", "webp"):
        try:
            done, data = cv2.imencode(f".{kind}", gray)
            back = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if done else None
        except cv2.error:
            back = None
        good = back is not None and np.abs(back.astype(int) - gray).max() < LOSSY
        (read if good else lost).append(kind)
    yield Check(
        "pictures",
        f"reads {', '.join(read)}" + (f"; not {', '.join(lost)}" if lost else ""),
        "note" if lost else "ok",
        "Convert such pictures to PNG." if lost else "",
    )


def _calibration() -> Iterator[Check]:
    """Calibrate exact points of a known camera and compare the result with it."""
    import numpy as np

    from camcal.model.placement import simulate_poses
    from camcal.plan.calibrate import calibrate
    from camcal.study.cameras import example_camera
    from camcal.study.points import simulate_points

    rng = np.random.default_rng(0)
    camera = example_camera("opencv5")
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    board = np.c_[x.ravel(), y.ravel(), np.zeros(54)]
    data = simulate_points(camera, board, simulate_poses(board, camera, rng, 8), rng)
    solution = calibrate(data, crosscheck="full", holdout=0)
    worst = max(float(np.abs(r).max()) for r in solution.residuals)
    agree = all(e["status"] != "fail" for e in solution.crosscheck)
    good = worst < EXACT_PX and agree
    found = f"exact points of a known camera: residuals {worst:.1g} px at most"
    found += ", OpenCV agrees" if agree else ", OpenCV disagrees"
    yield Check("calibration", found, "ok" if good else "wrong", "" if good else _REINSTALL)


def _extras() -> Iterator[Check]:
    for name, use in (("matplotlib", "charts as files"), ("jinja2", "the HTML page")):
        if _is_installed(name):
            yield Check(name, metadata.version(name))
        else:
            yield Check(name, f"missing: no {use}", "note", "pip install 'camcal[report]'")


def _machine() -> Iterator[Check]:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    yield Check("processors", f"{usable} for camcal, {os.cpu_count()} in the machine ({platform.machine()})")


def _cache() -> Iterator[Check]:
    from camcal.detect.cache import default_folder

    folder = default_folder()
    if folder is None:
        yield Check(
            "cache",
            "none: this user has no home folder",
            "note",
            "Set XDG_CACHE_HOME to a folder that you own.",
        )
        return
    files = [p for p in folder.rglob("*.npz") if p.is_file()] if folder.is_dir() else []
    size = sum(p.stat().st_size for p in files) / 1e6
    if _writable(folder):
        yield Check("cache", f"{folder}: {len(files)} pictures, {size:.1f} MB")
    else:
        yield Check(
            "cache",
            f"{folder} is not writable: pictures are searched again each time",
            "note",
            "Set XDG_CACHE_HOME to a folder that you own.",
        )


def _writable(folder: Path) -> bool:
    """Return whether the folder, or its nearest existing parent, is writable."""
    there = next((p for p in (folder, *folder.parents) if p.exists()), None)
    return there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _settings() -> Iterator[Check]:
    """Settings that change options without being on the command line."""
    given = sorted(name for name in os.environ if name.startswith("CAMCAL_"))
    if Path("camcal.yaml").is_file():
        given.insert(0, "./camcal.yaml")
    yield Check("settings", ", ".join(given) if given else "none from the environment or a ./camcal.yaml")


def diagnose(look: Callable[[], list[Check]] = checks) -> dict[str, Any]:
    """The document about the installation."""
    made = look()
    findings = [
        Finding(
            f"installation-{c.name}",
            "wrong" if c.status == "wrong" else "note",
            f"{c.name}: {c.found}.",
            c.todo,
        )
        for c in made
        if c.status != "ok"
    ]
    wrong = [f for f in findings if f.grade == "wrong"]
    said = f"Something is wrong with this installation: {wrong[0].message}" if wrong else "camcal works here."
    return diagnosis("installation", said, findings, checks=[asdict(c) for c in made])
