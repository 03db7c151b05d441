"""`camcal doctor`: what is wrong, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from camcal.cli.options import options
from camcal.cli.verbosity import verbosity_options
from camcal.settings.kinds import is_report

SOMETHING_WRONG = 1


@click.command("doctor")
@click.argument("data", nargs=-1, metavar="[REPORT|IMAGES]...")
@options("doctor")
@verbosity_options
@click.pass_context
def command(ctx: click.Context, data: tuple[str, ...], **options: Any) -> int:
    """Find what is wrong, and say in plain words what to do next.

    For a REPORT: its warnings and possible improvements, ordered by their gain. For IMAGES (or tables of
    points): the pictures themselves, and then a calibration from them. Without an argument: the installation.
    The exit code is 1 if something is wrong.
    """
    from camcal.cli.output import emit

    if not data:
        from camcal.report.doctor.installation import diagnose

        found = diagnose()
    elif len(data) == 1 and is_report(data[0]):
        found = _of_report(Path(data[0]))
    else:
        found = _of_data(data, options)
    emit(found, options["format"], lambda: _shown(found))
    return 0 if found["healthy"] else SOMETHING_WRONG


def _of_report(path: Path) -> dict[str, Any]:
    from camcal.report.doctor import calibration, rig
    from camcal.report.loading import from_document
    from camcal.report.rig_loading import from_document as rig_of
    from camcal.report.rig_loading import is_rig_report
    from camcal.report.yaml import read_document
    from camcal.schema import check

    report = read_document(path)
    check(report, str(path))
    if is_rig_report(report):
        return rig.diagnose(report, rig_of(report, str(path)), str(path))
    return calibration.diagnose(report, from_document(report, str(path)), str(path))


def _of_data(paths: tuple[str, ...], options: dict[str, Any]) -> dict[str, Any]:
    """Examine pictures first, then calibrate them as `camcal checkerboard` would."""
    from camcal.cli.job import read_data
    from camcal.errors import CamcalError
    from camcal.plan.calibrate import calibrate
    from camcal.report.doctor import calibration, diagnosis, pictures
    from camcal.report.document import document

    lost: list[Mapping[str, Any]] = []
    try:
        found = read_data(paths, options, lost.append)
    except CamcalError as error:
        if not lost:
            raise  # nothing was looked at: no such folder, no pictures
        wrong = pictures.nothing_found(error, lost)
        return diagnosis("pictures", f"These pictures cannot be used yet: {wrong[0].message}", wrong)
    own = pictures.examine(found) if found.picture_quality else []
    try:
        solution = calibrate(found, options["model"])
    except CamcalError as error:
        wrong = [*own, *pictures.lost(found), pictures.not_calibrated(error)]
        return diagnosis("pictures", f"These data give no calibration: {error.message}", wrong)
    report = document(solution)
    more = calibration.examine(report, solution, "")
    said = calibration.sentence(report, more)
    return diagnosis("data", said, _once([*own, *more]), rms_point=report["fit"]["rms_point"])


def _once(findings: list[Any]) -> list[Any]:
    """Remove findings that name bad pictures a second time: warnings about them, and findings without a gain."""
    looked = any(f.code.startswith("pictures-") for f in findings)
    codes = [f.code for f in findings]
    return [
        f
        for i, f in enumerate(findings)
        if not (looked and f.code == "worse-pictures" and f.gain is None)
        and not (f.code.startswith("pictures-") and f.code in codes[:i])
    ]


def _shown(found: dict[str, Any]) -> Any:
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    from camcal.cli.output import table

    parts: list[Any] = [Text(found["sentence"], style="bold")]
    if "checks" in found:
        rows = [[c["status"], c["name"], c["found"]] for c in found["checks"]]
        parts += [Text(""), table(["", "what", "found"], rows)]
    style = {"wrong": "bold red", "better": "yellow", "note": "dim"}
    for place, f in enumerate(found["findings"], 1):
        head = Text.assemble(f"{place}. ", (f["grade"], style[f["grade"]]), f": {f['message']}")
        parts += [Text(""), head]
        if f["todo"]:
            parts.append(Padding(Text(f["todo"]), (0, 0, 0, 3)))
        if f["gain"]:
            parts.append(Padding(Text(gain_words(f["gain"]), style="dim"), (0, 0, 0, 3)))
    return Group(*parts)


def gain_words(gain: Mapping[str, Any]) -> str:
    """The gain of a finding's entry in a line."""
    from camcal.report.doctor import Gain

    return Gain(**{k: v for k, v in gain.items() if k != "times"}).words
