"""Tables with a column `camera`, and cameras put together and taken apart."""

import numpy as np
import pytest

from camcal.data.rig_table import RigViews, joined, of_camera, read_rig
from camcal.errors import DataError
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
