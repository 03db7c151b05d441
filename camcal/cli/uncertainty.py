"""`camcal uncertainty`: the uncertainty of the projections of a calibrated camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options


@click.command("uncertainty")
@click.argument("report", type=click.Path(path_type=Path), metavar="REPORT")
@options("uncertainty")
@verbosity_options
def command(
    report: Path,
    at: tuple[tuple[float, float], ...],
    distance: tuple[float, ...],
    max_px: float | None,
    format: str,
) -> int:
    """Compute the uncertainty of projections due to noise in the observations, in px.

    It is the standard deviation, in the worst direction, of the projection of a point that is fixed to the
    boards (mrcal's projection uncertainty). Without --at: at the image centre and the worst pixel, and the
    median over the image. For a rig: the same for each camera, and for each pair the baseline, the distances of
    points from their epipolar lines, and the uncertainty of triangulated points.
    """
    from camcal.cli.output import emit
    from camcal.plan.solution import Solution
    from camcal.report.rig_loading import load_solution
    from camcal.report.rig_uncertainty import inquire as inquire_rig
    from camcal.report.uncertainty import inquire

    known = load_solution(report)
    if isinstance(known, Solution):
        found = inquire(known, at, distance)
        emit(found, format, lambda: _tables(found))
        points = found["points"]
    else:
        found = inquire_rig(known, at, distance)
        emit(found, format, lambda: _rig_tables(found))
        points = [p for camera in found["cameras"].values() for p in camera["points"]]
    worst = max((p["sigma_px"] for p in points), default=0.0)
    fell = max_px is not None and not worst <= max_px
    if max_px is not None:
        note(f"{'FAIL' if fell else 'PASS'}: the largest sigma is {worst:.4g} px; {max_px:g} px is allowed.")
    return 1 if fell else 0


def _rig_tables(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    unit = f", {found['unit']}" if found["unit"] else ""
    parts: list[Any] = []
    for name, camera in found["cameras"].items():
        parts += [Text(f"camera {name}", style="bold"), _tables(camera), Text("")]
    rows = []
    for name, pair in found["pairs"].items():
        distance, sigma = pair["baseline"]["value"], pair["baseline"]["sigma"]
        for at in pair["at"]:
            figures = [at["epipolar_px"]["median"], at["epipolar_px"]["worst"], at["point"]["median"]]
            rows.append(
                [name, number(distance), number(sigma, 3), at["distance"], *(number(f, 3) for f in figures)]
            )
    columns = ["pair", "baseline", "±", f"distance{unit}", "epipolar ± px", "worst", f"a point ±{unit}"]
    return Group(*parts, table(columns, rows, "two cameras together"))


def _tables(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    unit = f", {found['unit']}" if found["unit"] else ""
    rows = [[p["what"], p["u"], p["v"], p["distance"], number(p["sigma_px"], 4)] for p in found["points"]]
    parts = [table(["where", "u", "v", f"distance{unit}", "± px"], rows, "projection uncertainty")]
    if found["maps"]:
        rows = [[m["distance"], number(m["median"], 4)] for m in found["maps"]]
        parts += [Text(""), table([f"distance{unit}", "median over the image, ± px"], rows)]
    return Group(*parts)
