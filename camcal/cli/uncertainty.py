"""`camcal uncertainty`: how far noise moves the projections of a calibrated camera."""

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
    """Compute how far noise in the observations moves projections, in px.

    The standard deviation is that of the worst direction, of a point that is fixed to the boards (mrcal's
    projection uncertainty). Without --at: the image's centre and its worst place, and the median over it.
    """
    from camcal.cli.output import emit
    from camcal.report.document import load
    from camcal.report.uncertainty import inquire

    found = inquire(load(report), at, distance)
    emit(found, format, lambda: _tables(found))
    worst = max(p["sigma_px"] for p in found["points"])
    fell = max_px is not None and not worst <= max_px
    if max_px is not None:
        note(f"{'FAIL' if fell else 'PASS'}: the largest sigma is {worst:.4g} px; {max_px:g} px is allowed.")
    return 1 if fell else 0


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
