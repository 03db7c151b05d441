"""Films: frames decoded, searched and kept a second, and the camera of the chosen frames beside that of all.

    python benchmarks/films.py FILM [--target SPEC] [--update docs/figures.md]

The film is run twice: as `camcal checkerboard FILM` chooses its frames, and with every frame that shows the target
(`--every 1`, none left out). Both cameras are compared on the frames of the second run by what they project, so that a
choice of frames that loses accuracy shows.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from tables import markdown, update

import camcal
from camcal.assess.difference import difference, image_grid
from camcal.detect.images import detect_images


def run(film: Path, target: str | None, **how: object) -> tuple[dict[str, float], object]:
    """Figures of one search, and its observations."""
    said: dict[str, float] = {}

    def on_event(name: str, details: dict) -> None:
        if name == "frames":
            said["decoded"], said["searched"] = details["frames"], details["searched"]

    start = time.perf_counter()
    found = detect_images([film], target=target, cache=False, on_event=on_event, **how)
    said["seconds"], said["kept"] = time.perf_counter() - start, len(found.views)
    return said, found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("film", type=Path)
    parser.add_argument("--target")
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    rows, cameras = [], []
    for name, how in (("chosen", {}), ("all", {"every": 1, "keep_frames": None})):
        said, found = run(options.film, options.target, **how)
        start = time.perf_counter()
        solution = camcal.calibrate(found, model="opencv5")
        spent = time.perf_counter() - start
        cameras.append(solution.camera)
        rate = f"{said['decoded'] / said['seconds']:.1f}"
        counts = (int(said["decoded"]), int(said["searched"]), int(said["kept"]))
        rows.append((name, *counts, rate, f"{spent:.1f}", f"{solution.camera.values['fx']:.2f}",
                     f"{solution.rms_point:.4f}"))  # fmt: skip
    apart = difference(*cameras, image_grid(np.zeros(2), np.array(cameras[0].image_size) - 1.0))
    header = (
        "frames",
        "decoded",
        "searched",
        "kept",
        "frames/s",
        "calibration s",
        "fx",
        "rms px",
    )
    table = markdown(header, rows)
    print(table)
    print(
        f"projections apart after the best rotation: rms {apart.rms_px:.3f} px, at most {apart.max_px:.3f} px"
    )
    if options.update:
        update(options.update, "films", table)


if __name__ == "__main__":
    main()
