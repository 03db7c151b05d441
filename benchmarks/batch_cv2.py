"""Whole jobs of plain cv2 in a process pool, as a script of its own would do them (see batch.py).

    python benchmarks/batch_cv2.py JOBS.json WORKERS

JOBS.json lists [table, YAML file to write, whether standard deviations are wanted]. Nothing but cv2, numpy and PyYAML
is imported, in the parent and in the workers.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import yaml

VIEWS, SIZE = 20, (640, 480)
Views = Sequence[tuple[np.ndarray, np.ndarray]]


def by_cv2(views: Views) -> tuple[float, np.ndarray, np.ndarray]:
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(*_single(views), SIZE, None, None)
    return rms, matrix, distortion


def by_cv2_with_sigmas(views: Views) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    rms, matrix, distortion, _, _, sigmas, _, _ = cv2.calibrateCameraExtended(
        *_single(views), SIZE, None, None
    )
    return rms, matrix, distortion, sigmas


def _single(views: Views) -> list[list[np.ndarray]]:
    """Points and images as cv2 takes them."""
    return [[part.astype(np.float32) for part in parts] for parts in zip(*views, strict=True)]


def job(args: tuple[str, str, bool]) -> float:
    """A whole job of plain cv2: table in, YAML out."""
    source, target, sigmas = args
    cv2.setNumThreads(1)
    table = np.loadtxt(source, delimiter=",", skiprows=1, usecols=(1, 2, 3, 4, 5))
    views = [(part[:, :3], part[:, 3:]) for part in np.split(table, VIEWS)]
    found = by_cv2_with_sigmas(views) if sigmas else by_cv2(views)
    names = ("matrix", "distortion", "sigmas")
    said = {"rms": found[0], **{n: a.tolist() for n, a in zip(names, found[1:], strict=False)}}
    Path(target).write_text(yaml.dump(said, Dumper=yaml.CSafeDumper))
    return found[0]


def main() -> None:
    items, workers = json.loads(Path(sys.argv[1]).read_text()), int(sys.argv[2])
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(job, items, chunksize=max(1, len(items) // (4 * workers))))


if __name__ == "__main__":
    main()
