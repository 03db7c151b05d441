"""Files are read with a limit, and nothing but ordinary files."""

import os

import pytest

from camcal.errors import DataError
from camcal.system.documents import DEEPEST, MOST_ALIASES, parse_yaml
from camcal.system.reading import read_file, read_text


def refused(path, match, most=100):
    with pytest.raises(DataError, match=match) as caught:
        read_file(path, most)
    assert "\n" not in caught.value.message
    assert caught.value.hint


def test_the_limit(tmp_path):
    path = tmp_path / "f"
    path.write_bytes(b"x" * 100)
    assert len(read_file(path, 100)) == 100
    path.write_bytes(b"x" * 101)
    refused(path, "more than 100 bytes")


@pytest.mark.parametrize("name", ["zero", "pipe", "folder", "loop", "absent", "a\0b"])
def test_what_is_no_ordinary_file(tmp_path, name):
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    refused(tmp_path / name, "not a regular file|is a folder|there is no file|cannot read")


def test_text(tmp_path):
    path = tmp_path / "f"
    path.write_bytes(b"\xef\xbb\xbfa")
    assert read_text(path, 9) == "a"
    path.write_bytes(b"\xff")
    with pytest.raises(DataError, match="it is not text"):
        read_text(path, 9)


def test_depth_and_aliases():
    for depth, fine in ((DEEPEST, True), (DEEPEST + 1, False)):
        text = "[" * depth + "]" * depth
        if fine:
            parse_yaml(text, "f")
        else:
            with pytest.raises(DataError, match="nested more than"):
                parse_yaml(text, "f")
    once = "a: &x [1]\nb: [" + "*x, " * MOST_ALIASES + "]"
    assert len(parse_yaml(once, "f")["b"]) == MOST_ALIASES
    for text in (once[:-1] + "*x]", "a: &x [1]\nb: &y [*x, *x]\nc: *y"):
        with pytest.raises(DataError, match="contains aliases"):
            parse_yaml(text, "f")
    with pytest.raises(DataError, match="contains aliases"):
        parse_yaml("a: &x 1\nb: *x", "f", aliases=0)
