"""`camcal compare-optimizers`: which optimiser, on these data, with this model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options
from camcal.system.text import counted

FILE = click.Path(path_type=Path)
#: what sees no more of a problem than linearisations and retractions, and so takes other coordinates
PLAIN = (
    "lm:schur",
    "dogleg:schur",
    "gauss-newton:schur",
    "fletcher-reeves:scaled",
    "polak-ribiere:scaled",
    "leapfrog:scaled",
    "lbfgs:scaled",
)


@click.command("compare-optimizers")
@click.argument("points", nargs=-1, required=True, type=FILE, metavar="POINTS...")
@options("compare-optimizers")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, points: tuple[Path, ...], **options: Any) -> None:
    """Run all optimizers on one problem, from the same starts, and compare cost, evaluations and time.

    The first start is that of the closed form; the others are random perturbations of it. An optimizer has
    converged if the decrease that the Gauss-Newton model still predicts is negligible.
    """
    from camcal.cli.job import command_line, output_is_free
    from camcal.cli.results import deliver
    from camcal.data.writing import atomic_write
    from camcal.report import convergence
    from camcal.report.plain import plain

    output_is_free(options, "plot")
    if options["plot"] is not None:
        convergence.require_matplotlib()
    runs, problem, model = _run(points, options)
    from camcal.study.compare_optimizers import judged

    count = sum(len(v) for v in problem.views)
    rows = judged(problem, runs)
    found = plain(
        convergence.document(model, count, len(problem.views), options["rotation"], rows, command_line(ctx))
    )
    deliver(found, options, "Comparison", lambda: _table(found))
    if options["trace"] is not None:
        atomic_write(options["trace"], convergence.traces(runs), options["force"])
    if options["plot"] is not None:
        convergence.plot(runs, options["plot"], options["force"])


def _run(points: tuple[Path, ...], options: dict[str, Any]) -> tuple[Any, Any, str]:
    """Read, start and run; (runs, problem, the model's full name)."""
    from camcal.cli.output import progress
    from camcal.data.points import read_points
    from camcal.plan.calibrate import first_estimate
    from camcal.solve.optimizers import OPTIMIZERS, make
    from camcal.solve.optimizers.base import Options
    from camcal.solve.parameters import free_matrix
    from camcal.solve.problem import Problem
    from camcal.study.compare_optimizers import perturbed, run_all

    specs = [name.strip() for name in (options["optimizers"] or "").split(",") if name.strip()]
    if not specs:
        specs = list(OPTIMIZERS if options["rotation"] == "left" else PLAIN)
    for spec in specs:
        make(spec)  # an unknown one is refused before any work is done
    _require_plain(specs, options["rotation"])
    data = read_points(*points, image_size=options["image_size"])
    usable, camera, poses, how = first_estimate(data, options["model"], options["skew"], options["fix"])
    free = free_matrix(camera.lens, camera.params, how.fix)
    problem = Problem(camera.lens, usable.views, free, normalise=options["normalise"])
    first = problem.state(camera.params, poses)
    starts = [
        first,
        *perturbed(problem, first, options["perturbed"], options["perturbation"], options["seed"]),
    ]
    done, total = iter(range(len(starts) * len(specs))), len(starts) * len(specs)
    with progress("optimizers") as show:
        stopping = Options(max_seconds=options["max_seconds"])
        rotation = options["rotation"]
        runs = run_all(
            problem,
            starts,
            specs,
            stopping,
            rotation,
            lambda *_: show(next(done), total),
            options["total_seconds"],
        )
    return runs, problem, camera.lens.name


def _require_plain(specs: list[str], rotation: str) -> None:
    from camcal.errors import UsageError

    refused = [spec for spec in specs if spec not in PLAIN and not spec.endswith(":plain")]
    if rotation != "left" and refused:
        raise UsageError(
            f"'{refused[0]}' knows rotations as perturbations on the left only, not as {rotation}.",
            "With --rotation: " + ", ".join(PLAIN) + ".",
        )


def _table(found: dict[str, Any]) -> Any:
    from camcal.cli.output import number, table

    header = ["optimizer", "rms px", "converged", "above best", "evals", "s", "others"]
    rows = []
    for row in found["optimizers"]:
        other = row["perturbed"]
        rows.append(
            [
                row["name"],
                number(row["rms_point"], 8),
                "yes" if row["converged"] else "no: " + row["stop_reason"],
                number(row["distance"], 2),
                row["evaluations"],
                number(row["seconds"], 3),
                "-" if other is None else f"{other['reached']} of {other['starts']}",
            ]
        )
    sizes = f"{counted(found['views'], 'view')}, {counted(found['points'], 'point')}"
    return table(header, rows, f"{found['model']}, {sizes}")
