"""What it costs to write a camera in each format: exact, or the largest error of the closest camera that it holds, px.

    python -m benchmarks.conversions     prints the table of docs/formats.md

The cameras are the first examples of the lens models. A format's best model is taken; *-*: none reaches the picture.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from camcal.data.formats import files
from camcal.data.formats.base import CameraFile, Format, NamedCamera
from camcal.data.formats.page import SOURCES
from camcal.data.formats.terms import room
from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.conversion import convert
from camcal.model.pose import Pose


@cache
def camera_of(spec: str) -> Camera:
    """The first example camera of a lens model."""
    lens = lenses.make(spec)
    params, size = lens.examples()[0]
    return Camera(lens, np.array(params, float), size)


@cache
def cost(spec: str, target: str, square: bool, skew: bool) -> float:
    """The largest difference between a camera and the closest one of a model, px."""
    try:
        return convert(camera_of(spec), lenses.make(target, skew), square).max_px
    except CamcalError:
        return float("inf")


def cell(form: Format, spec: str) -> str:
    """`exact`, the least cost among the models of a format, or `-`."""
    named = NamedCamera("camera", camera_of(spec), Pose(np.eye(3), np.array([0.0, 0.0, 10.0])))
    try:
        files.rendered(form, CameraFile((named,)), Path(f"a{form.endings[0]}"))
    except CamcalError:
        least = min(cost(spec, r.spec, r.square, r.skew) for r in map(room, form.models))
        return f"{least:.2g}" if np.isfinite(least) else "-"
    return "exact"


def main() -> None:
    """Print the table."""
    print("| format | " + " | ".join(f"`{s}`" for s in SOURCES) + " |\n" + "|---" * (len(SOURCES) + 1) + "|")
    for form in files.formats():
        cells = ["exact"] * len(SOURCES) if form.name == "camcal" else [cell(form, spec) for spec in SOURCES]
        print(f"| `{form.name}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
