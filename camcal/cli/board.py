"""`camcal board`: a target to print, and the configuration for using it."""

from __future__ import annotations

from pathlib import Path

import click

from camcal.cli.options import options
from camcal.cli.verbosity import note, verbosity_options


@click.command("board")
@click.argument("spec", metavar="SPEC")
@options("board")
@verbosity_options
def command(spec: str, output: Path, page: str, dpi: float, force: bool) -> None:
    """Write a target at true scale, with rulers in both directions to check the print.

    SPEC is a target with its sizes, such as checkerboard:9x6:25mm; `camcal list targets` names them. A
    configuration file of the same name (.yaml) is written next to it: calibrate with --config and that file. It
    explains how to measure and mount the print, as does the second page of a PDF.
    """
    from camcal import registry
    from camcal.data.writing import atomic_write, check_writable
    from camcal.detect import targets
    from camcal.detect.targets.printing import WRITERS
    from camcal.detect.targets.printing.sheet import lay_out
    from camcal.errors import UsageError

    suffix = output.suffix.lower()
    if suffix not in WRITERS:
        found = f"ends in '{suffix}'" if suffix else "has no ending"
        raise UsageError(
            f"the name {output} {found}; {', '.join(WRITERS)} can be written.", "Try: -o board.pdf"
        )
    beside = output.with_suffix(".yaml")
    for path in (output, beside):
        check_writable(path, force)
    target = targets.make(spec)
    sheet = lay_out(target, spec, page)
    atomic_write(output, registry.load(WRITERS[suffix])(sheet, dpi), force)
    atomic_write(beside, _configuration(output.name, beside.name, spec, sheet.instructions), force)
    on = {"own": "no common paper is large enough" if page == "auto" else "its own size"}
    paper = on.get(sheet.page, sheet.page.upper() if len(sheet.page) == 2 else sheet.page)
    note(f"{output}: {sheet.width:.0f} x {sheet.height:.0f} mm ({paper}); configuration: {beside}")


def _configuration(name: str, own_name: str, spec: str, instructions: tuple[str, ...]) -> str:
    """The file that accompanies a print: how to measure and mount it, and the target for `--config`."""
    from textwrap import wrap

    lines = [f"# {name}; use: camcal checkerboard IMAGES --config {own_name}", "#"]
    for number, paragraph in enumerate(instructions, 1):
        first, *rest = wrap(f"{number}. {paragraph}", 100)
        lines += [f"# {first}", *(f"#    {line}" for line in rest)]
    return "\n".join([*lines, f"target: {spec}", ""])
