"""One small run of each command that writes, on the inputs of tests/hardening/inputs.py.

The commands and what they can write come from the table of options; a command without an example fails
`test_every_command_that_writes_has_an_example`.
"""

from __future__ import annotations

from camcal.settings.commands import OPTIONS

QUICK = ("--no-crosscheck", "--holdout", "0")
SIZE = ("--image-size", "640x480")
MODEL = ("-m", "pinhole")

#: command -> a run that ends with 0 or 1 and writes; "OUT" stands for a folder that the command may write into
EXAMPLES: dict[str, list[str]] = {
    "estimate": [
        "p.csv",
        *SIZE,
        *MODEL,
        *QUICK,
        "-o",
        "OUT/r.yaml",
        "--trace",
        "OUT/t.csv",
        "--save-camera",
        "OUT/c.yml",
    ],
    "rig": ["rig.csv", *SIZE, *MODEL, *QUICK, "-o", "OUT/r.yaml"],
    "checkerboard": ["board", "--board", "9x6", "--no-cache", *MODEL, *QUICK, "--board-shape", "flat"]
    + ["--no-refine-corners", "-j", "1", "-o", "OUT/r.yaml", "--save-corners", "OUT/c.csv"],
    "batch": ["jobs.yaml", "-o", "OUT", "--junit", "OUT/j.xml", "--summary", "OUT/s.md"],
    "watch": ["board", "--once", "--board", "9x6", "--no-cache", *MODEL, "-o", "OUT/r.yaml"],
    "detect": ["board", "--board", "9x6", "--no-cache", "-j", "1", "-o", "OUT/c.csv"],
    "evaluate": ["r.yaml", "p.csv", "-o", "OUT/e.yaml"],
    "lines": ["lines.csv", "-m", "division:1", *SIZE, "--no-crosscheck", "-o", "OUT/l.yaml"],
    "selfcalib": ["tracks.csv", *SIZE, "-m", "pinhole", "--no-crosscheck", "-o", "OUT/s.yaml"],
    "wand": ["wand.csv", "--bar", "0.5", *SIZE, "--no-crosscheck", "-o", "OUT/w.yaml"],
    "scene": ["room.csv", *SIZE, "-o", "OUT/s.yaml"],
    "pose": ["r.yaml", "pose.csv", "--no-crosscheck", "-o", "OUT/p.yaml"],
    "triangulate": ["dlt.csv", "points2d.csv", "--no-crosscheck", "-o", "OUT/p.csv"],
    "compare": ["r.yaml", "r.yaml", "-o", "OUT/c.yaml", "--junit", "OUT/j.xml", "--summary", "OUT/s.md"],
    "select": ["p.csv", *SIZE, "--models", "pinhole", "--folds", "2", "-o", "OUT/s.yaml"],
    "convert": ["r.yaml", "OUT/c.yml", "--to", "opencv"],
    "lens-fit": ["pairs.csv", "-m", "opencv4", "-o", "OUT/l.yaml"],
    "undistort": ["one", "-c", "r.yaml", *SIZE, "-o", "OUT/u", "--maps", "OUT/m.npz"],
    "rectify": ["rig.yaml", "left=one", "right=one", "-o", "OUT/u"],
    "report": ["r.yaml", "-o", "OUT/r.html", "--plots", "OUT/plots"],
    "compare-optimizers": [
        "p.csv",
        *SIZE,
        *MODEL,
        "--optimizers",
        "lm",
        "--perturbed",
        "0",
        "-o",
        "OUT/o.yaml",
    ]
    + ["--trace", "OUT/t.csv", "--plot", "OUT/p.png"],
    "next": ["r.yaml", "-o", "OUT/n.svg"],
    "track": ["f.csv", "-o", "OUT/t.csv", "--report", "OUT/r.yaml", "--plots", "OUT/plots"],
    "board": ["checkerboard:9x6:25mm", "-o", "OUT/b.svg"],
    "simulate points": ["--views", "2", "-o", "OUT/p.csv"],
    "simulate rig": ["--views", "2", "-o", "OUT/p.csv"],
    "simulate images": ["--views", "1", *SIZE, "-o", "OUT/i"],
    "simulate frames": ["--frames", "3", "-o", "OUT/f.csv"],
    "hand-eye": ["r.yaml", "--poses", "poses.csv", "-o", "OUT/h.yaml"],
}
EXAMPLES["images"] = EXAMPLES["checkerboard"]
#: further runs of a command: what is written in another way
FURTHER = {"track": ["f.csv", "-o", "OUT/t.csv", "--state", "OUT/state", "--state-every", "4"]}


def writing() -> list[str]:
    """The commands that have an option that names what is written."""
    names = [c for c, options in OPTIONS.items() if any(o.writes and o.name != "force" for o in options)]
    return [*names, "convert"] if "convert" not in names else names


def runs() -> list[tuple[str, list[str]]]:
    """(name, the words after `camcal`) of all runs."""
    made = [(name, [*name.split(), *EXAMPLES[name]]) for name in writing() if name in EXAMPLES]
    return [*made, *((f"{name} further", [name, *words]) for name, words in FURTHER.items())]
