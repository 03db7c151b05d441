"""Boards found in real pictures: camcal beside findChessboardCorners, findChessboardCornersSB and findCirclesGrid.

    python benchmarks/finds.py DATA [--update PAGE]

DATA is the folder of the sets named below. cv2 is given the size of the board, pictures of 16 bits stretched from their
least to their greatest value, and frames of films one by one. camcal is run twice: with the size, and as `camcal
checkerboard FOLDER` without any option, where a picture counts if all of the set together gave the right kind and
size. To reach: every picture in which any function of cv2 finds the whole board.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from tables import markdown, show

from camcal.detect import targets
from camcal.detect.films import Range, candidates
from camcal.detect.frames import is_film, read_frame
from camcal.detect.images import detect_images
from camcal.detect.listing import list_pictures
from camcal.detect.sources import read_gray
from camcal.detect.targets.base import Detection
from camcal.errors import CamcalError

#: set (a folder, a file or a pattern) -> target
SETS = {
    "opencv_left": "checkerboard:9x6",
    "opencv_right": "checkerboard:9x6",
    "bouguet": "checkerboard:13x12",
    "udacity": "checkerboard:9x6",
    "fisheye_ocam": "checkerboard:8x6",
    "stereo": "checkerboard:6x4",
    "handeye_visp_in_hand": "checkerboard:9x6",
    "video_chessboard/movie.mjpeg": "checkerboard:6x4",
    "lines/checker_board.png": "checkerboard:9x6",
    "cases/aliased_render": "checkerboard:9x6",
    "cases/twocams_pics": "checkerboard:9x6",
    "cases/picam_border": "checkerboard:7x7",
    "cases/thermal_k250": "checkerboard:9x6",
    "cases/multitif/all.tif": "checkerboard:9x6",
    "cases/motion_blur_a.png": "checkerboard:9x6",
    "circles": "circles:10x8",
    "cases/circles_small": "circles:9x7",
    "circles_asymmetric/acircles[123].png": "asymmetric-circles:7x13",
}
HEADER = (
    "set", "board", "pictures", "camcal", "camcal without options", "classic", "SB", "circles grid",
    "cv2 alone",
)  # fmt: skip


def pictures(place: Path) -> Iterator[np.ndarray]:
    """The pictures of a set in grey, 8 or 16 bits."""
    for path in list_pictures([place]):
        if is_film(path):
            frames, _ = candidates(path, Range(every=1))
            yield from (read_frame(path, f.number) for f in frames)
        else:
            yield read_gray(path)[0]


def cv2_finds(gray: np.ndarray, kind: str, size: tuple[int, int]) -> tuple[bool, bool, bool]:
    """Whether the classic detector, SB and the grid of circles find the board."""
    if gray.dtype != np.uint8:
        gray = cv2.normalize(gray, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    if kind == "checkerboard":
        sb = cv2.findChessboardCornersSB(gray, size)[0] or cv2.findChessboardCornersSB(
            gray, size, flags=cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
        )[0]  # fmt: skip
        return bool(cv2.findChessboardCorners(gray, size)[0]), bool(sb), False
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID if kind.startswith("asymmetric") else cv2.CALIB_CB_SYMMETRIC_GRID
    return False, False, bool(cv2.findCirclesGrid(gray, size, flags=flags)[0])


def without_options(place: Path, kind: str, size: tuple[int, int]) -> int:
    """In how many pictures the target is found that camcal takes the set to show, if it is the right one."""
    try:
        found = detect_images([place], cache=False, keep_frames=None, every=1 if is_film(place) else None)
    except CamcalError as error:
        print(f"{place}: {error}")
        return 0
    said = found.target
    right = said["kind"] == kind and sorted((said["columns"], said["rows"])) == sorted(size)
    return len(found.views) if right else 0


def row(data: Path, name: str, spec: str) -> list[object]:
    """The figures of one set."""
    target, place = targets.make(spec), data / name
    size = (target.columns, target.rows)
    counts, alone, total = np.zeros(4, int), 0, 0
    for gray in pictures(place):
        ours = isinstance(target.find(gray, seconds=30.0), Detection)
        theirs = cv2_finds(gray, target.kind, size)
        counts += [ours, *theirs]
        alone += any(theirs) and not ours
        total += 1
    free = without_options(place, target.kind, size)
    own, *others = counts
    return [name, spec.partition(":")[2], total, own, free, *(n or "" for n in others), alone]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--update", type=Path, metavar="PAGE", help="a page whose table is to be renewed")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for name, spec in SETS.items():
        rows.append(row(options.data, name, spec))
        print(*rows[-1], flush=True)
    table = markdown(HEADER, rows)
    show(options.update, "finds", table)


if __name__ == "__main__":
    main()
