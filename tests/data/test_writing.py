"""Writing: whole or not at all, never over another file unasked; points read back bit by bit."""

import csv
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.data.observations import Correspondences, View
from camcal.data.points import read_points
from camcal.data.table import LARGEST_VALUE
from camcal.data.writing import write_points
from camcal.errors import DataError, UsageError
from camcal.system import writing
from camcal.system.writing import atomic_write, check_writable


def names_in(folder):
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("content", ["a\nü\r\n", b"\0\xff"])
def test_what_is_written_is_there(tmp_path, content):
    atomic_write(tmp_path / "f", content)
    assert (tmp_path / "f").read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert names_in(tmp_path) == ["f"]


def test_no_file_is_overwritten_unasked(tmp_path):
    path = tmp_path / "f"
    path.write_text("mine")
    for refuse in (check_writable, lambda p: atomic_write(p, "new")):
        with pytest.raises(UsageError, match="exists already") as caught:
            refuse(path)
        assert "--force" in caught.value.hint
    assert path.read_text() == "mine"
    atomic_write(path, "new", force=True)
    assert path.read_text() == "new"


@pytest.mark.parametrize(
    ("name", "message"),
    [("", "it is a folder"), ("absent/f", "the folder '.*absent' does not exist"), ("file/f", "is a file")],
)
@pytest.mark.parametrize("force", [False, True])
def test_places_where_nothing_can_be_written(tmp_path, name, message, force):
    (tmp_path / "file").touch()
    for refuse in (check_writable, lambda p, f: atomic_write(p, "new", f)):
        with pytest.raises(UsageError, match=message) as caught:
            refuse(tmp_path / name, force)
        assert caught.value.exit_code == 2
        assert caught.value.hint
    assert names_in(tmp_path) == ["file"]


def test_read_only_places(tmp_path, monkeypatch):
    """Simulated, since the super-user may write everywhere."""
    monkeypatch.setattr(writing.os, "access", lambda path, mode: False)
    with pytest.raises(UsageError, match="is read-only"):
        check_writable(tmp_path / "f")


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_nothing_is_left_behind_where_writing_fails(tmp_path, monkeypatch, error):
    (tmp_path / "f").write_text("mine")

    def fail(*_):
        raise error

    monkeypatch.setattr(writing.os, "fsync", fail)
    said = "no space left on device.$" if isinstance(error, OSError) else "^$"
    with pytest.raises((DataError, KeyboardInterrupt), match=said):
        atomic_write(tmp_path / "f", "new", force=True)
    assert names_in(tmp_path) == ["f"]
    assert (tmp_path / "f").read_text() == "mine"


def test_permissions(tmp_path):
    path = tmp_path / "f"
    atomic_write(path, "a")
    (tmp_path / "plain").touch()
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)
    path.chmod(0o640)
    atomic_write(path, "b", force=True)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_symbolic_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_text("a")
    (tmp_path / "link").symlink_to("target")
    atomic_write(tmp_path / "link", "b", force=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "b"


def test_a_device_is_written_to():
    atomic_write(os.devnull, "gone")
    assert not Path(os.devnull).is_file()


# The names of views and numbers as they come; zero and its negative are the same point.
NUMBER = st.floats(-LARGEST_VALUE, LARGEST_VALUE)
NAME = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\n\0"), min_size=1, max_size=12)
NAMES = st.lists(NAME.filter(str.strip), min_size=1, max_size=4, unique=True)


@st.composite
def correspondences(draw):
    with_ids, with_sigma = draw(st.booleans()), draw(st.booleans())
    views = []
    for name in draw(NAMES):
        n = draw(st.integers(1, 4))
        xyz = draw(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=n, max_size=n, unique=True))
        uv = draw(st.lists(st.tuples(NUMBER, NUMBER), min_size=n, max_size=n))
        ids = draw(st.lists(st.integers(-(2**53), 2**53), min_size=n, max_size=n, unique=True))
        sigma = draw(st.lists(NUMBER.filter(lambda a: a > 0), min_size=n, max_size=n))
        views.append(
            View(
                name,
                np.array(xyz),
                np.array(uv),
                np.array(sigma) if with_sigma else None,
                np.array(ids) if with_ids else None,
            )
        )
    return Correspondences.from_views(views)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(c=correspondences())
def test_points_read_back_to_the_last_bit(tmp_path, c):
    path = tmp_path / "p.csv"
    write_points(path, c, force=True)
    check_same(read_points(path), c)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(c=correspondences(), separator=st.sampled_from([";", "\t", " ", " , ", ", "]), comma=st.booleans())
def test_points_read_back_whatever_separates_them(tmp_path, c, separator, comma):
    """The written file is taken apart by the csv module and put together again with other separators."""
    path = tmp_path / "p.csv"
    write_points(path, c, force=True)
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    lines = [separator.join(rows[0])]
    for name, *numbers in rows[1:]:
        if comma and separator in ";\t":
            numbers = [n.replace(".", ",") for n in numbers]
        lines.append(separator.join(['"' + name.replace('"', '""') + '"', *numbers]))
    path.write_text("# again\n\n" + "\n".join(lines), encoding="utf-8", newline="")
    check_same(read_points(path), c)


def check_same(found, wanted):
    assert [v.id for v in found.views] == [v.id for v in wanted.views]
    for a, b in zip(found.views, wanted.views, strict=True):
        for name in ("xyz", "uv", "sigma", "point_ids"):
            x, y = getattr(a, name), getattr(b, name)
            assert (x is None) == (y is None)
            if x is not None:
                assert x.dtype == y.dtype
                assert x.tobytes() == y.tobytes()


def test_the_written_form(tmp_path):
    xyz, uv = np.array([[0.1, 2, 0], [1, 2, 0]]), np.array([[1e-7, 3], [4, 5]])
    write_points(tmp_path / "p.csv", Correspondences.from_views([(xyz, uv)]))
    assert (tmp_path / "p.csv").read_text() == (
        "view,X,Y,Z,u,v\nview1,0.1,2.0,0.0,1e-07,3.0\nview1,1.0,2.0,0.0,4.0,5.0\n"
    )


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "a\rb", "a\0b"])
def test_names_that_no_table_can_hold(tmp_path, name):
    c = Correspondences.from_views([View(name, np.zeros((1, 3)), np.zeros((1, 2)))])
    with pytest.raises(UsageError, match="cannot be written to a CSV file"):
        write_points(tmp_path / "p.csv", c)
    assert not names_in(tmp_path)


def test_ids_of_some_views_only(tmp_path):
    a = View("a", np.zeros((1, 3)), np.zeros((1, 2)), point_ids=np.array([3]))
    b = View("b", np.zeros((1, 3)), np.zeros((1, 2)))
    with pytest.raises(UsageError, match="1 of 2 views have ids"):
        write_points(tmp_path / "p.csv", Correspondences.from_views([a, b]))
