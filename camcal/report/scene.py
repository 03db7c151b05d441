"""The report of `camcal scene`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.detect.segments import SHORTEST, find_segments
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.report.camera import camera_entry
from camcal.report.routes import document, outside_picture, principal_point_assumed, warning
from camcal.routes.line_geometry import Lines
from camcal.routes.read_lines import TABLES, read_gray, read_lines
from camcal.routes.scene import at_infinity, estimate
from camcal.routes.scene_bend import WITH_DISTORTION, with_distortion
from camcal.routes.scene_fit import Scene

KINDS = {1: "one", 2: "two", 3: "three"}


def report(
    path: Path,
    model: str,
    fix: Mapping[str, float | None],
    image_size: tuple[int, int] | None,
    seed: int,
    command: Sequence[str],
) -> dict[str, Any]:
    """Estimate the camera of a picture, or of a table of lines."""
    picture = path.suffix.lower() not in TABLES
    lines = _segments(path, image_size) if picture else read_lines([path], image_size)[0]
    found = estimate(lines, lenses.make(model), fix, seed, picture)
    sigmas = np.sqrt(np.diagonal(found.covariance))
    names = found.camera.lens.names
    fixed = [n for n in names if n in found.fixed or n in found.assumed]
    entry = camera_entry(
        found.camera, dict(zip(names, sigmas.tolist(), strict=True)), found.start.values, fixed
    )
    sections = {"scene": section(found, lines), "fit": {"rms_line": found.rms}}
    bent = None
    if model == "pinhole" and "fx" not in fix:
        bent = with_distortion(found, lines, fix, seed, picture)
    return document(
        command,
        entry,
        sections,
        (),
        [*outside_picture(lines.uv, lines.image_size), *_warnings(found), *_bent(bent)],
    )


def _bent(other: Scene | None) -> list[dict[str, str]]:
    """The warning about lines that are bent, with what a lens with distortion has for the focal length."""
    if other is None:
        return []
    f, sigma = float(other.camera.params[0]), float(np.sqrt(other.covariance[0, 0]))
    return [
        warning(
            "lines-bent",
            "the lines are curved as by lens distortion. With distortion the focal length is "
            f"{f:.5g} ± {sigma:.2g} px, "
            "which lies outside the interval without distortion.",
            f"Try: -m {WITH_DISTORTION}",
            "wrong",
        )
    ]


def section(found: Scene, lines: Lines) -> dict[str, Any]:
    """The report's `scene`: the vanishing points of the directions with lines, and the attitude."""
    assert lines.image_size is not None
    width = max(lines.image_size)
    points = []
    for index in found.directions:
        direction = found.rotation[:, index]
        far = at_infinity(found, index, width)
        points.append(
            {
                "direction": direction,
                "pixel": None if far else _pixel(found, direction),
                "at_infinity": far,
                "lines": [lines.names[i] for i in np.flatnonzero(found.family == index)],
            }
        )
    return {
        "kind": KINDS[len(points)],
        "vanishing_points": points,
        "cam_from_scene": {
            "rotation_vector": rotations.log(found.rotation),
            "sigma_rotation_deg": np.degrees(found.rotation_sigma),
        },
        "lines_given": len(lines),
    }


def _pixel(found: Scene, direction: np.ndarray) -> list[float] | None:
    """The pixel of a direction, or of the opposite one; None outside the domain of the lens."""
    ahead = direction if direction[2] > 0 else -direction
    uv = found.camera.project(ahead)
    return uv.tolist() if np.isfinite(uv).all() else None


def _segments(path: Path, image_size: tuple[int, int] | None) -> Lines:
    gray = read_gray(path)
    size = (gray.shape[1], gray.shape[0])
    if image_size is not None and tuple(image_size) != size:
        raise DataError(
            f"'{path}' is {size[0]}x{size[1]}, not {image_size[0]}x{image_size[1]}.", "Leave it out."
        )
    found = find_segments(gray)
    if not len(found):
        raise DataError(
            f"no segment of {SHORTEST:.0f} px is found in '{path}'.", "Give a picture with edges."
        )
    return Lines.of(list(found), [str(i + 1) for i in range(len(found))], size)


def _warnings(found: Scene) -> list[dict[str, str]]:
    if not found.assumed:
        return []
    return [
        principal_point_assumed(
            "the vanishing points leave",
            found.assumed,
            "Give it if it is known (--fix cx=VALUE,cy=VALUE), or turn the camera so that all three converge.",
        )
    ]
