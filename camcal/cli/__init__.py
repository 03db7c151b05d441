"""The command line: one file per command.

A command = one file here + one line in this table. The table is read by `--help` and by completion, so it
imports nothing: the one-line help stands here, the command itself is loaded when it runs.
"""

from __future__ import annotations

COMMANDS: dict[str, tuple[str, str]] = {
    "estimate": ("camcal.cli.estimate:command", "Calibrate from points of known position and their images."),
    "checkerboard": ("camcal.cli.checkerboard:command", "Calibrate from pictures of a checkerboard."),
    "images": ("camcal.cli.checkerboard:images", "The same for pictures of any target."),
    "batch": ("camcal.cli.batch:command", "Calibrate many cameras, with a summary of all."),
    "watch": ("camcal.cli.watch:command", "Calibrate while pictures arrive; say what to take next."),
    "detect": ("camcal.cli.detect:command", "Write the corners found in pictures as a table."),
    "evaluate": ("camcal.cli.evaluate:command", "Judge a camera on data it was not calibrated with."),
    "lines": ("camcal.cli.lines:command", "Find the distortion of a lens from straight lines."),
    "pose": ("camcal.cli.pose:command", "Find where a known camera stood, with all solutions."),
    "triangulate": ("camcal.cli.triangulate:command", "Find points in space that several cameras see."),
    "uncertainty": ("camcal.cli.uncertainty:command", "Say how far noise moves what a camera projects."),
    "compare": ("camcal.cli.compare:command", "Compare two cameras by what they project, with tolerances."),
    "select": ("camcal.cli.select:command", "Find the lens model that the data call for."),
    "convert": ("camcal.cli.convert:command", "Convert a camera to another format or lens model."),
    "lens-fit": ("camcal.cli.lens_fit:command", "Fit a lens to pairs of ideal and distorted points."),
    "undistort": ("camcal.cli.undistort:command", "Take the distortion out of pictures."),
    "report": ("camcal.cli.report:command", "Show a report as one self-contained HTML page."),
    "compare-optimizers": (
        "camcal.cli.compare_optimizers:command",
        "Run all optimizers on one problem, from the same starts.",
    ),
    "doctor": ("camcal.cli.doctor:command", "Say what is wrong and what to do next."),
    "next": ("camcal.cli.next:command", "Suggest the picture that would make a camera best known."),
    "track": ("camcal.cli.track:command", "Follow a camera that changes with time."),
    "board": ("camcal.cli.board:command", "Write a target to print, at true scale."),
    "simulate": (
        "camcal.cli.simulate:command",
        "Make points, rigs, pictures or frames whose truth is known.",
    ),
    "list": (
        "camcal.cli.list_:command",
        "List the models, targets, optimizers, closed forms, formats or commands.",
    ),
}
