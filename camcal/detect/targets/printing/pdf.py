"""A sheet as PDF: one page, black shapes, one line of text in a font that every reader has (ISO 32000-1)."""

from __future__ import annotations

import numpy as np

from camcal.detect.targets.printing.sheet import LINE, Sheet

POINTS = 72 / 25.4  #: per millimetre
#: of the radius; handles of the Bézier curve nearest to a quarter of a circle, true to 2.7e-4 of the radius
HANDLE = 4 / 3 * (np.sqrt(2) - 1)


def write(sheet: Sheet, dpi: float = 0.0) -> bytes:
    """The PDF file; `dpi` is of no meaning here."""
    stream = content(sheet).encode("latin-1", "replace")
    box = f"[0 0 {number(sheet.width * POINTS)} {number(sheet.height * POINTS)}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
            "/Resources << /Font << /F1 5 0 R >> >> >>"
        ).encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out = bytearray(b"%PDF-1.4\n")
    places = []
    for index, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (index, body)
    table = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(out)


def content(sheet: Sheet) -> str:
    """The page's drawing operators, in millimetres with y downward."""
    k = number(POINTS)
    out = [f"{k} 0 0 -{k} 0 {number(sheet.height * POINTS)} cm", "0 g"]
    # one path for all: readers that smooth edges would show seams between shapes that are filled one by one
    for polygon in sheet.polygons:
        (x, y), *rest = np.asarray(polygon)
        out.append(
            f"{number(x)} {number(y)} m " + " ".join(f"{number(a)} {number(b)} l" for a, b in rest) + " h"
        )
    out.append("f")
    out += [disc(x, y, r) for x, y, r in sheet.circles]
    out.append(f"{LINE} w")
    out += [f"{number(a)} {number(b)} m {number(c)} {number(d)} l S" for a, b, c, d in sheet.lines]
    x, y = sheet.caption_at
    text = sheet.caption.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    out.append(f"BT /F1 3 Tf 1 0 0 -1 {number(x)} {number(y)} Tm ({text}) Tj ET")
    return "\n".join(out)


def disc(x: float, y: float, r: float) -> str:
    """A filled circle of four Bézier curves."""
    h = HANDLE * r
    curves = [
        (x + r, y + h, x + h, y + r, x, y + r),
        (x - h, y + r, x - r, y + h, x - r, y),
        (x - r, y - h, x - h, y - r, x, y - r),
        (x + h, y - r, x + r, y - h, x + r, y),
    ]
    start = f"{number(x + r)} {number(y)} m "
    return start + " ".join(" ".join(map(number, c)) + " c" for c in curves) + " f"


def number(value: float) -> str:
    """A number without an exponent, which PDF does not know."""
    return f"{value:.5f}".rstrip("0").rstrip(".")
