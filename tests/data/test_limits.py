"""Limits of files of points, each just below and just above."""

import pytest

from camcal.data import archive, points
from camcal.data.point_files import deltille
from camcal.errors import DataError
from camcal.report import embedded
from tests.sides import LESS, MORE


@pytest.mark.parametrize(("depth", "found"), [(deltille.ABOVE, True), (deltille.ABOVE + 1, False)])
def test_folders_in_which_a_target_is_looked_for(tmp_path, depth, found):
    """The file's own folder is the first of them."""
    (tmp_path / "target.dsc").write_text("")
    folder = tmp_path.joinpath(*["x"] * (depth - 1))
    folder.mkdir(parents=True, exist_ok=True)
    assert (deltille._target(folder / "corners.orpc") is not None) == found


def test_bytes_that_say_what_a_text_is(tmp_path, monkeypatch):
    """The word that a reader looks for stands at the end of what is read, or beyond it."""

    class Reader:
        title = "points"

        @staticmethod
        def sniff(source):
            return (source.text or "").rstrip("\n").endswith("mark")

    monkeypatch.setattr(points, "load", lambda _: Reader)
    for size, known in ((points.HEAD, True), (points.HEAD + 1, False)):
        path = tmp_path / "points.txt"
        path.write_text("mark".rjust(size, "#"))
        assert bool(points._readers(path)) == known


def test_archives_that_are_read(tmp_path, monkeypatch):
    path = tmp_path / "points.npz"
    path.write_bytes(b"PK" + bytes(98))
    assert archive.LARGEST > archive.npz.LARGEST  # its arrays alone may have that size
    for most, message in ((100, "not a readable"), (99, "more than 99 bytes")):
        monkeypatch.setattr(archive, "LARGEST", most)
        with pytest.raises(DataError, match=message):
            archive.read_archive(str(path))


@pytest.mark.parametrize(("share", "message"), [(LESS, "damaged|truncated"), (MORE, "at most")])
def test_tables_of_reports_that_are_unpacked(share, message):
    columns = embedded.COLUMNS
    rows = int(share * embedded.LARGEST / embedded.BYTES / len(columns))
    kind = {"encoding": embedded.ENCODING, "dtype": "float64", "byteorder": "little"}
    data = embedded.Data(columns=list(columns), rows=rows, text="", **kind)
    with pytest.raises(DataError, match=message):
        embedded._table(data)
