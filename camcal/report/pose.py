"""The report of `camcal pose`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from camcal.data.points import read_points
from camcal.peers.solve_pnp import against_cv2
from camcal.report.camera import camera_entry
from camcal.report.loading import load_camera
from camcal.report.routes import document, images_do_not_fit, uncertain_distance, view_entry, warning
from camcal.routes.distance import LINEAR
from camcal.routes.misfit import LARGE, misfit
from camcal.routes.pose import find, fits_mirrored


def report(
    path: Path, points: Path, robust: str, seed: int, crosscheck: bool, command: Sequence[str]
) -> dict[str, Any]:
    """Find the poses of a camera in each view of a table of points."""
    camera = load_camera(path)
    views = read_points(points).views
    entries, checks, wide, mirrored, shares = [], [], {}, {}, {}
    for view in views:
        found = find(camera, view, robust, seed)
        entries.append(view_entry(view.id, found))
        wide[view.id] = found.distance_half_width(view)
        mirrored[view.id] = fits_mirrored(camera, view, found)
        shares[view.id] = misfit(found.solutions[0].residuals[found.used], view.uv[found.used])
        if crosscheck:
            used = view.take(found.used)
            checks.append(against_cv2(camera, used.xyz, used.uv, found.solutions[0].pose))
    sections: dict[str, Any] = {"views": entries}
    if len(entries) == 1:
        sections = {"solutions": entries[0]["solutions"], **sections}
    said = _warnings(entries, wide) + _mirrored(mirrored)
    said += _large({name: share for name, share in shares.items() if mirrored[name] is None})
    return document(command, camera_entry(camera, fixed=camera.lens.names), sections, checks, said)


def _warnings(entries: list[dict[str, Any]], wide: dict[str, float | None]) -> list[dict[str, str]]:
    """`wide` holds half of the 95 % interval of each view's distance, as a fraction of it."""
    made = []
    for entry in entries:
        if len(entry["solutions"]) > 1:
            made.append(
                warning(
                    "several-poses",
                    f"view '{entry['id']}': {len(entry['solutions'])} poses fit; the second's error is "
                    + (
                        f"{entry['ratio']:.3g} times the first's."
                        if entry["ratio"] is not None
                        else "as small."
                    ),
                    "Add points out of the plane, or come closer.",
                )
            )
        half = wide[entry["id"]]
        if half is not None and half > LINEAR:
            hint = "Points that are farther apart, or a nearer picture."
            made.append(uncertain_distance(f"view '{entry['id']}'", half, hint))
        if entry["solutions"][0]["covariance"] is None:
            made.append(
                warning(
                    "no-redundancy",
                    f"view '{entry['id']}': three points leave no residuals from which to estimate the noise.",
                    "Add a column sigma (px), or more points.",
                )
            )
    return made


def _mirrored(views: dict[str, tuple[float, float] | None]) -> list[dict[str, str]]:
    """The warnings about views that fit with v counted upwards alone."""
    return [
        warning(
            "mirrored-points",
            f"view '{name}': most likely v increases upwards (the image's y axis points up): the points fit with an "
            f"rms of {rms[1]:.3g} px then, and of {rms[0]:.3g} px as they are. Exchanged u and v, or a left-handed "
            "frame of the points, look the same.",
            "Use v = height - 1 - v (-v where the principal point is 0), or exchange u and v, or negate one axis.",
        )
        for name, rms in views.items()
        if rms is not None
    ]


def _large(shares: dict[str, float]) -> list[dict[str, str]]:
    """The warnings about views whose residuals are no noise."""
    return [images_do_not_fit(f"view '{name}'", share) for name, share in shares.items() if share > LARGE]
