"""`camcal triangulate`: points in space from their images in several cameras."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.system.text import counted

FILE = click.Path(path_type=Path)


@click.command("triangulate")
@click.argument("cameras", nargs=-1, required=True, type=FILE, metavar="CAMERAS...")
@click.argument("points", type=FILE, metavar="POINTS2D")
@options("triangulate")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, cameras: tuple[Path, ...], points: Path, **options: Any) -> int:
    """Triangulate points that two or more cameras see.

    CAMERAS is a file of DLT coefficients (11 rows, a column for each camera), a rig, or several reports of one
    view. POINTS2D is a table camera,point,u,v[,sigma]; cameras by name, or numbered from 1.
    """
    from camcal.cli.job import GATE_FAILED, command_line, output_is_free
    from camcal.cli.output import emit

    output_is_free(options)
    from camcal.data.writing import atomic_write
    from camcal.report.triangulation import csv_text, report

    found = report(cameras, points, options["crosscheck"], command_line(ctx))
    for warning in found["warnings"]:
        note(f"{warning['message']} {warning['hint']}")
    if options["output"] is not None:
        atomic_write(options["output"], csv_text(found), options["force"])
        note(f"{counted(len(found['points']), 'point')} written to {options['output']}.")
    if options["output"] is None or options["format"] != "table":
        emit(found, options["format"], lambda: _table(found))
    return GATE_FAILED if found["verdict"] == "fail" else 0


def _table(found: dict[str, Any]) -> Any:
    from camcal.cli.output import table

    rows = [
        [
            p["point"],
            *(_to_sigma(x, s) for x, s in zip(p["xyz"], p["sigma"], strict=True)),
            *(f"{x:.2g}" for x in (*p["sigma"], p["residual"])),
            ";".join(p["outliers"]) or "-",
        ]
        for p in found["points"]
    ]
    header = ["point", *"XYZ", "sigma_X", "sigma_Y", "sigma_Z", "residual", "outliers"]
    return table(header, rows, f"residuals in px, sigma of an image coordinate {found['sigma_hat']:.4g} px")


def _to_sigma(value: float, sigma: float) -> str:
    """A coordinate to the second digit of its standard deviation; the file has all digits."""
    if not 0 < sigma < math.inf:
        return f"{value:.6g}"
    return f"{value:.{max(1 - math.floor(math.log10(sigma)), 0)}f}"
