"""Documents of the commands besides the two main jobs: their results, in the keys of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camcal.assess.checks.coverage import outside
from camcal.assess.warning import CalibrationWarning, Severity, grade_of, warning_entry
from camcal.report.camera import sigma_entry
from camcal.report.head import head
from camcal.report.plain import plain
from camcal.routes.assumed_centre import CENTRE
from camcal.routes.distance import LINEAR
from camcal.routes.misfit import LARGE
from camcal.routes.pose import Found, Solution

Array = np.ndarray


def document(
    command: Sequence[str],
    camera: Mapping[str, Any] | None,
    sections: Mapping[str, Any],
    crosscheck: Sequence[Mapping[str, Any]] = (),
    warnings: Sequence[Mapping[str, Any]] = (),
    failures: Sequence[str] = (),
) -> dict[str, Any]:
    """A report of one route: schema and tool first, then the camera, the route's sections, the verdict."""
    failed = [
        f"cross-check of stage '{e['stage']}' against {e['against']}: {e.get('why') or 'failed'}"
        for e in crosscheck
        if e["status"] == "fail"
    ]
    failed += failures
    made = head(command)
    if camera is not None:
        made["camera"] = camera
    return plain(
        {
            **made,
            **sections,
            "crosscheck": list(crosscheck),
            "warnings": list(warnings),
            "verdict": "fail" if failed else "pass",
            "grade": grade_of(w["severity"] for w in warnings),
            "failures": failed,
        }
    )


def warning(code: str, message: str, hint: str = "", severity: Severity = "doubtful") -> dict[str, str]:
    """An entry of the report's `warnings`."""
    return warning_entry(CalibrationWarning(code, message, hint, severity))


def uncertain_distance(what: str, half: float, hint: str) -> dict[str, str]:
    """The warning about distances with a large relative uncertainty (half of the 95 % interval)."""
    return warning(
        "uncertain-distance",
        f"{what}: the distance from the camera is known to ± {100 * half:.0f} % (95 % interval); beyond "
        f"{100 * LINEAR:.0f} % intervals of two standard deviations contain the true value too rarely.",
        hint,
    )


def outside_picture(uv: Array, image_size: tuple[int, int] | None) -> list[dict[str, str]]:
    """The warning about image points (N, 2) outside the picture, if there are any."""
    return [] if image_size is None else [warning_entry(w) for w in outside(uv, image_size)]


def images_do_not_fit(what: str, share: float) -> dict[str, str]:
    """The warning about residuals that are no noise; `share` as `camcal.routes.misfit.misfit`."""
    return warning(
        "images-do-not-fit",
        f"{what}: the residuals are {share:.0%} of the spread of the image points; detection noise explains "
        f"{LARGE:.0%} at most.",
        "Check that points, images and cameras belong together: the order of points and cameras, the unit of the "
        "images, and whether v is counted from the top.",
        "wrong",
    )


def principal_point_assumed(what: str, names: Sequence[str], hint: str) -> dict[str, str]:
    """The warning about coordinates of the centre that are held; the sigmas contain its effect."""
    return warning(
        "principal-point-assumed",
        f"{what} {' and '.join(names)} undetermined; the middle of the picture is assumed, and its "
        f"uncertainty ({CENTRE:.0%} of the longer side) is included in the other sigmas.",
        hint,
    )


def bundle_entry(iterations: int, converged: bool, residuals: Array, used: Array) -> dict[str, Any]:
    """The report's `fit` of a bundle adjustment: residuals (N, 2), px, and the used rows (N,)."""
    return {
        "iterations": iterations,
        "converged": converged,
        "rms_point": float(np.sqrt((residuals[used] ** 2).sum(1).mean())),
        "points_used": int(used.sum()),
        "points_rejected": int((~used).sum()),
    }


def solution_entry(solution: Solution) -> dict[str, Any]:
    """A pose with its standard deviations: three angles, degrees, and three lengths."""
    covariance = solution.covariance
    sigma = None if covariance is None else np.sqrt(np.maximum(np.diagonal(covariance), 0))
    return {
        "cam_from_world": solution.pose.entry(),
        "rms_point": solution.rms_point,
        **sigma_entry(sigma),
        "covariance": covariance,
    }


def view_entry(name: str, found: Found) -> dict[str, Any]:
    """All solutions of a view, and the points that they do not use."""
    left_out = np.flatnonzero(~found.used)
    return {
        "id": name,
        "points": len(found.used),
        "rejected_points": len(left_out),
        "solutions": [solution_entry(s) for s in found.solutions],
        "ratio": found.ratio,
        "rejected": [{"row": row, "residual": found.solutions[0].residuals[row]} for row in left_out],
    }
