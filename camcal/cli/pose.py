"""`camcal pose`: where a known camera stood."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options

FILE = click.Path(path_type=Path)


@click.command("pose")
@click.argument("camera", type=FILE, metavar="CAMERA")
@click.argument("points", type=FILE, metavar="POINTS")
@options("pose")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, camera: Path, points: Path, **options: Any) -> int:
    """Find the pose of a known camera from three or more points and their images.

    CAMERA is a camera file of any format, POINTS a table as `camcal estimate` reads it. If the points allow
    several poses (three points, a distant plane), all are reported, the best first.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver_route

    output_is_free(options)
    from camcal.report.loading import load_camera

    return deliver_route(_report(load_camera(camera), points, options, command_line(ctx)), options, _table)


def _report(camera: Any, points: Path, options: dict[str, Any], words: list[str]) -> dict[str, Any]:
    from camcal.data.points import read_points
    from camcal.peers.solve_pnp import against_cv2
    from camcal.report.camera import camera_entry
    from camcal.report.routes import document, view_entry
    from camcal.routes.misfit import misfit
    from camcal.routes.pose import find, fits_mirrored

    views = read_points(points).views
    entries, checks, wide, mirrored, shares = [], [], {}, {}, {}
    for view in views:
        found = find(camera, view, options["robust"], options["seed"])
        entries.append(view_entry(view.id, found))
        wide[view.id] = found.distance_half_width(view)
        mirrored[view.id] = fits_mirrored(camera, view, found)
        shares[view.id] = misfit(found.solutions[0].residuals[found.used], view.uv[found.used])
        if options["crosscheck"]:
            used = view.take(found.used)
            checks.append(against_cv2(camera, used.xyz, used.uv, found.solutions[0].pose))
    sections: dict[str, Any] = {"views": entries}
    if len(entries) == 1:
        sections = {"solutions": entries[0]["solutions"], **sections}
    held = list(camera.lens.names)
    said = _warnings(entries, wide) + _mirrored(mirrored)
    said += _large({name: share for name, share in shares.items() if mirrored[name] is None})
    return document(words, camera_entry(camera, fixed=held), sections, checks, said)


def _warnings(entries: list[dict[str, Any]], wide: dict[str, float | None]) -> list[dict[str, str]]:
    """`wide` holds half of the 95 % interval of each view's distance, as a fraction of it."""
    from camcal.report.routes import uncertain_distance, warning
    from camcal.routes.distance import LINEAR

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
    from camcal.report.routes import warning

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
    from camcal.report.routes import images_do_not_fit
    from camcal.routes.misfit import LARGE

    return [images_do_not_fit(f"view '{name}'", share) for name, share in shares.items() if share > LARGE]


def _table(report: dict[str, Any]) -> Any:
    from camcal.cli.output import table

    rows = [
        [entry["id"], number + 1, s["rms_point"], *map(str, _pose_words(s))]
        for entry in report["views"]
        for number, s in enumerate(entry["solutions"])
    ]
    return table(["view", "pose", "rms px", "rotation vector", "translation", "sigma"], rows)


def _pose_words(solution: dict[str, Any]) -> tuple[str, str, str]:
    pose, sigma = solution["cam_from_world"], solution["sigma_translation"]
    return (
        " ".join(f"{x:.5f}" for x in pose["rotation_vector"]),
        " ".join(f"{x:.6g}" for x in pose["translation"]),
        "-" if sigma is None else " ".join(f"{x:.2g}" for x in sigma),
    )
