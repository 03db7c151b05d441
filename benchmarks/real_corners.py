"""Calibrations of the real sets from camcal's corners and from OpenCV's: rms and hold-out error.

    python benchmarks/real_corners.py [--data FOLDER] [--update docs/figures.md]

The same pictures for everybody (those in which one of OpenCV's detectors and camcal find the board), the same
solver, lens model and treatment of outliers (camcal's). cornerSubPix starts from findChessboardCornersSB where
that finds the board, else from findChessboardCorners; its best window is chosen for each set by the result.
"hold-out" is rms_point over views that took no part (4 folds, poses refitted).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tables import markdown, show

from camcal.data.observations import Correspondences, View
from camcal.detect.images import detect_images
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.plan.calibrate import calibrate

SETS = {"opencv_left": (9, 6), "opencv_right": (9, 6), "bouguet": (13, 12), "stereo": (6, 4)}
WINDOWS = (3, 5, 7, 9, 11)
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pictures(folder: Path) -> Iterator[tuple[str, np.ndarray]]:
    for path in sorted(folder.iterdir()):
        gray = (
            cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.suffix in (".jpg", ".tif", ".png") else None
        )
        if gray is not None:
            yield path.name, gray


def opencv_corners(gray: np.ndarray, size: tuple[int, int]) -> dict[str, np.ndarray] | None:
    """(N, 2) corners by each of OpenCV's ways; None where neither detector finds the board."""
    found, sb = cv2.findChessboardCornersSB(gray, size, flags=cv2.CALIB_CB_ACCURACY)
    start = sb
    if not found:
        found, start = cv2.findChessboardCorners(gray, size)
        if not found:
            return None
    start = start.reshape(-1, 1, 2).astype(np.float32)
    corners = {"SB accuracy (else cornerSubPix 5)": start.reshape(-1, 2)}
    for window in WINDOWS:
        uv = cv2.cornerSubPix(gray, start.copy(), (window, window), (-1, -1), CRITERIA)
        corners[f"cornerSubPix {window}"] = uv.reshape(-1, 2)
    if sb is None or len(sb) != len(start):
        corners["SB accuracy (else cornerSubPix 5)"] = corners["cornerSubPix 5"]
    return {name: uv.astype(float) for name, uv in corners.items()}


def figures(data: Correspondences) -> tuple[float, float, int]:
    """rms_point of the fit and of 4-fold hold-out, px, and how many points were rejected."""
    solution = calibrate(data, model="opencv5", robust="auto", holdout=4)
    assert solution.holdout is not None
    rejected = data.point_count - int(solution.used.sum())
    return solution.rms_point, float(solution.holdout["rms_point"]), rejected


def rows_of(folder: Path, size: tuple[int, int]) -> list[list[object]]:
    """Rows of the table for one set."""
    board = Checkerboard(*size)
    theirs = {name: c for name, gray in pictures(folder) if (c := opencv_corners(gray, size)) is not None}
    ours = detect_images([folder], target=board, cache=False)
    common = [v for v in ours.views if v.id in theirs]
    kinds: dict[str, Correspondences] = {}
    for kind in next(iter(theirs.values())):
        views = [View(v.id, board.points, theirs[v.id][kind]) for v in common]
        kinds[kind] = Correspondences.from_views(tuple(views), ours.image_size)
    found = {kind: figures(data) for kind, data in kinds.items()}
    best = min((k for k in found if k.startswith("cornerSubPix")), key=lambda k: found[k][1])
    shown = {k: found[k] for k in ("SB accuracy (else cornerSubPix 5)", "cornerSubPix 11", best)}
    first = replace(Correspondences.from_views(tuple(common), ours.image_size), target=ours.target)
    shown["camcal, first pass"] = figures(first)
    second = calibrate(replace(first, files=ours.files), "opencv5", "auto", refine_points=True)
    shown["camcal, second pass"] = figures(second.points)
    name = f"{folder.name} ({len(common)})"
    best_of = {best: ", best window"}
    return [
        [name, kind + best_of.get(kind, ""), f"{rms:.4f}", f"{held:.4f}", rejected]
        for kind, (rms, held, rejected) in shown.items()
    ]


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, default=DEFAULT_DATA)
    parser.add_argument("--update", type=Path, metavar="PAGE")
    told = parser.parse_args()
    if not told.data.is_dir():
        print(f"no real pictures at {told.data}: nothing measured")
        return
    rows = [row for name, size in SETS.items() for row in rows_of(told.data / name, size)]
    table = markdown(["pictures (used)", "corners", "rms px", "hold-out px", "rejected"], rows)
    show(told.update, "real-corners", table)


if __name__ == "__main__":
    main()
