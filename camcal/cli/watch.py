"""`camcal watch`: calibrate while pictures arrive."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from camcal.cli.options import options as options_of
from camcal.cli.options import resolved_options, settle
from camcal.cli.verbosity import note, verbosity_options
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.detection import DetectionOptions
from camcal.system.text import counted

if TYPE_CHECKING:
    from camcal.batch.grabber import Grabber
    from camcal.batch.live_page import LivePage
    from camcal.batch.watch import Step, Watcher

#: s; how often the folder is looked at
LOOK = 0.1


@click.command("watch")
@click.argument("folder", type=click.Path(path_type=Path), metavar="FOLDER|FILM|DEVICE")
@options_of("watch")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, folder: Path, **options: Any) -> int:
    """Calibrate while pictures arrive in a folder, and say where to hold the target next.

    Each picture is searched as it arrives, and the report is updated. With --target-px the command ends when
    the worst uncertainty over the picture, at the boards' distance, is at most PX; otherwise when it is
    interrupted. With --once it calibrates from the existing pictures, as `camcal checkerboard` does, and ends.
    From a film, or a camera such as /dev/video0, still frames that differ are saved as pictures in a folder
    next to the report.
    """
    from camcal.cli.job import output_is_free

    output_is_free(options)
    folder, grabber = _source(folder, options)
    options["format"] = "table"
    settle(ctx, options, board_shape="auto" if options["once"] else "flat")
    if options["once"]:
        return _final(ctx, folder, options) or 0
    from camcal.batch.live_page import LivePage

    served = None if options["serve"] is None else LivePage(options["serve"])
    if served is not None:
        note(f"The page: {served.address}")
    try:
        return _watch(ctx, folder, options, served, grabber)
    finally:
        if served is not None:
            served.close()


def _source(path: Path, options: dict[str, Any]) -> tuple[Path, Grabber | None]:
    """The watched folder, and the writer into it if the source is a film or a camera."""
    from camcal.errors import DataError, UsageError

    if path.is_dir():
        return path, None
    from camcal.batch.grabber import Grabber, is_source

    if not is_source(path) and path.exists():
        raise DataError(
            f"'{path}' is neither a folder nor a film nor a camera.",
            "Give the folder that pictures arrive in.",
        )
    if not is_source(path):
        what, hint = _missing(path)
        raise DataError(f"there is no {what} '{path}'.", hint)
    if options["once"]:
        raise UsageError("--once is for a folder of pictures.", "For a film: camcal checkerboard FILM")
    folder = options["output"].with_name(f"{options['output'].stem}-frames")
    if folder.exists() and not options["force"]:
        raise UsageError(f"'{folder}' exists already.", "Choose another --output, or use --force.")
    grabber = Grabber(path, folder)
    note(f"Frames are kept in '{folder}'.")
    grabber.start()
    return folder, grabber


def _missing(path: Path) -> tuple[str, str]:
    """The kind of a missing path, and a hint."""
    from camcal.detect.frames import is_film

    if path.name.isdigit():
        return "folder", f"For a camera: /dev/video{path.name}. For a folder: make it first."
    if path.parent == Path("/dev"):
        there = ", ".join(map(str, sorted(path.parent.glob("video*")))) or "none"
        return "camera", f"Is it connected? Existing devices: {there}."
    if is_film(path):
        return "film", "Check the path."
    return "folder", "Make it first, then let the pictures arrive there."


def _watch(
    ctx: click.Context,
    folder: Path,
    options: dict[str, Any],
    served: LivePage | None,
    grabber: Grabber | None = None,
) -> int:
    from camcal.batch.arrivals import Arrivals
    from camcal.batch.watch import Watcher

    watcher = Watcher(
        {name: options[name] for name in DetectionOptions.options()},
        {name: options[name] for name in CalibrationOptions.options() if name in options},
    )
    arrivals, steps = Arrivals(folder), []
    target = options["target_px"]
    note(f"Waiting for pictures in '{folder}'; end with ^C.")
    while True:
        ready, gone = arrivals.look()
        for path in gone:
            steps.append(_say(watcher.drop(path)))
        for path in ready:
            steps.append(_say(watcher.take(path)))
            _save(ctx, watcher, options)
            if served is not None:
                served.show(steps, watcher.chart, target)
            if target is not None and watcher.worst is not None and watcher.worst <= target:
                code = _final(ctx, folder, {**options, "force": True}, target)
                if code is not None:
                    return code
        if not ready and grabber is not None and grabber.done and not arrivals.waiting:
            return _final(ctx, folder, {**options, "force": True}) or 0
        if not ready:
            time.sleep(LOOK)


def _say(step: Step) -> Step:
    said = {
        "found": f"{step.points} points",
        "removed": "removed",
        "not_found": f"the target was not found: {step.reason}",
        "unreadable": f"unreadable: {step.reason}",
    }[step.status]
    if step.rms is not None:
        said += f", rms {step.rms:.3g} px"
    if step.after is not None:
        before = "" if step.before is None else f"{step.before:.3g} -> "
        pictures = counted(step.views, "picture")
        said += f"; worst uncertainty {before}{step.after:.3g} px at the {step.weakest}, {pictures}"
    note(f"{step.id}: {said} ({step.seconds:.2f} s).")
    if step.trouble:
        note(f"  no camera yet: {step.trouble}")
    note(f"  next: {step.advice}.")
    return step


def _save(ctx: click.Context, watcher: Watcher, options: dict[str, Any]) -> None:
    """Write the report of the current camera."""
    from camcal.cli.job import command_line
    from camcal.report.document import document, save

    if watcher.solution is not None:
        solution = replace(watcher.solution, options=resolved_options(ctx))
        save(document(solution, command=command_line(ctx)), options["output"], force=True)


def _final(
    ctx: click.Context, folder: Path, options: dict[str, Any], target: float | None = None
) -> int | None:
    """Calibrate with all checks, as `camcal checkerboard`; None if the camera is not as certain as requested."""
    from camcal.batch.watch import worst_uncertainty
    from camcal.cli.job import calibrate_and_report, read_pictures
    from camcal.errors import CamcalError
    from camcal.report.loading import load
    from camcal.report.next_view import suggest

    code = calibrate_and_report(ctx, read_pictures((str(folder),), options), options)
    solution = load(options["output"])
    worst, place = worst_uncertainty(solution)
    note(f"Worst uncertainty {worst:.3g} px, at the {place} of the picture.")
    if target is not None and worst > target:
        note(f"With all checks it is not yet {target:g} px; more pictures are needed.")
        return None
    if target is None:
        with contextlib.suppress(CamcalError):
            from camcal.assess.uncertainty import board_distance

            answer, _ = suggest(solution, 1, board_distance(solution))
            note(f"Next: hold the target at the {answer['suggestions'][0]['words']}.")
    return code
