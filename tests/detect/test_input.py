"""Files as people have them: HEIC, raw mosaics, EXIF, odd endings, folders of folders, names that are not UTF-8."""

import os
import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.detect import decode
from camcal.detect.decode import UnreadableError, decode_gray
from camcal.detect.exif import Taken, read_exif
from camcal.detect.images import detect_images
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.mosaic import levels
from camcal.detect.pages import _Block, page_count
from camcal.detect.resample import read_pictures
from camcal.detect.sources import read_gray
from camcal.errors import DataError
from camcal.system.text import readable
from tests.detect import drawing

SIZE, SHAPE = (6, 5), (240, 200)
HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(range(256))


def board(i=0, shape=SHAPE, **look):
    h = drawing.homography(SIZE, (shape[0] / 2, shape[1] / 2), 24, turn=0.2 * i, tilt=0.5, about=float(i))
    return drawing.picture(h, SIZE, shape, **look)


def exif(camera="Pixel 9", maker="Google", focal=4.38, zoom=1.0, orientation=1, order=">"):
    """A JPEG's APP1 segment with what the reader asks for."""
    model, make = camera.encode() + b"\0", maker.encode() + b"\0"

    def entry(tag, kind, count, value):
        return struct.pack(order + "HHI", tag, kind, count) + value

    def place(at):
        return struct.pack(order + "I", at)

    main = 8 + 2 + 4 * 12 + 4
    nested = main + len(make) + len(model)
    values = nested + 2 + 2 * 12 + 4
    short = struct.pack(order + "HH", orientation, 0)
    ifd0 = [
        entry(0x010F, 2, len(make), place(main)),
        entry(0x0110, 2, len(model), place(main + len(make))),
        entry(0x0112, 3, 1, short),
        entry(0x8769, 4, 1, place(nested)),
    ]
    ifd1 = [entry(0x920A, 5, 1, place(values)), entry(0xA404, 5, 1, place(values + 8))]
    head = {">": b"MM\0*", "<": b"II*\0"}[order] + place(8)
    body = head + struct.pack(order + "H", 4) + b"".join(ifd0) + place(0) + make + model
    body += struct.pack(order + "H", 2) + b"".join(ifd1) + place(0)
    body += b"".join(struct.pack(order + "II", round(1000 * v), 1000) for v in (focal, zoom))
    segment = b"Exif\0\0" + body
    return b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment


def jpeg(gray, block=b""):
    data = cv2.imencode(".jpg", gray, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    return data[:2] + block + data[2:]


def test_exif_is_read_in_both_byte_orders():
    for order in "<>":
        found = read_exif(jpeg(board(), exif(order=order, orientation=6, zoom=2.0)))
        assert found == Taken("Google Pixel 9", 4.38, 2.0, 6)
    assert str(found) == "Google Pixel 9 at 4.38 mm zoomed 2 times"
    assert read_exif(jpeg(board(), exif("Canon EOS 5D", "Canon"))).camera == "Canon EOS 5D"
    assert read_exif(jpeg(board())) == Taken() == read_exif(b"")


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_damaged_exif_never_raises(data):
    block = bytearray(exif())
    for _ in range(data.draw(st.integers(1, 8))):
        block[data.draw(st.integers(4, len(block) - 1))] = data.draw(st.integers(0, 255))
    assert isinstance(read_exif(b"\xff\xd8" + bytes(block)[: data.draw(st.integers(0, len(block)))]), Taken)


def test_pictures_of_several_cameras_are_told_apart(tmp_path):
    for i in range(6):
        block = exif() if i < 4 else exif(focal=6.1) if i == 4 else exif("iPhone 15", "Apple")
        (tmp_path / f"{i}.jpg").write_bytes(jpeg(board(i), block))
    (tmp_path / "6.jpg").write_bytes(jpeg(board(6)))  # says nothing: taken along
    found = detect_images([tmp_path], cache=False, jobs=1)
    assert [v.id for v in found.views] == ["0.jpg", "1.jpg", "2.jpg", "3.jpg", "6.jpg"]
    reasons = {s.id: s.reason for s in found.skipped}
    assert "6.1 mm" in reasons["4.jpg"] and "Apple iPhone 15" in reasons["5.jpg"]
    assert all("calibrate each camera separately" in r for r in reasons.values())


def test_focal_lengths_on_both_sides_of_the_limit(tmp_path):
    for i, focal in enumerate((4.0, 4.0, 4.0, 4.016, 4.024)):
        (tmp_path / f"{i}.jpg").write_bytes(jpeg(board(i), exif(focal=focal)))
    assert [s.id for s in detect_images([tmp_path], cache=False, jobs=1).skipped] == ["4.jpg"]


def test_turned_telephone_pictures_are_used_as_the_sensor_saw_them(tmp_path):
    for i in range(3):
        (tmp_path / f"{i}.jpg").write_bytes(jpeg(board(i), exif(orientation=1 if i else 6)))
    cv2.imwrite(str(tmp_path / "3.png"), np.rot90(board(3)))
    events = {}
    found = detect_images([tmp_path], cache=False, jobs=1, on_event=lambda name, d: events.update({name: d}))
    assert len(found.views) == 3 and found.image_size == (240, 200)
    assert events["turned"] == {"count": 1, "of": 4}
    assert "a program rotated it" in found.skipped[0].reason


def test_heic_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pillow_heif", None)
    (tmp_path / "a.HEIC").write_bytes(HEIC)
    (tmp_path / "b.jpg").write_bytes(HEIC)
    with pytest.raises(DataError, match="no target was found in 2 pictures") as error:
        detect_images([tmp_path], cache=False)
    assert "HEIC" in error.value.hint and "convert it to JPEG" in error.value.hint
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"{i}.png"), board(i))
    skipped = detect_images([tmp_path], cache=False, jobs=1).skipped
    assert [s.id for s in skipped] == ["a.HEIC", "b.jpg"] and all("HEIC" in s.reason for s in skipped)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_heic_picture_is_read(tmp_path, orientation):
    """A file of the encoder of libheif, turned back to what the sensor saw; lossy, so that few grey levels are left."""
    heif = pytest.importorskip("pillow_heif")
    gray = board()
    rgb = np.repeat(gray[..., None], 3, 2)
    made = heif.from_bytes("RGB", rgb.shape[1::-1], rgb.tobytes())
    block = exif(orientation=orientation)[4:]
    try:
        made.save(tmp_path / "a.heic", quality=95, exif=block)
    except (OSError, RuntimeError, ValueError) as error:  # libheif may be built without an encoder
        pytest.skip(f"no HEIC encoder: {error}")
    data = (tmp_path / "a.heic").read_bytes()
    read = decode_gray(data)
    assert read.shape == gray.shape and read.dtype == np.uint8
    assert np.abs(read.astype(int) - gray).mean() < 2
    ((_, colour),) = read_pictures([tmp_path / "a.heic"], gray.shape[::-1])
    assert colour.shape == (*gray.shape, 3) and np.abs(colour.mean(2) - read).mean() < 2
    taken = read_exif(data)
    assert (taken.camera, taken.focal, taken.orientation) == ("Google Pixel 9", 4.38, orientation)
    assert len(detect_images([tmp_path], cache=False).views[0]) == 30


def test_heic_is_read_where_pillow_heif_is_installed(monkeypatch):
    class Installed:
        @staticmethod
        def open_heif(stream, convert_hdr_to_8bit):
            assert stream.read() == HEIC and convert_hdr_to_8bit is False
            return np.dstack([board()] * 3)

    monkeypatch.setattr(decode, "import_module", lambda name: Installed)
    assert (decode_gray(HEIC) == board()).all()
    monkeypatch.setattr(Installed, "open_heif", lambda *_, **__: 1 / 0)
    with pytest.raises(UnreadableError, match=r"pillow-heif cannot decode .*: convert it to JPEG or PNG"):
        decode_gray(HEIC)


def mosaic(gray, gains=((0.5, 1.0), (1.0, 0.7))):
    scale = np.tile(np.array(gains), (gray.shape[0] // 2, gray.shape[1] // 2))
    return np.rint(gray * scale).astype(gray.dtype)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_raw_mosaic_is_evened(tmp_path, bits):
    plain = [board(i).astype(np.uint16) * 200 if bits == 16 else board(i) for i in range(3)]
    for i, gray in enumerate(plain):
        cv2.imwrite(str(tmp_path / f"{i}.png"), mosaic(gray))
    found = detect_images([tmp_path], cache=False, jobs=1)
    assert len(found.views) == 3
    for i, view in enumerate(found.views):
        h = drawing.homography(SIZE, (120, 100), 24, turn=0.2 * i, tilt=0.5, about=float(i))
        truth = drawing.corners(SIZE, h)
        error = min(
            np.median(np.linalg.norm(view.uv - t, axis=1)) for t in (truth[view.point_ids], truth[::-1])
        )
        assert error < 0.05  # of the same pictures without a mosaic .02


def test_what_is_no_mosaic_is_left_alone():
    rng = np.random.default_rng(0)
    assert levels(board()) is None and levels(rng.integers(0, 256, (200, 300), np.uint8)) is None
    assert levels(mosaic(board(), ((0.95, 1.0), (1.0, 1.0)))) is None  # unequal by less than the limit
    assert levels(mosaic(board(), ((0.90, 1.0), (1.0, 1.0)))) is not None
    assert levels(np.zeros((200, 300), np.uint8)) is None and levels(board()[:20, :20]) is None


def test_odd_endings(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), board())
    (tmp_path / "a.png").rename(tmp_path / "scan")
    (tmp_path / "README").write_text("nothing")
    assert [p.name for p in list_pictures([tmp_path])] == ["scan"]
    (tmp_path / "b.jfif").write_bytes(jpeg(board()))
    assert [p.name for p in list_pictures([tmp_path])] == ["b.jfif"]
    raw = tmp_path / "raw"
    raw.mkdir()
    (raw / "x.NEF").write_bytes(b"II*\0")
    assert [p.name for p in list_pictures([raw])] == ["x.NEF"]
    with pytest.raises(UnreadableError, match="export it to TIFF"):
        read_gray(raw / "x.NEF")


def test_a_folder_of_folders(tmp_path):
    for name in ("left", "right", "empty"):
        (tmp_path / "both" / name).mkdir(parents=True)
    (tmp_path / "both" / "left" / "1.png").write_bytes(b"")
    with pytest.raises(DataError, match="itself contains no pictures") as error:
        list_pictures([tmp_path / "both"])
    assert str(tmp_path / "both" / "left") in error.value.hint
    (tmp_path / "both" / "right" / "1.png").write_bytes(b"")
    with pytest.raises(DataError, match="left, right") as error:
        list_pictures([tmp_path / "both"])
    assert "camcal rig left=" in error.value.hint and "empty" not in error.value.hint


def test_names_that_are_not_utf8(tmp_path):
    name = os.fsdecode(b"caf\xe9.png")
    assert readable(name) == "caf\\xe9.png" and readable("café") == "café"
    assert view_ids([tmp_path / name]) == ["caf\\xe9.png"]
    assert view_ids([tmp_path / "a" / name, tmp_path / "b" / name]) == [
        readable(str(tmp_path / k / name)) for k in "ab"
    ]


@pytest.fixture(params=[".png", ".webp"])
def animation(request, tmp_path):
    """An animation of three frames of one value each."""
    if not hasattr(cv2, "imdecodeanimation"):
        pytest.skip("this OpenCV reads no animations")
    made = cv2.Animation()
    made.frames = [np.full((40, 60, 4), (v, v, v, 255), np.uint8) for v in (20, 90, 160)]
    made.durations = np.full(3, 100, np.int32)
    path = tmp_path / f"a{request.param}"
    assert cv2.imwriteanimation(str(path), made, [cv2.IMWRITE_WEBP_QUALITY, 100])
    return path


def test_frames_of_an_animation_are_pages(animation, monkeypatch):
    pages = list_pictures([animation])
    assert [p.name for p in pages] == [f"{animation.name}#{n}" for n in range(3)]
    for block in (1 << 20, 1):  # all in one block, each in its own
        monkeypatch.setattr("camcal.detect.pages.BLOCK", block)
        monkeypatch.setattr("camcal.detect.pages._block", [_Block(b"", 0, ())])
        for order in (pages, pages[::-1]):
            values = {p: round(float(read_gray(p)[0].mean()), -1) for p in order}
            assert [values[p] for p in pages] == [20, 90, 160]
    (_, picture), (_, reason) = read_pictures([pages[1], animation.with_name(f"{animation.name}#3")])
    assert picture.shape[:2] == (40, 60) and round(float(picture[..., :3].mean()), -1) == 90
    assert str(reason) == "page 3 is damaged or missing"


def test_the_frames_of_a_png_file_are_counted_not_believed(tmp_path):
    def chunk(kind, body):
        return struct.pack(">I4s", len(body), kind) + body + struct.pack(">I", zlib.crc32(kind + body))

    control = chunk(b"fcTL", struct.pack(">5I2H2B", 0, 8, 8, 0, 0, 1, 10, 0, 0))
    start = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 8, 8, 0, 0, 0, 0))
    parts = [chunk(b"acTL", struct.pack(">II", 4_000_000_000, 0)), control, chunk(b"IDAT", b""), control]
    path = tmp_path / "claims.png"
    path.write_bytes(start + b"".join(parts) + chunk(b"IEND", b""))
    assert page_count(path) == 2
    path.write_bytes(
        start + b"".join(parts[2:]) + chunk(b"IEND", b"")
    )  # no animation: nothing says so before IDAT
    assert page_count(path) == 1
    path.write_bytes(start + b"".join(parts[:2]) + b"\0\0")  # cut off
    assert page_count(path) == 1
