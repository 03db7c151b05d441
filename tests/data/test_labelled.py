"""Tables of names and numbers, and files of DLT coefficients."""

import numpy as np
import pytest

from camcal.data.dlt_table import dlt_text, looks_like_dlt, read_dlt
from camcal.data.labelled import read_labelled
from camcal.errors import DataError


def written(tmp_path, text):
    path = tmp_path / "t.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "camera,point,u,v\nleft,a,1.5,2\nright,a,3,4\n",
        "cam; marker; x; y\nleft;a;1,5;2\nright;a;3;4\n",
        "# made by hand\npoint\tcamera\tv\tu\tnote\na\tleft\t2\t1.5\tx\na\tright\t4\t3\tx\n",
        "camera point u v\nleft a 1.5 2\n\nright a 3 4\n",
    ],
)
def test_names_and_numbers(tmp_path, text):
    table = read_labelled(written(tmp_path, text), ("camera", "point"))
    assert table.names["camera"] == ("left", "right")
    assert table.labels["camera"].tolist() == [0, 1]
    assert table.labels["point"].tolist() == [0, 0]
    np.testing.assert_array_equal(table.uv, [[1.5, 2], [3, 4]])


@pytest.mark.parametrize(
    "text, said",
    [
        ("camera,point,u\n1,1,2\n", "lacks v"),
        ("camera,point,u,v,x\n1,1,2,3,4\n", "two columns mean u"),
        ("camera,point,u,v\n1,1,2\n", "3 fields found; 4"),
        ("camera,point,u,v\n1,1,2,abc\n", "'abc' is not a number"),
        ("camera,point,u,v\n1,1,2,nan\n", "finite number"),
        ("camera,point,u,v\n", "no rows"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, said):
    with pytest.raises(DataError, match=said):
        read_labelled(written(tmp_path, text), ("camera", "point"))


def test_sigma_must_be_positive(tmp_path):
    path = written(tmp_path, "camera,point,u,v,sigma\n1,1,2,3,0\n")
    with pytest.raises(DataError, match="above 0"):
        read_labelled(path, ("camera", "point"), optional=("sigma",))
    assert "sigma" not in read_labelled(path, ("camera", "point")).values


def test_dlt_coefficients_come_back_to_the_last_bit(tmp_path):
    matrices = np.random.default_rng(1).normal(0, 1, (3, 3, 4))
    matrices[:, 2, 3] = 1
    again = read_dlt(written(tmp_path, dlt_text(matrices)))
    np.testing.assert_array_equal(again, matrices)
    np.testing.assert_allclose(read_dlt(written(tmp_path, dlt_text(-2 * matrices))), matrices, rtol=1e-15)


def test_what_is_no_dlt_file_is_refused(tmp_path):
    assert not looks_like_dlt("a,b\n" * 11)
    with pytest.raises(DataError, match="10 rows"):
        read_dlt(written(tmp_path, "1,2\n" * 10))
    good = dlt_text([np.c_[np.eye(3), np.ones(3)]] * 2).splitlines()
    for rows, said in (
        (["left,right", *good], r"header \(left, right\)"),
        ([*good[:4], "x,1", *good[5:]], "row 5 holds 'x'"),
        ([*good[:4], "1", *good[5:]], "row 5 holds 1 numbers, the first 2"),
        (["0,0"] * 11, "column 1: the coefficients do not describe a camera"),
    ):
        with pytest.raises(DataError, match=said):
            read_dlt(written(tmp_path, "\n".join(rows)))
    matrix = np.eye(3, 4)
    with pytest.raises(DataError, match="m34"):
        dlt_text([matrix])
