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
    from camcal.report.pose import report

    given = {name: options[name] for name in ("robust", "seed", "crosscheck")}
    return deliver_route(report(camera, points, **given, command=command_line(ctx)), options, _table)


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
