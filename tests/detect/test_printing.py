"""Printable targets: true scale in each format, and from the print back to the target."""

import re
import struct
import zlib
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import yaml

from camcal.cli.boundary import run
from camcal.detect import targets
from camcal.detect.targets.base import Detection
from camcal.detect.targets.printing import pdf, png, sheet, svg
from camcal.detect.targets.printing.sheet import DIGIT, NUMBER, UNPRINTED, lay_out, page_size
from camcal.errors import UsageError
from tests.detect.scenes import SPECS

MM = 72 / 25.4  #: points of PDF in a millimetre


def sheet_of(spec, page="own"):
    return lay_out(targets.make(spec), spec, page)


def same_shapes(polygons, circles, sheet):
    """Corners and discs in the same places, to a micrometre; a file holds four decimals of a millimetre."""
    assert len(polygons) == len(sheet.polygons) and len(circles) == len(sheet.circles)
    for mine, theirs in zip(polygons, sheet.polygons, strict=True):
        assert np.abs(np.array(mine) - theirs).max() < 1e-3
    for mine, theirs in zip(circles, sheet.circles, strict=True):
        assert np.abs(np.array(mine) - theirs).max() < 1e-3


@pytest.mark.parametrize("spec", SPECS)
def test_svg(spec):
    sheet = sheet_of(spec)
    root = ElementTree.fromstring(svg.write(sheet))
    space = "{http://www.w3.org/2000/svg}"
    assert root.get("width") == svg.number(sheet.width) + "mm" and root.get("height").endswith("mm")
    box = [float(v) for v in root.get("viewBox").split()]
    assert box[2:] == pytest.approx([sheet.width, sheet.height], abs=1e-4)  # one unit is a millimetre
    path = root.find(f"{space}path").get("d")
    polygons = [
        [[float(v) for v in p.split(",")] for p in part.split()] for part in re.findall(r"M(.*?)z", path)
    ]
    circles = [[float(c.get(k)) for k in ("cx", "cy", "r")] for c in root.iter(f"{space}circle")]
    same_shapes(polygons, circles, sheet)
    assert spec in root.find(f"{space}text").text


@pytest.mark.parametrize("spec", SPECS)
def test_pdf(spec):
    sheet = sheet_of(spec)
    data = pdf.write(sheet)
    assert data.startswith(b"%PDF-1.4") and data.rstrip().endswith(b"%%EOF")
    start = int(re.search(rb"startxref\n(\d+)", data)[1])
    assert data[start:].startswith(b"xref")
    places = [int(p) for p in re.findall(rb"(\d{10}) 00000 n", data)]
    assert all(data[p:].startswith(b"%d 0 obj" % i) for i, p in enumerate(places, 1))
    box = [float(v) for v in re.search(rb"/MediaBox \[(.*?)\]", data)[1].split()]
    assert box[2:] == pytest.approx([sheet.width * MM, sheet.height * MM], abs=1e-4)
    stream = re.search(rb"stream\n(.*?)\nendstream", data, re.DOTALL)
    assert int(re.search(rb"/Length (\d+)", data)[1]) == len(stream[1])
    lines = stream[1].decode().splitlines()
    scale = [float(v) for v in lines[0].split()[:6]]
    assert scale == pytest.approx([MM, 0, 0, -MM, 0, sheet.height * MM], rel=1e-5)
    polygons = [
        [[float(a), float(b)] for a, b in re.findall(r"(\S+) (\S+) [ml]", x)]
        for x in lines
        if x.endswith(" h")
    ]
    circles = []
    for line in lines:
        if " c f" in line:
            at = np.array([[float(v) for v in p] for p in re.findall(r"(\S+) (\S+) (?:m|c)", line)][:4])
            circles.append([*at[[0, 2]].mean(0), np.ptp(at[:, 0]) / 2])
    same_shapes(polygons, circles, sheet)


def test_bezier_discs_are_round():
    numbers = [float(v) for v in re.findall(r"-?\d+\.?\d*", pdf.disc(0.0, 0.0, 1.0))]
    points = [np.array(numbers[:2])]
    for k in range(4):
        a, b, c, d = points[-1], *np.array(numbers[2 + 6 * k : 8 + 6 * k]).reshape(3, 2)
        t = np.linspace(0, 1, 20)[:, None]
        curve = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t * t * (1 - t) * c + t**3 * d
        assert np.abs(np.linalg.norm(curve, axis=1) - 1).max() < 3e-4
        points.append(d)


@pytest.mark.parametrize("spec", SPECS)
def test_png_is_found_where_it_was_drawn(spec):
    """The loop closed: a print of 100 dpi is a picture of the target, each point at its millimetres."""
    target, sheet = targets.make(spec), sheet_of(spec)
    dpi = 400 if target.square < 5 else 100
    data = png.write(sheet, dpi)
    gray = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert gray.shape == (round(sheet.height * dpi / 25.4), round(sheet.width * dpi / 25.4))
    # as sharp as a print is, a corner is no picture of a corner
    found = target.find(cv2.GaussianBlur(gray, (0, 0), 1.0), seconds=20.0)
    assert isinstance(found, Detection) and len(found) == len(target.points)
    truth = (target.points[:, :2] + sheet.origin) * dpi / 25.4 - 0.5
    last = len(truth) - 1
    off = min(np.abs(found.uv - truth[ids]).max() for ids in (found.point_ids, last - found.point_ids))
    assert off < 0.1


def test_the_ticks_of_the_rulers_are_numbered_in_centimetres():
    sheet = sheet_of("checkerboard:9x6:25mm", "a4")
    texts = [text for text, _, _ in sheet.numbers]
    assert texts == [str(n) for n in range(1, 11)] * 2
    lower, left = sheet.numbers[:10], sheet.numbers[10:]
    ticks = [line for line in sheet.lines if abs(line[2] - line[0]) < 50 and abs(line[3] - line[1]) < 50]
    assert [x for _, x, _ in lower] == sorted(x for _, x, _ in lower)
    for (text, x, y), tick in zip(lower, ticks[1:11], strict=True):  # beside its tick, within its height
        assert x + DIGIT * NUMBER * len(text) < tick[0] and y <= tick[3]
    for (_, x, y), tick in zip(left, ticks[12:], strict=True):  # above its tick
        assert tick[0] < x and tick[1] - 1 < y < tick[1]
    assert min(x for _, x, _ in left) > UNPRINTED - 0.1
    for written in (svg.write(sheet).decode(), pdf.write(sheet).decode("latin-1")):
        assert all(f">{t}</text>" in written or f"({t}) Tj" in written for t in texts)
    black = np.minimum(png.draw(sheet, 150), 255)
    bare = png.draw(replace(sheet, numbers=()), 150)
    assert 20 * 30 < (black != bare).sum() < 20 * 200  # px of 20 numbers


def test_png_states_its_resolution():
    data = png.write(sheet_of("checkerboard:3x3:10mm"), 300)
    place = data.index(b"pHYs")
    assert struct.unpack(">IIB", data[place + 4 : place + 13]) == (11811, 11811, 1)  # 300 / 0.0254
    assert struct.unpack(">I", data[place + 13 : place + 17])[0] == zlib.crc32(data[place : place + 13])
    assert place < data.index(b"IDAT")


def test_pages():
    assert page_size("A4", 100, 50) == (297, 210) and page_size("a4", 50, 100) == (210, 297)
    assert page_size("300x200", 1, 1) == (300, 200)
    sheet = sheet_of("checkerboard:9x6:20mm", "A4")
    corners = np.concatenate(sheet.polygons)
    assert (sheet.width, sheet.height) == (297, 210)
    # what is printed is in the middle, with the ruler on the left
    assert abs(corners[:, 0].min() - (297 - corners[:, 0].max())) <= 6.5
    assert (corners > 0).all() and (corners < [297, 210]).all()
    for spec, page, said in (
        ("checkerboard:9x6:40mm", "A4", "needs 441 x 324 mm"),
        ("checkerboard:9x6", "own", "has no unit of length"),
        ("checkerboard:9x6:20mm", "A11", "unknown page 'A11'"),
    ):
        with pytest.raises(UsageError, match=said) as error:
            sheet_of(spec, page)
        assert error.value.hint
    with pytest.raises(UsageError, match="7705 megapixels; at most 200 can be drawn"):
        png.write(sheet_of("checkerboard:9x6:10cm"), 2400)


def test_units():
    widths = [
        sheet_of(f"checkerboard:4x3:{length}").width
        for length in ("25.4mm", "2.54cm", "0.0254m", "1in", "25400um")
    ]
    assert widths == pytest.approx([widths[0]] * 5)


def test_rulers_are_as_long_as_they_say():
    sheet = sheet_of("checkerboard:9x6:25mm")
    a, b, c, d = sheet.lines[0]
    assert b == d and c - a == pytest.approx(100.0) and "Both rulers are 100 mm" in sheet.caption
    a, b, c, d = sheet.lines[12]
    assert a == c and d - b == pytest.approx(100.0)
    small = sheet_of("checkerboard:5x3:10mm")
    across, down = small.lines[0], small.lines[2 + round((small.lines[0][2] - small.lines[0][0]) / 10)]
    for line, axis in ((across, 0), (down, 1)):
        length = line[2 + axis] - line[axis]
        assert f"{length:g} mm" in small.instructions[1] and length < (small.width, small.height)[axis]


@pytest.mark.parametrize(
    ("spec", "page"),
    [
        ("checkerboard:9x6:26mm", "a3"),
        ("checkerboard:9x6:25mm", "a4"),  # the board of which most people have a print
        ("checkerboard:6x9:23mm", "a4"),
        ("checkerboard:8x6:25.8mm", "letter"),  # too high for A4, and short enough
        ("charuco:5x7:30mm:22mm:4X4_50", "a4"),
        ("aprilgrid:6x6:88mm:0.3", "a0"),
        ("checkerboard:9x6:20cm", "own"),
    ],
)
def test_the_paper_that_fits(spec, page):
    sheet = sheet_of(spec, "auto")
    assert sheet.page == page
    assert sheet.width < sheet.height if spec.startswith(("checkerboard:6x9", "charuco")) else True


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("page", ["own", "auto", "a2"])
def test_nothing_is_printed_at_the_edge(spec, page):
    sheet = sheet_of(spec, page)
    size = np.array([sheet.width, sheet.height])
    discs = [sheet.circles[:, :2] + sign * sheet.circles[:, 2:] for sign in (-1, 1)]
    target = np.concatenate([*sheet.polygons, *discs])
    rulers = np.array(sheet.lines)
    black = np.concatenate([target, rulers.reshape(-1, 2), [sheet.caption_at]])
    assert (black >= UNPRINTED - 1e-9).all() and (black <= size - UNPRINTED + 1e-9).all()
    count = 2 + round((rulers[0, 2] - rulers[0, 0]) / 10)  # of lines of the lower ruler
    assert rulers[:count, 1].min() > target[:, 1].max() + 4  # clear of the target
    assert rulers[count:, 2].max() < target[:, 0].min() - 4


@pytest.mark.parametrize("ending", ["svg", "pdf", "png"])
def test_command(ending, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["board", "charuco:5x4:30mm:20mm:4X4_50", "-o", f"b.{ending}", "-q"]
    assert run([*words, "--dpi", "100"]) == 0
    assert run(words) == 2  # it exists
    text = (tmp_path / "b.yaml").read_text()
    assert yaml.safe_load(text) == {"target": "charuco:5x4:30mm:20mm:4X4_50"}
    for word in ("100 %", "Measure both rulers", "Glue the sheet", "pictures"):
        assert word in text
        if ending == "pdf":
            assert word.split()[0].encode() in (tmp_path / "b.pdf").read_bytes()
    assert run([*words, "--force", "--page", "A4"]) == 0
    assert run([*words[:-2], "b.txt"]) == 2


def test_a_negative_is_not_printed():
    with pytest.raises(UsageError, match="exchanged cannot be printed"):
        sheet_of("circles:9x7:20mm:negative")


@pytest.mark.parametrize(("more", "pages"), [(0.0, 2), (-1.0, 1)])
def test_the_page_of_instructions(more, pages):
    """A narrow sheet has none."""
    made = replace(sheet_of("checkerboard:9x6:10mm"), width=pdf.SMALLEST_PAGE + more)
    assert b"/Count %d " % pages in pdf.write(made)


def test_the_largest_png(monkeypatch):
    made = replace(sheet_of("checkerboard:4x3:10mm"), width=1000.0, height=500.0)
    with pytest.raises(UsageError, match="megapixels"):
        png.draw(made, 1.001 * 25.4 * np.sqrt(png.MOST_PIXELS / 5e5))
    made = sheet_of("checkerboard:4x3:10mm")
    pixels = round(made.width) * round(made.height)
    for most, drawn in ((pixels, True), (pixels - 1, False)):
        monkeypatch.setattr(png, "MOST_PIXELS", most)
        if drawn:
            assert png.draw(made, 25.4).size == pixels
        else:
            with pytest.raises(UsageError, match="megapixels"):
                png.draw(made, 25.4)


@pytest.mark.parametrize(
    ("side", "white"), [(0.99, sheet.GAP), (1.01, 1.01 * sheet.GAP)], ids=["small squares", "large squares"]
)
def test_the_white_between_a_target_and_its_rulers(side, white):
    """A part of its quiet margin, half a square, and at least some mm."""
    square = side * sheet.GAP / (0.5 * sheet.CLEAR)
    made = sheet_of(f"checkerboard:5x4:{square}mm")
    black = min(polygon[:, 0].min() for polygon in made.polygons)
    ruler = max(end for end in np.array(made.lines)[:, 2] if end < black)
    assert black - ruler == pytest.approx(white, abs=1e-6)


def test_a_caption_that_is_too_long():
    """It has to fit on the page with the words about the rulers; otherwise it is the spec alone."""
    target = targets.make("checkerboard:9x6:10mm")
    usual = lay_out(target, "", "a4")
    assert "print at 100 %" in usual.caption
    letters = int((usual.width - UNPRINTED - usual.caption_at[0]) / sheet.LETTER) - len(usual.caption)
    for more in (0, 1):
        spec = "x" * (letters + more)
        assert lay_out(target, spec, "a4").caption == spec + usual.caption * (more == 0)
