"""How much of a text says what it is: numbers just below and just above."""

from pathlib import Path

import pytest

from camcal.data.formats import pix4d, source, zhang
from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.system import documents


@pytest.mark.parametrize("views", [5, 99, 100, 1000, 1001])
def test_views_in_a_text_of_zhang(views):
    """Files of a hundred and more views are recognised too; of the lines beyond the limit nothing is needed."""
    view = "1 0 0\n0 1 0\n0 0 1\n0.5 0.5 9\n\n"
    text = "832.5 0.2 832.53 303.96 206.585\n\n-0.228601 0.190353\n\n" + views * view
    made = Source(Path("completecalibration.txt"), text.encode())
    assert zhang._sniff(made) and len(zhang._numbers(made)) == min(2 + 4 * views, zhang.MOST_ROWS)
    assert zhang._read(made).cameras[0].camera.values["fx"] == 832.5


@pytest.mark.parametrize(("at", "text"), [(source.HEAD - 1, False), (source.HEAD, True)])
def test_bytes_that_tell_a_text_from_binary_data(at, text):
    for control, encoded in ((b"\0", b""), (b"\x01", b"\xe9")):  # the second one in Latin-1
        data = encoded.ljust(at, b" ") + control + b" more"
        assert (Source(Path("a.txt"), data).text is not None) == text


def test_bytes_of_a_camera_file(tmp_path, monkeypatch):
    """A report of some millions of points is read, which has 45 bytes a point."""
    assert documents.LARGEST > 45 * 5_000_000
    path = tmp_path / "a.txt"
    path.write_bytes(b"#" * 100)
    for most, read in ((100, True), (99, False)):
        monkeypatch.setattr(source, "LARGEST", most)
        if read:
            assert len(Source(path).data) == 100
        else:
            with pytest.raises(DataError, match="more than 99 bytes"):
                Source(path)


@pytest.mark.parametrize(("more", "known"), [(0, True), (1, False)])
def test_the_head_of_a_pix4d_file(more, known):
    line = "camera model m = K [R|-Rt] X"
    text = "\n".rjust(pix4d.BEGINNING - len(line) + more, "#") + line
    assert pix4d._sniff(Source(Path("a.txt"), text.encode())) == known
