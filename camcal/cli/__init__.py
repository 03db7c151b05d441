"""The command line: one file per command.

A command is one file here, one line in this table, and its options in `camcal.settings.commands`. `--help` and
completion read the table, so it imports nothing: it holds the one-line help, and the command is loaded when it runs.
"""

from __future__ import annotations

COMMANDS: dict[str, tuple[str, str]] = {
    "estimate": ("camcal.cli.estimate:command", "Calibrate from points of known position and their images."),
    "checkerboard": ("camcal.cli.checkerboard:command", "Calibrate from pictures of a checkerboard."),
    "images": ("camcal.cli.checkerboard:images", "The same for pictures of any target."),
    "rig": ("camcal.cli.rig:command", "Calibrate several cameras that are mounted to each other."),
    "batch": ("camcal.cli.batch:command", "Calibrate many cameras, with a summary of all."),
    "watch": ("camcal.cli.watch:command", "Calibrate while pictures arrive; say what to take next."),
    "detect": ("camcal.cli.detect:command", "Write the corners found in pictures as a table."),
    "evaluate": ("camcal.cli.evaluate:command", "Test a camera on data that it was not calibrated with."),
    "lines": ("camcal.cli.lines:command", "Find the distortion of a lens from straight lines."),
    "selfcalib": (
        "camcal.cli.selfcalib:command",
        "Calibrate from tracks of unknown points over several views.",
    ),
    "scene": ("camcal.cli.scene:command", "Find a camera from one picture of a room or a street."),
    "pose": ("camcal.cli.pose:command", "Find the pose of a known camera, with all solutions."),
    "wand": (
        "camcal.cli.wand:command",
        "Calibrate several cameras from a bar of known length.",
    ),
    "triangulate": (
        "camcal.cli.triangulate:command",
        "Find the position of points that several cameras see.",
    ),
    "hand-eye": (
        "camcal.cli.hand_eye:command",
        "Find where a camera sits on a robot's hand, or beside the robot.",
    ),
    "uncertainty": (
        "camcal.cli.uncertainty:command",
        "Compute the uncertainty of projections due to noise.",
    ),
    "compare": ("camcal.cli.compare:command", "Compare two cameras by what they project, with tolerances."),
    "select": ("camcal.cli.select:command", "Find the lens model that suits the data."),
    "convert": ("camcal.cli.convert:command", "Convert a camera to another format or lens model."),
    "lens-fit": ("camcal.cli.lens_fit:command", "Fit a lens to pairs of ideal and distorted points."),
    "undistort": ("camcal.cli.undistort:command", "Remove the distortion from pictures."),
    "rectify": ("camcal.cli.rectify:command", "Rectify pictures of two cameras: points lie in equal rows."),
    "report": ("camcal.cli.report:command", "Show a report as one self-contained HTML page."),
    "compare-optimizers": (
        "camcal.cli.compare_optimizers:command",
        "Run all optimizers on one problem, from the same starts.",
    ),
    "doctor": ("camcal.cli.doctor:command", "Find what is wrong, and say what to do next."),
    "next": ("camcal.cli.next:command", "Suggest the picture to take next."),
    "track": ("camcal.cli.track:command", "Follow a camera that changes with time."),
    "board": ("camcal.cli.board:command", "Write a target to print, at true scale."),
    "simulate": (
        "camcal.cli.simulate:command",
        "Simulate points, rigs, pictures or frames, with their true values.",
    ),
    "list": (
        "camcal.cli.list_:command",
        "List the models, targets, optimizers, closed forms, formats or commands.",
    ),
}
