"""`camcal simulate frames`: frames for `camcal track`, with the true cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options, resolved_options
from camcal.cli.verbosity import note, verbosity_options
from camcal.system.text import counted


@click.command("frames")
@options("simulate frames")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, output: Path, seed: int, force: bool, **given: Any) -> None:
    """Simulate frames of a camera that moves or is knocked, as a table for `camcal track`.

    In addition to FILE.csv, FILE.truth.csv has the true camera of each frame, with the columns of the table of
    `camcal track`, and FILE.truth.yaml the last one as a camera file.
    """
    from camcal.data.writing import atomic_write, check_writable
    from camcal.report.plain import plain
    from camcal.report.yaml import dump_yaml
    from camcal.track import simulate

    truth_table, truth_report = (output.with_name(f"{output.stem}.truth.{kind}") for kind in ("csv", "yaml"))
    for path in (output, truth_table, truth_report):
        check_writable(path, force)
    at = given["frames"] // 2 if given["at"] is None else given["at"]
    scene = simulate.Scene(
        points=given["points"],
        noise=given["noise"],
        outliers=given["outliers"],
        knock=at,
        angle=given["angle"],
    )
    pairs = list(simulate.simulate(given["kind"], given["frames"], seed, scene))
    atomic_write(output, simulate.frame_rows(frame for frame, _ in pairs), force)
    atomic_write(truth_table, simulate.truth_rows(pairs), force)
    atomic_write(truth_report, dump_yaml(plain(_document(ctx, pairs[-1][1], seed))), force)
    note(f"{counted(sum(len(f) for f, _ in pairs), 'point')} in {counted(len(pairs), 'frame')}: {output}")
    note(f"The true cameras: {truth_table}; the last one: {truth_report}")


def _document(ctx: click.Context, last: Any, seed: int) -> dict[str, Any]:
    import numpy as np

    from camcal.model import lenses
    from camcal.model.camera import Camera
    from camcal.model.pose import Pose, Poses
    from camcal.study.cameras import truth_document

    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(last.k[0, 0], last.k[1, 1], last.k[0, 2], last.k[1, 2]), (640, 480))
    poses = Poses.stack([Pose(last.rotation, np.asarray(last.translation))])
    used = {k: v["value"] for k, v in resolved_options(ctx).items() if k not in ("output", "force")}
    run = {"command": ["simulate", "frames"], "seed": seed, "options": used}
    matrix = last.matrix / last.matrix[2, 3]
    return {**truth_document(camera, poses, ["last"], **run), "projection_matrix": matrix}
