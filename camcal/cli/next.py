"""`camcal next`: which picture to take next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options
from camcal.errors import UsageError

FILE = click.Path(path_type=Path)
DRAWINGS = (".svg", ".png", ".pdf")


@click.command("next")
@click.argument("report", type=FILE, metavar="REPORT")
@options("next")
@verbosity_options
def command(report: Path, **options: Any) -> None:
    """Suggest the picture that would reduce the uncertainty of a camera most.

    Poses that keep the whole target in the picture are tried; the one that reduces the worst projection
    uncertainty over the picture most is described, and drawn with -o. With --count N several drawings are
    named NAME-1, NAME-2, ... For a rig: the instant that best determines the distances between its cameras.
    """
    output = options["output"]
    paths = _paths(output, options["count"])
    if output is not None:
        from camcal.data.writing import check_writable

        for path in paths:
            check_writable(path, options["force"])
    from camcal.cli.output import emit
    from camcal.plan.solution import RigSolution
    from camcal.report.next_view import drawing, suggest
    from camcal.report.rig_loading import load_solution

    solution = load_solution(report)
    if isinstance(solution, RigSolution):
        _of_rig(solution, options)
        return
    answer, found = suggest(
        solution, options["count"], options["distance"], options["target_px"], options["seed"]
    )
    if output is not None:
        from camcal.report.charts.files import write_chart

        for number, (path, suggestion) in enumerate(zip(paths, found, strict=True), 1):
            write_chart(drawing(solution, suggestion, number), path, options["force"])
            note(f"Drawing written to {path}.")
    emit(answer, options["format"], lambda: _table(answer))


def _of_rig(solution: Any, options: dict[str, Any]) -> None:
    """Where to hold the board so that the baselines become best determined."""
    if options["output"] is not None or options["target_px"] is not None:
        raise UsageError(
            "for a rig, the next instant is described in words only, and for its baselines.",
            "Omit -o and --target-px, or name one camera: rig.yaml#left",
        )
    from camcal.cli.output import emit
    from camcal.report.next_instant import suggest

    answer = suggest(solution, options["count"], options["seed"])
    emit(answer, options["format"], lambda: _instants(answer))


def _instants(answer: dict[str, Any]) -> Any:
    from camcal.cli.output import number, table

    def figures(relative: dict[str, float]) -> list[str]:
        pair = max(relative, key=lambda p: relative[p])
        return [pair, number(100 * relative[pair], 3)]

    rows: list[list[Any]] = [["now", *figures(answer["now"]), ""]]
    for i, s in enumerate(answer["suggestions"], 1):
        rows.append([str(i), *figures(s["relative_sigmas"]), s["words"]])
    return table(["instant", "least known", "± %", "where to hold the target"], rows)


def _paths(output: Path | None, count: int) -> list[Path]:
    if output is None:
        return []
    if output.suffix.lower() not in DRAWINGS:
        raise UsageError(f"cannot draw to '{output}'.", f"Known: {', '.join(DRAWINGS)}.")
    if count == 1:
        return [output]
    return [output.with_name(f"{output.stem}-{i + 1}{output.suffix}") for i in range(count)]


def _table(answer: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.text import Text

    from camcal.cli.output import number, table

    rows: list[list[Any]] = [["now", *(number(answer["now"][k], 3) for k in ("worst_px", "median_px")), ""]]
    for i, s in enumerate(answer["suggestions"], 1):
        rows.append([str(i), number(s["worst_px"], 3), number(s["median_px"], 3), s["words"]])
    parts = [table(["picture", "worst ± px", "median", "where to hold the target"], rows)]
    if "target" in answer:
        wanted = answer["target"]
        more = wanted["more_pictures"]
        said = (
            f"More than {wanted['tried']} pictures for {wanted['worst_px']:g} px: sharper corners help more."
            if more is None
            else f"{more} more picture{'' if more == 1 else 's'} for {wanted['worst_px']:g} px."
        )
        parts += [Text(""), Text(said)]
    return Group(*parts)
