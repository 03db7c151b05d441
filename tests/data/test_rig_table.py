"""Tables with a column `camera`, and cameras put together and taken apart."""

import numpy as np
import pytest

from camcal.data.rig_table import RigViews, joined, of_camera, read_rig
from camcal.errors import DataError, UsageError
from tests.rigs import observed, truth, write_table


@pytest.fixture
def table(tmp_path):
    data, _ = observed(truth("ab"), instants=3)
    return write_table(tmp_path / "t.csv", data), data


def test_a_table_reads_back(table):
    path, data = table
    found = read_rig(path, {"a": (640, 480), "": (1, 1)})
    for name in ("xyz", "uv", "view", "camera", "point"):
        np.testing.assert_array_equal(getattr(found, name), getattr(data, name))
    assert found.cameras == ("a", "b") and found.image_sizes == ((640, 480), (1, 1))
    assert found.files[0]["path"] == str(path)


def test_a_lag_moves_the_views_of_its_camera():
    data, _ = observed(truth("ab"), instants=4)
    views = RigViews.of(data).shifted({"b": 1})
    assert views.instants["a"] == {v: v for v in "0123"}
    assert views.instants["b"] == {"0": "-1", "1": "0", "2": "1", "3": "2"}
    assert views.order == ("-1", "0", "1", "2", "3")
    late = RigViews.of(data).shifted({"b": -1})
    assert late.instants["b"]["3"] == "+4" and late.order == ("0", "1", "2", "3", "+4")
    assert RigViews.of(data).shifted({}).instants == RigViews.of(data).instants


@pytest.mark.parametrize("given", ["b", "b=x", "b=1.5", ("a=1", "c")])
def test_lags_that_are_none(given):
    from camcal.settings.rig import RigOptions

    assert RigOptions.resolve(lag=("a=1", "b=-2,c=0")).lag == {"a": 1, "b": -2, "c": 0}
    with pytest.raises(UsageError, match="whole number of frames"):
        RigOptions.resolve(lag=given)


def test_a_column_board_makes_views_of_each_board(tmp_path):
    rows = ["camera,view,board,X,Y,Z,u,v"]
    rows += [f"a,1,{b},{x},0,0,{x + 1},2" for b in ("p", "q") for x in (0, 30)]
    rows += ["b,1,q,0,0,0,1,1", "b,2,q,30,0,0,1,1"]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(rows) + "\n")
    found = read_rig(path)
    assert found.target == {"boards": ["p", "q"], "first_ids": [0, 2]}
    views = RigViews.of(found)
    assert views.boards == {"a": {"1 board p": 0, "1 board q": 1}, "b": {"1": 1, "2": 1}}
    assert views.instants["a"] == {"1 board p": "1", "1 board q": "1"} and views.order == ("1", "2")
    apart = views.apart((0, 1))
    assert apart.order == ("1 board p", "1 board q", "2 board p", "2 board q")
    assert apart.instants["b"] == {"1": "1 board q", "2": "2 board q"}
    whole = joined(views.parts, views.instants, views.order)
    assert [len(v) for v in whole.views] == [4, 1, 1] and not whole.pictures


def test_taken_apart_and_put_together(table):
    _, data = table
    views = RigViews.of(data)
    again = joined(views.parts, views.instants, views.order)
    for name in ("xyz", "uv", "view", "camera", "point"):
        np.testing.assert_array_equal(getattr(again, name), getattr(data, name))
    assert again.view_ids == data.view_ids and again.image_sizes == data.image_sizes


def test_a_camera_keeps_only_the_views_it_saw(table):
    _, data = table
    some = data.where(~((data.camera == 1) & (data.view == 1)))
    assert of_camera(some, "b").view_ids == ("0", "2")
    views = RigViews.of(some)
    assert joined(views.parts, views.instants, views.order).blocks.view.tolist() == [0, 1, 2, 0, 2]


def test_without_a_picture_the_instant_stays(table):
    _, data = table
    block = 3  # the first instant of b
    rest = data.without({block: "why"})
    assert len(rest) == 3 and len(rest.blocks) == 5
    (said,) = rest.skipped
    assert (said.camera, said.id, said.reason) == ("b", "0", "why")
    assert len(data.without({0: "why", 3: "why"})) == 2


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["a,0,0,0,0,1,1", "a,0,0,0,0,2,2", "b,0,0,0,0,1,1"], "twice"),
        (["a,0,0,0,0,1,1", "a,1,0,0,0,2,2"], "one camera"),
        (["a,0,0,0,0,1,x", "b,1,0,0,0,2,2"], "not a number"),
    ],
)
def test_what_is_refused(tmp_path, rows, said):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["camera,view,X,Y,Z,u,v", *rows]) + "\n")
    with pytest.raises(DataError, match=said):
        read_rig(path)
