"""`camcal simulate`: points, 3D rigs and pictures, with their true values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options, resolved_options
from camcal.cli.simulate_frames import command as frames_command
from camcal.cli.verbosity import note, verbosity_options
from camcal.settings.sizes import Length
from camcal.system.text import counted

POINT_DIGITS = 10  #: decimals of a pixel in the files: far below any noise, and the same on every machine


@click.group("simulate")
def command() -> None:
    """Simulate data, and write the true values to a YAML file in the same folder."""


command.add_command(frames_command)


@command.command("points")
@options("simulate points")
@verbosity_options
@click.pass_context
def points(ctx: click.Context, target: str, output: Path, seed: int, force: bool, **given: Any) -> None:
    """Simulate views of a flat target, as a table of points."""
    _check(output, force)
    import numpy as np

    from camcal.detect import targets
    from camcal.model.placement import simulate_poses

    made = targets.make(target)
    camera, rng = _camera(given), np.random.default_rng(seed)
    poses = simulate_poses(made.points, camera, rng, given["views"], _spread(given))
    _write_points(ctx, output, force, camera, made.points, poses, rng, given, {"target": made.describe()})


@command.command("rig")
@options("simulate rig")
@verbosity_options
@click.pass_context
def rig(
    ctx: click.Context,
    cells: int,
    spacing: Length,
    points3d: Path | None,
    frame: str,
    pose: tuple[float, ...] | None,
    output: Path,
    seed: int,
    force: bool,
    **given: Any,
) -> None:
    """Simulate one camera's views of a 3D calibration object: three faces of a cube, or points from a file.

    The result is a table of points. This is not a rig of cameras: `camcal rig` calibrates several cameras.
    """
    _check(output, force)
    import numpy as np

    from camcal.errors import UsageError
    from camcal.geometry import rotations
    from camcal.model.placement import simulate_poses
    from camcal.model.pose import Pose, Poses
    from camcal.study.points import corner_rig, facing_corner

    camera, rng = _camera(given), np.random.default_rng(seed)
    xyz = corner_rig(cells, spacing.value) if points3d is None else _read_points3d(points3d)
    if pose is not None:
        cam_from_world = Pose(rotations.exp(np.array(pose[:3])), np.array(pose[3:]))
        poses = Poses.stack([cam_from_world])
        if frame == "camera":
            xyz = cam_from_world.inverse().apply(xyz)
    elif frame == "camera":
        raise UsageError(
            "points in the camera's frame need the pose of the world.", "Try: --pose 0,0,0,0,0,0"
        )
    else:
        base = facing_corner() if points3d is None else None
        poses = simulate_poses(xyz, camera, rng, given["views"], _spread(given), base)
    described = {"kind": "rig", "points": len(xyz), "unit": spacing.unit if points3d is None else "unknown"}
    _write_points(ctx, output, force, camera, xyz, poses, rng, given, {"target": described})


@command.command("images")
@options("simulate images")
@verbosity_options
@click.pass_context
def images(
    ctx: click.Context, target: str, output: Path, extension: str, seed: int, force: bool, **given: Any
) -> None:
    """Simulate pictures of a target: area-sampled, blurred, with noise, uneven lighting and distortion."""
    import numpy as np

    from camcal.detect import targets
    from camcal.errors import UsageError
    from camcal.study.cameras import truth_document
    from camcal.study.pictures import board_poses, bowed_sheet, simulate_pictures, uneven_looks
    from camcal.study.render import Look

    if given["bits"] == "16" and extension == "jpg":
        raise UsageError("JPEG pictures have 8 bits.", "Try: --type png")
    digits = max(2, len(str(given["views"])))
    names = [f"view{i + 1:0{digits}d}.{extension}" for i in range(given["views"])]
    truth_path = output / "truth.yaml"
    _check_folder(output, [*names, truth_path.name], force)

    made = targets.make(target)
    camera, rng = _camera(given), np.random.default_rng(seed)
    poses = board_poses(made, camera, rng, given["views"], _spread(given))
    look = Look(
        blur=given["blur"], noise=given["noise"], vignetting=given["vignetting"], bits=int(given["bits"])
    )
    looks = uneven_looks(look, rng, len(poses)) if given["uneven"] else [look] * len(poses)
    surface = bowed_sheet(made, given["bow"]) if given["bow"] else None
    output.mkdir(exist_ok=True)
    for name, picture in zip(names, simulate_pictures(made, camera, poses, rng, looks, surface), strict=True):
        _write_picture(output / name, picture, force)
        note(f"{output / name}", 1)
    more = {"target": made.describe(), "bow": given["bow"], "blur": given["blur"], "noise": given["noise"]}
    _write_truth(truth_path, truth_document(camera, poses, names, **_run(ctx, seed), **more), force)
    note(f"{counted(len(names), 'picture')} and {truth_path}")


def _check(output: Path, force: bool) -> None:
    from camcal.data.writing import check_writable

    check_writable(output, force)
    check_writable(_truth_path(output), force)


def _check_folder(folder: Path, names: list[str], force: bool) -> None:
    from camcal.data.writing import check_writable
    from camcal.errors import UsageError

    if folder.is_dir():
        for name in names:
            check_writable(folder / name, force)
    elif folder.exists() or not folder.parent.is_dir():
        found = "is a file" if folder.exists() else f"cannot be made: there is no {folder.parent}"
        raise UsageError(f"the folder {folder} {found}.", "Choose another folder: -o FOLDER")


def _truth_path(output: Path) -> Path:
    return output.with_name(output.stem + ".truth.yaml")


def _camera(given: dict[str, Any]) -> Any:
    from camcal.study.cameras import example_camera

    values = given["values"] or {}
    return example_camera(given["model"], given["image_size"], values, skew="skew" in values)


def _spread(given: dict[str, Any]) -> Any:
    from camcal.model.placement import Spread

    return Spread(tilt=given["tilt"], fill=given["fill"])


def _run(ctx: click.Context, seed: int) -> dict[str, Any]:
    skipped = ("output", "force")
    used = {k: v["value"] for k, v in resolved_options(ctx).items() if k not in skipped}
    return {"command": ["simulate", ctx.info_name], "seed": seed, "options": used}


def _read_points3d(path: Path) -> Any:
    import numpy as np

    from camcal.data.columns import POINTS_3D
    from camcal.data.table import read_table

    table = read_table(str(path), POINTS_3D)
    columns = [table.column(name) for name in "XYZ"]
    return np.stack([np.zeros(len(table.values)) if c is None else c for c in columns], -1)


def _write_points(
    ctx: click.Context,
    output: Path,
    force: bool,
    camera: Any,
    xyz: Any,
    poses: Any,
    rng: Any,
    given: dict[str, Any],
    more: dict[str, Any],
) -> None:
    from dataclasses import replace

    from camcal.data.writing import write_points
    from camcal.study.cameras import truth_document
    from camcal.study.points import simulate_points

    found = simulate_points(camera, xyz, poses, rng, given["noise"], given["outliers"], given["clip"])
    rounded = replace(found, uv=found.uv.round(POINT_DIGITS), xyz=found.xyz.round(POINT_DIGITS) + 0.0)
    write_points(output, rounded, force)
    names = list(found.view_ids)
    more |= {"noise": given["noise"], "outliers": given["outliers"]}
    document = truth_document(camera, poses, names, **_run(ctx, ctx.params["seed"]), **more)
    _write_truth(_truth_path(output), document, force)
    made = f"{counted(found.point_count, 'point')} in {counted(len(found), 'view')}"
    note(f"{made}: {output}; the truth: {_truth_path(output)}")


def _write_truth(path: Path, document: dict[str, Any], force: bool) -> None:
    from camcal.data.writing import atomic_write
    from camcal.report.plain import plain
    from camcal.report.yaml import dump_yaml

    atomic_write(path, dump_yaml(plain(document)), force)


def _write_picture(path: Path, picture: Any, force: bool) -> None:
    import cv2

    from camcal.data.writing import atomic_write

    options = [cv2.IMWRITE_JPEG_QUALITY, 95] if path.suffix == ".jpg" else []
    done, data = cv2.imencode(path.suffix, picture, options)
    assert done, f"cv2 does not write {path.suffix}"
    atomic_write(path, data.tobytes(), force)
