"""Limits of files and of lists: how much of them is read, kept or shown, each just below and just above."""

import zlib
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from camcal.batch import fleet
from camcal.cli import batch, track
from camcal.data import layout, remap_files, table
from camcal.data.formats import foreign, lcp, lensfun, mat5, matfile
from camcal.data.points import read_points
from camcal.errors import DataError, UsageError
from camcal.study import compare_optimizers, render
from camcal.system import documents, text
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ MATLAB's files
class Node(dict):
    """A struct of HDF5."""

    @property
    def attrs(self):
        return {"MATLAB_class": b"struct"}


def test_structs_inside_each_other():
    most = matfile.DEEPEST
    for depth, read in ((most, True), (most + 1, False)):
        node = Node()
        found = matfile._hdf5_value(node, depth)
        assert (found is not None) == read


def test_cells_inside_each_other():
    flags = SimpleNamespace(
        numbers=lambda: np.array([mat5.LAST_NUMBER + 1]), next=lambda: (mat5.UTF8, b"name")
    )
    assert mat5._matrix(flags, mat5.DEEPEST) == ("name", None)
    with pytest.raises(ValueError, match="without a class"):
        mat5._matrix(flags, mat5.DEEPEST + 1)


def test_the_size_of_a_decompressed_variable(monkeypatch):
    elements = SimpleNamespace(order="<")
    content = b"\x0e\0\0\0\x08\0\0\0" + b"12345678"
    for size, read in ((len(content), True), (len(content) - 1, False)):
        monkeypatch.setattr(mat5, "LARGEST", size)
        packed = iter([(mat5.COMPRESSED, zlib.compress(content))])
        left = iter([True, False])
        elements.more, elements.next = lambda left=left: next(left), lambda packed=packed: next(packed)
        if read:
            assert list(mat5._variables(elements)) == [b"12345678"]
        else:
            with pytest.raises(ValueError, match="a variable has more than"):
                list(mat5._variables(elements))


# ------------------------------------------------------------------------------------ entries of a file
def test_entries_of_a_lens_profile(monkeypatch):
    monkeypatch.setattr(lcp, "_camera", lambda *_: None)
    for count in (lcp.MOST, lcp.MOST + 1):
        monkeypatch.setattr(lcp, "_entries", lambda _, n=count: [{}] * n)
        monkeypatch.setattr(lcp, "_values", dict)
        assert len(lcp._read(SimpleNamespace(root=None)).cameras) == lcp.MOST


def test_distortions_of_a_lens_database(monkeypatch):
    monkeypatch.setattr(lensfun, "_camera", lambda *_: None)
    monkeypatch.setattr(lensfun, "size_said", lambda _: None)
    for count in (lensfun.MOST, lensfun.MOST + 1):
        root = ElementTree.fromstring(f"<lensdatabase><lens>{'<distortion/>' * count}</lens></lensdatabase>")
        assert len(lensfun._read(SimpleNamespace(root=root)).cameras) == lensfun.MOST


def test_levels_of_a_document(tmp_path):
    deepest = documents.DEEPEST
    for depth, read in ((deepest, True), (deepest + 1, False)):
        nested = "[" * depth + "]" * depth
        if read:
            documents._check_events(nested, tmp_path, 9)
        else:
            with pytest.raises(DataError, match="nested more than"):
                documents._check_events(nested, tmp_path, 9)


def test_whole_numbers_that_are_ids():
    most = float(table.LARGEST_ID)
    assert table.is_id(np.array([most, -most, most + 2, 0.5, -most - 2])).tolist() == [
        True,
        True,
        False,
        False,
        False,
    ]


def test_rows_that_decide_what_columns_are(tmp_path):
    """Five columns are view X Y u v where the first is text in the first rows; a number there makes them X Y Z u v."""
    most = layout.SAMPLE_ROWS
    for row in (most, most - 1):
        path = tmp_path / f"{row}.csv"
        path.write_text("\n".join(f"{'7' if i == row else 'a'},{i},0,{100 + i},50" for i in range(most + 5)))
        if row == most:
            assert [v.id for v in read_points(path, image_size=(640, 480)).views] == ["a", "7"]
        else:
            with pytest.raises(DataError):
                read_points(path, image_size=(640, 480))


def test_pictures_of_a_map_for_ffmpeg():
    most = remap_files.OUTSIDE - 1
    u = np.zeros((2, 2))
    assert remap_files.pgm(u, u, u, (most, 9)).startswith(b"P5\n2 2\n65535\n")
    with pytest.raises(UsageError, match="65534"):
        remap_files.pgm(u, u, u, (most + 1, 9))


# ------------------------------------------------------------------------------------ inversions
def test_pixels_that_are_inverted(monkeypatch):
    """What is left after the last step decides."""
    target = np.zeros((1, 2))
    for share, found in ((LESS, True), (MORE, False)):
        off = np.array([[share * foreign.FOUND, 0.0]])
        calls = iter(range(1000))

        def forward(w, off=off, calls=calls):
            return np.where(next(calls) % 5 == 0, off, w)  # after four derivatives

        assert foreign.inverse(forward, target)[1][0] == found


def test_radii_that_are_inverted(monkeypatch):
    """Without steps the start is what is left: b r² off, at a radius of 1."""
    monkeypatch.setattr(lensfun, "STEPS", 0)
    for share, found in ((LESS, True), (MORE, False)):
        uv = np.array([[2.0, 0.0]])  # r (1 - c) + c r² - r at r = 2 is 2 c
        good = lensfun._rays(uv, (1.0, 1.0, 0.0, 0.0), 1.0, [0.0, 0.0, share * lensfun.FOUND / 2])[1]
        assert good[0] == found


# ------------------------------------------------------------------------------------ messages and lists
def test_values_in_messages():
    most = text.LONGEST_VALUE
    assert text.quoted("x" * most) == f"'{'x' * most}'" and text.quoted("x" * (most + 1)).endswith("...'")


def test_words_of_messages():
    most = text.LONGEST_WORD
    assert text.message("x" * most) == "x" * most and "..." in text.message("x" * (most + 1))


def test_messages_that_are_shortened():
    words = "abcdefghi " * (text.LONGEST_MESSAGE // 10)
    whole = words + "j" * 10
    assert text.message(whole[: text.LONGEST_MESSAGE]) == whole[: text.LONGEST_MESSAGE].strip()
    assert "..." in text.message(words + "j")


def test_jobs_that_are_named(capsys):
    for count, more in ((batch.NAMED, False), (batch.NAMED + 1, True)):
        batch._name_bad([{"name": f"job{i}", "reason": "bad", "outlier": None} for i in range(count)])
        said = capsys.readouterr().err
        assert said.count("job") == batch.NAMED and ("1 more in summary.csv" in said) == more


def test_changes_that_are_shown(capsys):
    log = track._ChangeLog()
    for _ in range(track.SHOWN):
        log(SimpleNamespace(message="moved"))
    assert "Further" not in capsys.readouterr().err
    log(SimpleNamespace(message="moved"))
    said = capsys.readouterr().err
    assert "Further changes" in said and "moved" not in said


# ------------------------------------------------------------------------------------ studies and fleets
def test_costs_that_are_one_minimum():
    for share, reached in ((LESS, 1), (MORE, 0)):
        run = SimpleNamespace(result=SimpleNamespace(converged=True, evaluations=1), seconds=1.0)
        found = compare_optimizers._summed_up([run], lambda _, s=share: s * compare_optimizers.SAME)
        assert found["reached"] == reached


def test_pixels_across_an_edge():
    least = render.UNMIXED
    part = np.array([LESS * least, MORE * least, 0.5, 1 - 2 * least, 1 - least / 2])
    assert render._mixed(part).tolist() == [False, True, True, True, False]


def test_equal_cameras_are_no_outliers():
    """The scatter of equal values is rounding: a value off by less than the limit times it is none."""
    count = 20
    limit = fleet.limit_for(1, count)
    for share, outliers in ((LESS, 0), (MORE, 1)):
        values = np.full(count, 1000.0)
        values[0] += share * limit * fleet.ROUNDING * 1000
        columns = {"fx": (np.arange(count), values, np.zeros(count))}
        group = SimpleNamespace(columns=columns, names=[str(i) for i in range(count)])
        assert (np.abs(fleet._control("", "fx", group, 1).z) > limit).sum() == outliers
