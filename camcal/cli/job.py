"""The common part of the calibrating commands: read, calibrate, report, exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli import camera_files
from camcal.cli.options import resolved_options
from camcal.cli.output import console, emit, progress
from camcal.cli.verbosity import note, verbosity
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions
from camcal.settings.kinds import is_report
from camcal.settings.option import Settings
from camcal.system.processes import keep_freed_memory
from camcal.system.text import counted, listed

if TYPE_CHECKING:
    from camcal.data.observations import Correspondences
    from camcal.model.camera import Camera
    from camcal.model.rig import Rig
    from camcal.plan.solution import Solution

TABLES = (
    ".csv",
    ".txt",
    ".tsv",
    ".dat",
    ".npz",
    ".vnl",
    ".orpc",
    ".mat",
    ".bin",
    ".yml",
    ".yaml",
    ".xml",
    ".json",
)
GATE_FAILED = 1
PATIENT = 60.0  #: s; with --reproducible a busy machine must not decide which pictures are given up

OnPicture = Callable[[Mapping[str, Any]], Any]


def is_table(path: str | Path) -> bool:
    """Return whether a name is that of a table of points; `FILE#CAMERA` is one camera of it."""
    return Path(path).suffix.lower().partition("#")[0] in TABLES


def names_of(settings: type[Settings]) -> list[str]:
    """The names of the options that a command line has of some settings."""
    return [option.name for option in settings.command_line()]


def output_is_free(options: dict[str, Any], *more: str) -> None:
    """Raise a UsageError if a file cannot be written, before any work is done.

    These are `--output`, `--trace`, and the options named in `more`.
    """
    from camcal.data.writing import check_writable

    for path in map(options.get, ("output", "trace", *more)):
        if path is not None:
            check_writable(path, options["force"])
    camera_files.check(options)


def read_data(
    paths: tuple[str, ...], options: dict[str, Any], on_picture: OnPicture | None = None
) -> Correspondences:
    """Read tables of points or pictures of a board, depending on the names."""
    if all(is_table(path) for path in paths):
        from camcal.data.points import read_points

        square = options.get("square")
        return read_points(
            *paths,
            image_size=options["image_size"],
            board=options.get("board"),
            square=1.0 if square is None else square.value,
        )
    return read_pictures(paths, options, on_picture)


def in_order(paths: tuple[Any, ...], options: Mapping[str, Any], ctx: click.Context) -> tuple[Any, ...]:
    """The inputs as given; with --reproducible sorted by name, in the report too.

    Those of a rig, `NAME=PATH`, stay in the order of their cameras: the first is the reference.
    """
    if not options.get("reproducible"):
        return paths
    from camcal.detect.listing import natural_order
    from camcal.settings.rig import split_camera

    pairs = {path: split_camera(str(path)) or ("", str(path)) for path in paths}
    cameras = list(dict.fromkeys(name for name, _ in pairs.values()))
    ordered = tuple(
        sorted(paths, key=lambda path: (cameras.index(pairs[path][0]), natural_order(Path(pairs[path][1]))))
    )
    state = ctx.find_root().ensure_object(dict)
    names, new = [str(p) for p in paths], iter(str(p) for p in ordered)
    words = state.get("args", [])
    if [word for word in words if word in names] == names:  # not where an option's value is also an input
        state["args"] = [next(new) if word in names else word for word in words]
    return ordered


def read_pictures(
    paths: tuple[str, ...],
    options: dict[str, Any],
    on_picture: OnPicture | None = None,
    calibrated: bool = True,
) -> Correspondences:
    """Find the board in pictures; `options` holds the values of `board_options`.

    `on_picture` is called with the details of each picture: id, status, reason, ... `calibrated` says whether a
    calibration follows.
    """
    from camcal.detect.images import detect_images

    keep_freed_memory()
    with progress("reading pictures") as show:
        listen = detection_events(show, on_picture, calibrated)
        return detect_images(paths, **search_options(options), on_event=listen)


def search_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of the search in pictures."""
    search = {name: options[name] for name in names_of(DetectionOptions) if name in options}
    if options.get("reproducible"):
        search["seconds"] = max(search["seconds"], PATIENT)
    return search


def _import_calibration() -> None:
    """Import what a calibration and its report need."""
    import camcal.peers.run
    import camcal.plan.calibrate
    import camcal.plan.second_pass
    import camcal.report.document
    import camcal.report.table  # noqa: F401


def detection_events(
    show: Callable[[int, int], None], on_picture: OnPicture | None = None, calibrated: bool = True
) -> Callable[[str, Mapping[str, Any]], None]:
    """Progress messages of the search in pictures; `show` is called with (done, count).

    With `calibrated`, the modules of a calibration are imported while other processes search.
    """

    def show_event(event: str, details: Mapping[str, Any]) -> None:
        if event in ("searched", "film"):
            show(details["done"], details["count"])
        elif event == "waiting" and calibrated:
            _import_calibration()
        elif event == "picture":
            if on_picture is not None:
                on_picture(details)
            if details["status"] != "found":
                note(f"{details['id']}: {details['reason']}", 1)
        elif event == "frames":
            note("{path}: {searched} of {frames} frames are searched".format(**details))
        elif event == "left":
            names = listed([p.name for p in details["files"]])
            note(
                f"not used, as there are pictures in the same folder: {names}; name a film to use it, and unpack an "
                "archive before"
            )
        elif event == "no-film":
            note("none of the inputs is a film: --every, --from and --to are ignored")
        elif event == "negative":
            note(
                "black and white are exchanged in the pictures. To select that: --target {spec}".format(
                    **details
                )
            )
        elif event == "marked":
            note(
                "the pictures show {words}; its inner corners are used as a plain checkerboard, as requested. To use "
                "its markers: --target {spec}".format(**details)
            )
        elif event == "turned":
            note(
                "{count} of {of} pictures were held in another orientation: used as the sensor recorded them".format(
                    **details
                )
            )
        elif event == "target":
            note(_recognised(details))
        elif event == "cache":
            note(f"detections cannot be cached for the next run: {details['reason']}", 1)

    return show_event


def _recognised(details: Mapping[str, Any]) -> str:
    """One line: the recognised target, and the option that selects it."""
    said = "target: {words}, in {pictures} of {of} {noun}".format(**details)
    if not details["whole"]:
        said += " (the edge of the board is not visible; a part of this size is used)"
    if details["others"]:
        said += "; also " + ", ".join(details["others"])
    return f"{said}. To select it: --target {details['spec']}"


def save_detections(found: Correspondences, path: Path, force: bool) -> None:
    """Write the detections as a table that `camcal estimate` reads."""
    from camcal.data.writing import write_points

    write_points(path, found, force, view_column="file")
    note(f"{counted(found.point_count, 'point')} of {counted(len(found), 'picture')} written to {path}.")


def calibrate_and_report(
    ctx: click.Context,
    correspondences: Correspondences,
    options: dict[str, Any],
    save_corners: Path | None = None,
    sections: Mapping[str, Any] | None = None,
) -> int:
    """Calibrate, write the report and show it; return 1 if the verdict is `fail`, otherwise 0.

    Parameters
    ----------
    options : dict
        The values of `calibration_options` and `report_options`, by name; with `refine_corners`, the points
        come from pictures that are read again.
    save_corners : Path, optional
        Where to write the final points.
    sections : mapping, optional
        Further entries of the report.
    """
    given = {name: options[name] for name in names_of(CalibrationOptions)}
    if is_report(given["board_shape"]):
        from camcal.report.board import on_known_board

        correspondences = on_known_board(correspondences, given["board_shape"])
        given["board_shape"] = "flat"
    sections = dict(sections or {})
    from camcal.plan.calibrate import calibrate

    if "refine_corners" in options:
        given["refine_points"] = options["refine_corners"]
    solution = calibrate(correspondences, on_event=_on_event, **given)
    if save_corners is not None and solution.points is not None:
        save_detections(solution.points, save_corners, options["force"])
    return deliver_solution(ctx, solution, options, sections)


def _on_event(event: str, details: Mapping[str, Any]) -> None:
    if event == "selected":
        note(f"model {details['chosen']}: {details['why']}. To select it: --model {details['chosen']}")
    if event != "refined-points":
        return
    before, after = details["holdout_before"], details["holdout_after"]
    held = (
        "too few views for a hold-out"
        if None in (before, after)
        else f"hold-out {before:.4f} -> {after:.4f} px"
    )
    kept = "kept" if details["kept"] else "not kept"
    note(f"points refined with the camera: moved by {details['moved_px']:.3f} px, {held}, {kept}")


def deliver_solution(
    ctx: click.Context,
    solution: Solution,
    options: dict[str, Any],
    sections: Mapping[str, Any] | None = None,
) -> int:
    """Write the report to `output`, show it on stdout, summarise it on stderr; return the exit code.

    `sections` are further entries of the report, such as `selection`: how the model was chosen.
    """
    from camcal.report.document import document
    from camcal.report.table import tables

    # the gates of the verdict stand among the options
    solution = replace(solution, options=resolved_options(ctx))
    report = document(solution, command=command_line(ctx))
    if sections:
        from camcal.report.plain import plain

        report |= plain(sections)
    code = delivered(report, options, solution.camera, command_line(ctx), tables)
    if options.get("trace") is not None:
        write_trace(solution, options["trace"], options["force"])
    return code


def delivered(
    report: dict[str, Any],
    options: Mapping[str, Any],
    subject: Camera | Rig,
    command: list[str],
    tables: Callable[[dict[str, Any]], Any],
) -> int:
    """Write a report and its cameras, show it on stdout, summarise it on stderr; return the exit code."""
    from camcal.report.document import save
    from camcal.report.table import summary

    if options.get("reproducible"):
        from camcal.report.reproducible import without_times

        report = without_times(report)
    output = options["output"] if camera_files.is_report(options["output"], options) else None
    if output is not None:
        save(report, output, options["force"])
    camera_files.save(subject, options, command)
    emit(report, options["format"], lambda: tables(report))
    if verbosity() >= 0:
        console(stderr=True).print(summary(report))
    if output is not None:
        note(f"Report written to {output}.")
    return GATE_FAILED if report["verdict"] == "fail" else 0


def write_trace(solution: Solution, path: Path, force: bool) -> None:
    """Write the cost of each step of the final refinement as CSV."""
    from camcal.data.writing import atomic_write
    from camcal.report.convergence import trace

    atomic_write(path, trace(solution.fit.samples), force)


def command_line(ctx: click.Context) -> list[str]:
    """Return the words after `camcal`, as the user typed them, for the report."""
    return ctx.find_root().ensure_object(dict).get("args", sys.argv[1:])
