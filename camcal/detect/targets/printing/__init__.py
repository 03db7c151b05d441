"""Printable targets at true scale: a sheet in millimetres, written as SVG, PDF or PNG."""

WRITERS = {
    ".svg": "camcal.detect.targets.printing.svg:write",
    ".pdf": "camcal.detect.targets.printing.pdf:write",
    ".png": "camcal.detect.targets.printing.png:write",
}
