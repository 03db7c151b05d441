"""Printable targets at true scale: a sheet in millimetres, written as SVG, PDF or PNG."""

WRITERS = {
    ".svg": "camcal.targets.printing.svg:write",
    ".pdf": "camcal.targets.printing.pdf:write",
    ".png": "camcal.targets.printing.png:write",
}
