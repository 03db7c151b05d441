"""A sheet as PDF: black shapes, and text in a standard font (ISO 32000-1)."""

from __future__ import annotations

from textwrap import wrap

import numpy as np

from camcal.detect.targets.printing.sheet import LINE, NUMBER, Sheet

POINTS = 72 / 25.4  #: per millimetre
#: of the radius; handles of the Bézier curve closest to a quarter circle, accurate to 2.7e-4 of the radius
HANDLE = 4 / 3 * (np.sqrt(2) - 1)


SMALLEST_PAGE = 148.0  #: mm (A5); a narrower sheet has no page of instructions
TEXT, LEADING, MARGIN = 3.5, 5.5, 15.0  #: mm: size of the letters, line spacing, page margin
WIDTH_OF_LETTERS = 0.5  #: of their size, on average, in Helvetica


def write(sheet: Sheet, dpi: float = 0.0) -> bytes:
    """The PDF file: the target, and on a second page how to measure and mount it; `dpi` is ignored."""
    pages = [content(sheet)]
    if sheet.width >= SMALLEST_PAGE:
        pages.append(text_page(sheet))
    size = f"[0 0 {number(sheet.width * POINTS)} {number(sheet.height * POINTS)}]"
    kids = " ".join(f"{4 + 2 * i} 0 R" for i in range(len(pages)))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    for i, page in enumerate(pages):
        stream = page.encode("latin-1", "replace")
        objects += [
            (
                f"<< /Type /Page /Parent 2 0 R /MediaBox {size} /Contents {5 + 2 * i} 0 R "
                "/Resources << /Font << /F1 3 0 R >> >> >>"
            ).encode(),
            b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
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
    # one path for all: viewers with anti-aliasing would show seams between shapes filled separately
    for polygon in sheet.polygons:
        (x, y), *rest = np.asarray(polygon)
        out.append(
            f"{number(x)} {number(y)} m " + " ".join(f"{number(a)} {number(b)} l" for a, b in rest) + " h"
        )
    out.append("f")
    out += [disc(x, y, r) for x, y, r in sheet.circles]
    out.append(f"{LINE} w")
    out += [f"{number(a)} {number(b)} m {number(c)} {number(d)} l S" for a, b, c, d in sheet.lines]
    out += [text_at(text, x, y, NUMBER) for text, x, y in sheet.numbers]
    out.append(text_at(sheet.caption, *sheet.caption_at, 3.0))
    return "\n".join(out)


def text_at(text: str, x: float, y: float, size: float) -> str:
    """The operators of one line of text whose baseline begins at (x, y)."""
    held = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    return f"BT /F1 {number(size)} Tf 1 0 0 -1 {number(x)} {number(y)} Tm ({held}) Tj ET"


def text_page(sheet: Sheet) -> str:
    """The operators of the page on measuring and mounting the target."""
    k = number(POINTS)
    out, y = [f"{k} 0 0 -{k} 0 {number(sheet.height * POINTS)} cm", "0 g"], MARGIN + TEXT
    columns = int((sheet.width - 2 * MARGIN) / (WIDTH_OF_LETTERS * TEXT))
    for paragraph in (sheet.caption, *sheet.instructions):
        for line in wrap(paragraph, columns):
            out.append(text_at(line, MARGIN, y, TEXT))
            y += LEADING
        y += LEADING / 2
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
    """Format a number without an exponent, which PDF does not support."""
    return f"{value:.5f}".rstrip("0").rstrip(".")
