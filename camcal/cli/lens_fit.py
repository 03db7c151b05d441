"""`camcal lens-fit`: a lens from pairs of ideal and distorted points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options


@click.command("lens-fit")
@click.argument("pairs", type=click.Path(path_type=Path), metavar="PAIRS")
@options("lens-fit")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, pairs: Path, **options: Any) -> int:
    """Fit a lens to pairs of ideal and distorted image points.

    PAIRS is a table with the columns x, y (ideal) and u, v (distorted, px). Models with a linear solution
    (rational-function, bicubic, polynomial, division, spline) start from it; every model is then refined by least
    squares in px.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver
    from camcal.report.camera import camera_document

    output_is_free(options)
    found, count = _fitted(pairs, options)
    figures = {
        "from": str(pairs),
        "pairs": count,
        "ideal_matrix": found.ideal_matrix,
        "ideal_matrix_assumed": found.assumed,
        "direct": None if found.direct is None else _figures(found.direct),
        "refined": _figures(found.refined),
    }
    document = camera_document(found.camera, command_line(ctx), lens_fit=figures)
    deliver(document, options, "Camera", lambda: _table(document))
    return 0


def _fitted(pairs: Path, options: dict[str, Any]) -> Any:
    import numpy as np

    from camcal.data.columns import POINTS
    from camcal.data.table import read_table
    from camcal.model import lenses
    from camcal.model.lenses.pairs import fit_pairs

    table = read_table(str(pairs), POINTS)
    columns = [table.column(name) for name in ("X", "Y", "u", "v")]
    x, y, u, v = (c for c in columns if c is not None)
    lens = lenses.make(options["model"], options["skew"])
    matrix = None if options["ideal"] is None else _matrix(options["ideal"])
    return fit_pairs(lens, np.c_[x, y], np.c_[u, v], matrix, options["image_size"]), len(x)


def _matrix(values: dict[str, float]) -> Any:
    import numpy as np

    from camcal.errors import UsageError

    if not {"fx", "cx", "cy"} <= set(values) or set(values) - {"fx", "fy", "cx", "cy", "skew"}:
        raise UsageError(
            "--ideal needs fx, cx and cy, and may have fy and skew.", "Try: --ideal fx=800,cx=320,cy=240"
        )
    fy, skew = values.get("fy", values["fx"]), values.get("skew", 0.0)
    return np.array([[values["fx"], skew, values["cx"]], [0, fy, values["cy"]], [0, 0, 1.0]])


def _figures(found: Any) -> dict[str, Any]:
    """Errors in px over the pairs that lie in the domain of the lens."""
    inside = found.errors[found.covered]
    return {
        "rms_point": found.rms,
        "max": float(inside.max()) if len(inside) else None,
        "pairs_lost": int((~found.covered).sum()),
    }


def _table(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import table

    made = found["lens_fit"]
    rows = [
        [name, made[name]["rms_point"], made[name]["max"], made[name]["pairs_lost"]]
        for name in ("direct", "refined")
        if made[name] is not None
    ]
    parts = [table(["solution", "rms px", "max px", "lost"], rows, f"{made['pairs']} pairs")]
    if made["ideal_matrix_assumed"]:
        (f, _, cx), (_, _, cy), _ = made["ideal_matrix"]
        parts.append(
            Text(f"\nideal points are taken as pixels of a camera with f = {f:g}, centre ({cx:g}, {cy:g})")
        )
    rows = [[name, p["value"]] for name, p in found["camera"]["parameters"].items()]
    return Group(*parts, Text(""), table(["parameter", "value"], rows, found["camera"]["model"]))
