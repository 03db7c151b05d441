import io
import os
import struct
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.detect import cache, decode
from camcal.detect.decode import UnreadableError, decode_gray
from camcal.detect.examine import Task, examine
from camcal.detect.images import detect_images
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.recognition import look as looking
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.errors import DataError, UsageError
from tests.detect import drawing
from tests.shared_data import DATA, needs_data


def board_picture(size=(6, 5), shape=(240, 200), **pose):
    h = drawing.homography(size, (shape[0] / 2, shape[1] / 2), **{"square": 22} | pose)
    return drawing.picture(h, size, shape)


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


@pytest.fixture(scope="module")
def encoded():
    gray = board_picture()
    colour = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    alpha = np.dstack([colour, np.full_like(gray, 255)])
    pictures = {
        "gray.png": gray, "colour.png": colour, "alpha.png": alpha, "deep.png": gray.astype(np.uint16) * 200,
        "gray.jpg": gray, "colour.jpg": colour, "gray.tif": gray, "deep.tif": gray.astype(np.uint16) * 200,
        "float.tif": gray.astype(np.float32) / 255, "gray.bmp": gray, "gray.pgm": gray, "colour.webp": colour,
    }  # fmt: skip
    return {name: cv2.imencode(Path(name).suffix, p)[1].tobytes() for name, p in pictures.items()}


@pytest.fixture
def folder(tmp_path):
    for i, turn in enumerate((0.0, 0.3, 0.6)):
        cv2.imwrite(str(tmp_path / f"img{9 + i}.png"), board_picture(turn=turn, tilt=0.3 * i))
    return tmp_path


# ------------------------------------------------------------------------------------------------ listing
def test_natural_order_and_only_pictures(folder):
    (folder / "notes.txt").write_text("x")
    (folder / ".hidden.png").write_bytes(b"x")
    assert [p.name for p in list_pictures([folder])] == ["img9.png", "img10.png", "img11.png"]
    assert len(list_pictures([folder, folder / "img9.png", str(folder / "*1*.png")])) == 3


def test_what_is_not_there_is_said(tmp_path):
    for path, found in (
        (tmp_path / "absent", "there is no file or folder"),
        (tmp_path / "absent.png", "there is no file or folder"),
        (tmp_path / "*.png", "no file matches"),
        (tmp_path, "holds no pictures; it is empty"),
    ):
        with pytest.raises(DataError, match=found) as error:
            list_pictures([path])
        assert error.value.exit_code == 3 and error.value.hint


def test_equal_names_are_told_apart():
    assert view_ids([Path("a/1.png"), Path("b/1.png"), Path("b/2.png")]) == ["a/1.png", "b/1.png", "2.png"]


# ------------------------------------------------------------------------------------------------ decoding
def test_every_kind_of_file_shows_the_same_board(encoded):
    for name, data in encoded.items():
        gray = decode_gray(data)
        assert gray.ndim == 2 and gray.dtype in (np.uint8, np.uint16), name
        assert len(Checkerboard(6, 5).find(gray)) == 30, name


def test_cmyk_jpeg():
    data = cmyk_jpeg()
    try:
        assert decode_gray(data).shape == (8, 8)
    except UnreadableError as error:  # a decoder without CMYK says so; it does not crash
        assert str(error)


def cmyk_jpeg():
    """A grey baseline JPEG whose headers are rewritten to four components with the same tables."""
    data = cv2.imencode(".jpg", np.full((8, 8), 128, np.uint8))[1].tobytes()
    at = data.index(b"\xff\xc0")
    frame = bytes([0xFF, 0xC0, 0, 20, 8, 0, 8, 0, 8, 4]) + b"".join(bytes([i, 0x11, 0]) for i in range(1, 5))
    length = struct.unpack(">H", data[at + 2 : at + 4])[0]
    data = data[:at] + frame + data[at + 2 + length :]
    at = data.index(b"\xff\xda")
    length = struct.unpack(">H", data[at + 2 : at + 4])[0]
    scan = bytes([0xFF, 0xDA, 0, 14, 4]) + b"".join(bytes([i, 0]) for i in range(1, 5)) + bytes([0, 63, 0])
    return data[:at] + scan + data[at + 2 + length : -2] * 4 + b"\xff\xd9"


def test_exif_orientation_is_ignored():
    gray = board_picture(shape=(240, 200))
    data = cv2.imencode(".jpg", gray)[1].tobytes()
    # orientation 6: a quarter turn
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    turned = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape[:2] == (240, 200)
    assert decode_gray(turned).shape == (200, 240)


def png_of(width, height):
    """A PNG file of a few bytes that claims to be of some size."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0"))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (b"", "empty"),
        (b"hello, this is no picture", "not a picture"),
        (png_of(100_000, 100_000), "more than"),
        (png_of(2**31 - 1, 2**31 - 1), "more than"),
        (b"\xff\xd8\xff\xe0", "truncated"),
        (b"P5 99999 99999 255\n", "more than"),
    ],
)
def test_unreadable_files_have_a_reason(data, word):
    with pytest.raises(UnreadableError, match=word):
        decode_gray(data)


def test_truncated_files_are_not_filled_with_grey(encoded):
    for name, word in (("gray.jpg", "truncated"), ("colour.jpg", "truncated"), ("gray.png", "truncated")):
        with pytest.raises(UnreadableError, match=word):
            decode_gray(encoded[name][: len(encoded[name]) * 2 // 3])


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_never_crash(encoded, data):
    """Cut, overwritten, wrongly named: a picture or a reason, nothing else."""
    name = data.draw(st.sampled_from(sorted(encoded)))
    content = bytearray(encoded[name])
    for _ in range(data.draw(st.integers(0, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))]
    try:
        assert decode_gray(bytes(content)).ndim == 2
    except UnreadableError as error:
        assert str(error)


def test_one_pixel_and_tiny_pictures_are_read_but_hold_no_board(tmp_path):
    for shape in ((1, 1), (2, 300), (15, 15)):
        cv2.imwrite(str(tmp_path / "a.png"), np.zeros(shape, np.uint8))
        outcome = examine(Task(tmp_path / "a.png", None, 1.0, None))
        assert outcome.status == "not_found" and outcome.code == "too-small"


# ------------------------------------------------------------------------------------------------ detection
def test_the_size_of_the_board_is_found(folder):
    events = []
    found = detect_images([folder], on_event=lambda *event: events.append(event))
    assert [v.id for v in found.views] == ["img9.png", "img10.png", "img11.png"]
    assert found.image_size == (240, 200)
    assert found.target == {
        "kind": "checkerboard", "columns": 6, "rows": 5, "square": 1.0, "unit": "square", "detected": True,
    }  # fmt: skip
    assert all(len(v) == 30 and v.sigma is not None for v in found.views)
    assert {f["path"] for f in found.files} == {str(folder / f"img{i}.png") for i in (9, 10, 11)}
    assert all(len(f["sha256"]) == 64 for f in found.files)
    assert set(found.picture_quality) == {v.id for v in found.views}
    assert [name for name, _ in events] == ["pictures", *["searched"] * 3, "target", *["picture"] * 3]


def test_a_board_that_two_pictures_agree_on_is_not_searched_for_markers(tmp_path, monkeypatch):
    for i in range(6):
        gray = board_picture(turn=0.1 * i)
        cv2.imwrite(str(tmp_path / f"{i}.png"), gray if i < 5 else np.full_like(gray, 90))
    asked = []
    monkeypatch.setattr(looking, "read_markers", lambda *a, **k: asked.append(1) or (None, []))
    found = detect_images([tmp_path], jobs=1, cache=False)
    assert len(found.views) == 5
    assert (
        len(asked) == 2 + 2 * 3
    )  # two to agree; one without the board, in three ways, each with a second look


def test_board_and_square_are_taken(folder):
    found = detect_images([folder], board="6x5", square="25mm")
    assert (found.target["square"], found.target["unit"], found.target["detected"]) == (25.0, "mm", False)
    assert found.views[0].xyz.max() == 125.0
    same = detect_images([folder], target="checkerboard:6x5:25mm")
    assert (same.views[0].xyz == found.views[0].xyz).all()
    with pytest.raises(UsageError, match="a target and a board"):
        detect_images([folder], target="checkerboard:6x5:25mm", board="6x5")


def test_each_picture_that_cannot_be_used_has_its_reason(folder):
    (folder / "a_empty.png").write_bytes(b"")
    (folder / "b_text.jpg").write_text("no picture")
    cv2.imwrite(str(folder / "c_dark.png"), np.zeros((200, 240), np.uint8))
    cv2.imwrite(str(folder / "d_other.png"), board_picture(shape=(250, 200)))
    cv2.imwrite(str(folder / "e_board.png"), board_picture((4, 4)))
    found = detect_images([folder])
    skipped = {s.id: s for s in found.skipped}
    assert len(found.views) == 3
    assert skipped["a_empty.png"].status == skipped["b_text.jpg"].status == "unreadable"
    assert skipped["c_dark.png"].status == "not_found" and "dark" in skipped["c_dark.png"].reason
    assert skipped["d_other.png"].status == "rejected" and "250x200" in skipped["d_other.png"].reason
    assert "4x4" in skipped["e_board.png"].reason


def test_the_error_names_the_board_that_is_there(folder):
    with pytest.raises(DataError, match="no 9x6 checkerboard was found in") as error:
        detect_images([folder], board="9x6")
    assert error.value.exit_code == 3 and "--board 6x5" in error.value.hint


def test_nothing_found(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((200, 240), np.uint8))
    with pytest.raises(DataError, match="no target was found in 1 picture") as error:
        detect_images([tmp_path])
    assert "dark" in error.value.hint


# ------------------------------------------------------------------------------------------------ cache
def test_a_second_run_detects_nothing(folder, monkeypatch):
    first = detect_images([folder], board="6x5")
    monkeypatch.setattr(Checkerboard, "find", lambda *_: pytest.fail("searched again"))
    events = []
    second = detect_images([folder], board="6x5", on_event=lambda *event: events.append(event))
    for a, b in zip(first.views, second.views, strict=True):
        assert (a.uv == b.uv).all() and (a.sigma == b.sigma).all() and (a.point_ids == b.point_ids).all()
    assert first.picture_quality == second.picture_quality
    assert all(details["cached"] for name, details in events if name == "picture")


def test_other_options_are_other_entries(folder, own_cache):
    detect_images([folder], board="6x5")
    entries = set(own_cache.rglob("*.npz"))
    detect_images([folder], board="6x5", seconds=2.0)
    assert len(set(own_cache.rglob("*.npz")) - entries) == 3
    detect_images([folder], board="6x5", cache=False, seconds=3.0)
    assert len(set(own_cache.rglob("*.npz"))) == 6


def test_an_entry_belongs_to_the_code_that_made_it(folder, own_cache, monkeypatch):
    detect_images([folder], board="6x5", jobs=1)
    entries = set(own_cache.rglob("*.npz"))
    monkeypatch.setattr(cache, "code", lambda: "of another version")
    detect_images([folder], board="6x5", jobs=1)
    assert len(set(own_cache.rglob("*.npz")) - entries) == 3


@pytest.mark.parametrize("damage", [b"", b"nonsense", None])
def test_a_damaged_entry_is_ignored_and_rewritten(folder, own_cache, damage):
    first = detect_images([folder], board="6x5")
    entries = sorted(own_cache.rglob("*.npz"))
    whole = [e.read_bytes() for e in entries]
    for e, content in zip(entries, whole, strict=True):
        e.write_bytes(content[: len(content) // 2] if damage is None else damage)
    second = detect_images([folder], board="6x5")
    assert all((a.uv == b.uv).all() for a, b in zip(first.views, second.views, strict=True))
    assert all(cache.load(e) is not None for e in entries)


def test_an_entry_of_something_else_is_ignored(tmp_path):
    path = tmp_path / "x.npz"
    assert cache.store(path, {"uv": np.zeros((2, 2))}, {"status": "found"}) is None
    from camcal.detect.examine import _from_cache

    assert _from_cache(path, path, "") is None


def test_entries_used_longest_ago_are_removed_beyond_the_limit(tmp_path):
    paths = [cache.entry(tmp_path, f"{k:02d}" * 32, "x") for k in range(10)]
    for age, path in enumerate(paths):
        cache.store(path, {"uv": np.zeros((100, 2))}, {})
        os.utime(path, (1e9 - age, 1e9 - age))
    size = paths[0].stat().st_size
    assert cache.prune(tmp_path, 10 * size) == 0
    assert cache.load(paths[9]) is not None  # used: the oldest no longer
    assert cache.prune(tmp_path, 10 * size - 1) == 2 and not paths[8].exists()  # below .9 of the limit
    assert cache.prune(tmp_path, 5 * size) == 4
    assert [p.exists() for p in paths] == [True] * 3 + [False] * 6 + [True]


def test_the_size_of_the_cache_is_looked_at_once_a_day(tmp_path, monkeypatch):
    looks = []
    monkeypatch.setattr(cache, "prune", looks.append)
    monkeypatch.setattr(cache, "_used", [None])
    cache.use(tmp_path / "none")  # nothing is kept yet
    cache.use(tmp_path)
    cache.use(tmp_path)
    assert looks == [tmp_path]
    yesterday = time.time() - cache.INTERVAL - 1
    os.utime(tmp_path / cache.PRUNED, (yesterday, yesterday))
    cache.use(tmp_path)
    assert len(looks) == 2


def test_an_unwritable_cache_is_said_once(folder, monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    events = []
    assert len(detect_images([folder], board="6x5", on_event=lambda *e: events.append(e)).views) == 3
    assert [name for name, _ in events].count("cache") == 1


def test_pickled_entries_are_not_loaded(tmp_path):
    buffer = io.BytesIO()
    np.savez(buffer, values=np.array({"a": 1}, dtype=object))
    (tmp_path / "x.npz").write_bytes(buffer.getvalue())
    assert cache.load(tmp_path / "x.npz") is None


def test_limit_of_pixels_is_above_every_camera():
    assert decode.MOST_PIXELS > 150e6


# ------------------------------------------------------------------------------ real pictures
@needs_data
def test_three_real_pictures_of_another_size():
    names = [DATA / "udacity" / f"calibration{i}.jpg" for i in (2, 7, 10)]
    found = detect_images(names, seconds=10.0)
    assert [v.id for v in found.views] == ["calibration2.jpg", "calibration10.jpg"]
    assert "1281x721" in found.skipped[0].reason and (found.target["columns"], found.target["rows"]) == (9, 6)


@needs_data
def test_a_part_that_all_pictures_show_is_enough():
    """Its right side leaves all three pictures: 7x6 corners are common to them."""
    events = {}
    found = detect_images(
        [DATA / "cut_off_board"], seconds=10.0, on_event=lambda name, details: events.update({name: details})
    )
    assert len(found.views) == 3 and (found.target["columns"], found.target["rows"]) == (7, 6)
    assert events["target"]["whole"] is False
