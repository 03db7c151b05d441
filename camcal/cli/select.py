"""`camcal select`: which lens model suits the data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.system.text import counted


@click.command("select")
@click.argument("data", nargs=-1, required=True, metavar="POINTS|IMAGES...")
@options("select")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, data: tuple[str, ...], **options: Any) -> int:
    """Fit several lens models and rank them by their error on held-out views, with poses refitted.

    A model that contains another is also started from the optimum of that one. Models with a fold or a pole
    inside the image, or with parameters that the data do not determine, are not chosen. With -o, the selection
    is written as YAML.
    """
    from camcal.cli.job import output_is_free, read_data
    from camcal.cli.output import progress
    from camcal.cli.results import deliver
    from camcal.plan.selection import described, select
    from camcal.report.plain import plain

    output_is_free(options)
    models = named_models(options["models"])
    points = read_data(data, options)
    with progress("fitting models") as show:

        def show_event(_: str, details: Mapping[str, Any]) -> None:
            show(details["done"], details["count"])

        given = {name: options[name] for name in ("skew", "fix", "robust", "folds", "seed")}
        found = plain(described(select(points, models, on_event=show_event, **given)))
    deliver(found, options, "Selection", lambda: _table(found))
    note(f"{found['chosen']}: {found['why']}.")
    return 0


def named_models(text: str) -> tuple[str, ...]:
    """The model specs in the text, separated by spaces or semicolons, or by commas where none has options."""
    from camcal.errors import UsageError
    from camcal.model.lenses import make
    from camcal.plan.selection import AUTO, all_models

    if text.strip() in ("auto", "all"):
        return AUTO if text.strip() == "auto" else all_models()
    parts = text.replace(";", " ").split()
    if len(parts) == 1 and "=" not in text:
        parts = text.split(",")
    specs = tuple(part.strip(", ") for part in parts if part.strip(", "))
    if not specs:
        raise UsageError("--models names no model.", "Try: --models opencv5,opencv8,kb4")
    for spec in specs:
        make(spec)
    return specs


def _table(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    rows, out = [], []
    for m in found["models"]:
        mark = "*" if m["model"] == found["chosen"] else ""
        if "rms_point" not in m:
            rows.append([mark, m["model"], "-", "-", "-", "-", "-", "-", "no"])
        else:
            held = m["holdout"]["rms_point"] if m["holdout"] else None
            figures = [number(v, 4) for v in (held, m["rms_point"], m["sigma_hat"])]
            information = [f"{m[k]:.0f}" for k in ("aic_difference", "bic_difference")]
            rows.append(
                [mark, m["model"], str(m["parameters"]), *figures, *information, "out" if m["out"] else ""]
            )
        out += [f"{m['model']}: {reason}" for reason in m["out"]]
    columns = ["", "model", "free", "hold-out px", "rms px", "sigma", "AIC +", "BIC +", ""]
    title = f"{counted(found['points'], 'point')} of {counted(found['views'], 'view')}"
    parts = [table(columns, rows, title)]
    if out:
        parts.append(Text("\nnot chosen because:\n  " + "\n  ".join(out)))
    return Group(*parts)
