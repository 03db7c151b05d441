"""The reports of `camcal lines` and `camcal evaluate --lines`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.peers.undistort_points import against_cv2
from camcal.report.camera import camera_entry
from camcal.report.routes import document, outside_picture, principal_point_assumed, warning
from camcal.routes import straightness
from camcal.routes.line_geometry import Lines
from camcal.routes.line_start import estimate
from camcal.routes.lines import LineFit
from camcal.routes.read_lines import read_lines

#: Lines have one direction if the mean of exp(2iφ) over them is longer than this: all within about 10 degrees
ONE_DIRECTION = 0.94


def report(
    paths: Sequence[Any],
    model: str,
    image_size: tuple[int, int] | None,
    fix: Mapping[str, float | None],
    robust: str,
    crosscheck: bool,
    command: Sequence[str],
) -> dict[str, Any]:
    """Estimate a lens from lines, and report how straight they become."""
    lines, found = read_lines(paths, image_size)
    chosen = found if robust == "auto" else robust == "lines"
    fit = estimate(lines, lenses.make(model), fix, chosen, resistant=robust != "none")
    kept = lines.take(fit.used)
    sigmas = {
        n: _finite(s)
        for n, s in zip(fit.camera.lens.names, np.sqrt(np.diagonal(fit.covariance)), strict=True)
    }
    entry = camera_entry(fit.camera, sigmas, fit.start.values, fit.fixed)
    sections = {
        "straightness": section(fit.camera, kept, len(lines)),
        "fit": {
            "iterations": fit.iterations,
            "converged": fit.converged,
            "rms_line": float(np.sqrt((fit.distances**2).mean())),
            "points_used": len(kept.uv),
            "free_parameters": fit.free.shape[1],
            "variance_inflation": fit.inflation,
        },
    }
    said = [*outside_picture(kept.uv, kept.image_size), *_warnings(fit, kept)]
    checks = [against_cv2("lines", fit.camera, kept.uv)] if crosscheck else []
    return document(command, entry, sections, checks, said)


def evaluation(camera: Camera, paths: Sequence[Any], command: Sequence[str]) -> dict[str, Any]:
    """The straightness of lines under a known camera."""
    lines, _ = read_lines(paths, camera.image_size)
    sections = {"straightness": section(camera, lines, len(lines))}
    return document(command, camera_entry(camera, fixed=camera.lens.names), sections)


def section(camera: Camera, lines: Lines, given: int) -> dict[str, Any]:
    """The report's `straightness`, px: of the original points, undistorted, and in the original picture."""
    before, after = straightness.before(lines), straightness.after(camera, lines)
    own = straightness.in_picture(camera, lines)
    return {
        "before": {"rms": before.rms, "max": before.max},
        "after": {"rms": after.rms, "max": after.max},
        "in_picture": {"rms": own.rms, "max": own.max},
        "lines": [
            {"line": name, "points": int(count), "before": b, "after": a}
            for name, count, b, a in zip(
                lines.names, np.bincount(lines.line), before.line_rms, after.line_rms, strict=True
            )
        ],
        "lines_given": given,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _warnings(fit: LineFit, kept: Lines) -> list[dict[str, str]]:
    made = []
    turn = straightness.directions(fit.camera, kept)
    if abs(np.exp(2j * turn).mean()) > ONE_DIRECTION:
        made.append(
            warning(
                "one-direction",
                f"all {len(kept)} lines have one direction, within some 10 degrees: the lens is untested along them.",
                "Add pictures with the lines in other directions.",
            )
        )
    if not fit.used.all():
        made.append(
            warning(
                "lines-left-out",
                f"{int((~fit.used).sum())} of {len(fit.used)} lines are not straight compared with the "
                "others and are not used.",
                "Curves in the scene can be among them.",
                "note",
            )
        )
    if fit.assumed:
        made.append(
            principal_point_assumed(
                "the lines leave",
                fit.assumed,
                "Give it if it is known (--fix cx=VALUE,cy=VALUE), or add lines in other directions.",
            )
        )
    if fit.undetermined:
        made.append(
            warning(
                "undetermined",
                f"the lines leave {', '.join(fit.undetermined)} undetermined.",
                "Such changes keep straight lines straight; fix the parameters (--fix), or use another model.",
            )
        )
    if not fit.converged:
        made.append(
            warning("not-converged", "the fit stopped before it converged.", "Try fewer coefficients.")
        )
    return made
