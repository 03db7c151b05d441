"""A sheet as SVG, with millimetres as user units."""

from __future__ import annotations

from xml.sax.saxutils import escape

import numpy as np

from camcal.detect.targets.printing.sheet import LINE, NUMBER, Sheet


def write(sheet: Sheet, dpi: float = 0.0) -> bytes:
    """The SVG file; `dpi` is ignored."""
    path = "".join(
        "M" + " ".join(f"{number(x)},{number(y)}" for x, y in np.asarray(p)) + "z" for p in sheet.polygons
    )
    discs = "\n".join(
        f'<circle cx="{number(x)}" cy="{number(y)}" r="{number(r)}"/>' for x, y, r in sheet.circles
    )
    lines = "\n".join(
        f'<line x1="{number(a)}" y1="{number(b)}" x2="{number(c)}" y2="{number(d)}"/>'
        for a, b, c, d in sheet.lines
    )
    numbers = "\n".join(
        f'<text x="{number(x)}" y="{number(y)}">{text}</text>' for text, x, y in sheet.numbers
    )
    w, h = number(sheet.width), number(sheet.height)
    x, y = sheet.caption_at
    caption = escape(sheet.caption)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" width="{w}mm" height="{h}mm" viewBox="0 0 {w} {h}">
<title>{caption}</title>
<rect width="{w}" height="{h}" fill="white"/>
<path d="{path}" fill="black" shape-rendering="crispEdges"/>
<g fill="black">
{discs}
</g>
<g stroke="black" stroke-width="{LINE}">
{lines}
</g>
<g font-family="Helvetica, sans-serif" font-size="{NUMBER}">
{numbers}
</g>
<text x="{number(x)}" y="{number(y)}" font-family="Helvetica, sans-serif" font-size="3">{caption}</text>
</svg>
""".encode()


def number(value: float) -> str:
    """Format a length to a tenth of a micrometre, without trailing zeros."""
    return f"{value:.4f}".rstrip("0").rstrip(".")
