"""Tables of robot poses: columns, forms of rotations, names of views, streams."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from camcal.data.robot_poses import COLUMNS, Stream, matched, read_robot_poses
from camcal.data.rotation_forms import FORMS, VENDORS, candidates, form_of
from camcal.errors import DataError, UsageError
from camcal.geometry import rotations as so3
from camcal.model.pose import Poses
from camcal.settings.hand_eye import ROTATIONS

#: scipy writes turns about moving axes in capitals, about fixed ones in small letters
SCIPY = {"zyx": "ZYX", "xyz": "XYZ", "zyz": "ZYZ", "fixed-xyz": "xyz"}


def test_the_option_knows_every_form():
    assert set(ROTATIONS) == {*FORMS, *VENDORS} and {VENDORS[v] for v in VENDORS} <= set(FORMS)
    assert set(COLUMNS.values()) <= set(FORMS)


@given(st.sampled_from([f for f in FORMS if FORMS[f].kind == "angles"]), st.integers(0, 10**6))
def test_angles_are_those_of_scipy(name, seed):
    numbers = np.random.default_rng(seed).uniform(-3, 3, (4, 3))
    degrees = name.endswith("deg")
    theirs = Rotation.from_euler(SCIPY[name.rpartition("-")[0]], numbers, degrees=degrees).as_matrix()
    np.testing.assert_allclose(FORMS[name].rotations(numbers), theirs, atol=1e-12)


@pytest.mark.parametrize(
    "vendor, numbers, x_axis",
    [
        ("kuka", (90, 0, 0), (0, 1, 0)),  # A about z
        ("fanuc", (0, 0, 90), (0, 1, 0)),  # R about z, last
        ("abb", (np.sqrt(0.5), 0, 0, np.sqrt(0.5)), (0, 1, 0)),  # q1 is the scalar
        ("ur", (0, 0, np.pi / 2), (0, 1, 0)),
        ("staubli", (90, 0, 90), (0, 0, 1)),  # Rx, then Rz about the moved z
        ("yaskawa", (90, 0, 90), (0, 1, 0)),  # the same numbers about fixed axes
        ("kawasaki", (90, 0, 0), (0, 1, 0)),
    ],
)
def test_makers_of_robots(vendor, numbers, x_axis):
    turned = form_of(vendor).rotations(np.array([numbers]))[0] @ [1, 0, 0]
    np.testing.assert_allclose(turned, x_axis, atol=1e-12)


def test_forms_of_as_many_numbers():
    assert [f.count for f in candidates(4)] == [4] * 24  # every order of the four numbers
    assert candidates(3, "zyx-deg")[0].name == "zyx-deg"


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "header, form, certain",
    [
        ("view,x,y,z,rx,ry,rz", "vector", False),
        ("image;X [mm];Y [mm];Z [mm];A;B;C", "zyx-deg", False),
        ("view,x,y,z,w,p,r", "fixed-xyz-deg", False),
        ("view,tx,ty,tz,yaw,pitch,roll", "zyx-deg", False),
        ("view,x,y,z,o,a,t", "zyz-deg", False),
    ],
)
def test_columns_say_the_form(tmp_path, header, form, certain):
    separator = ";" if ";" in header else ","
    path = write(
        tmp_path / "p.csv", header + "\n" + separator.join(["a.png", *"123", "0.1", "0.2", "0.3"]) + "\n"
    )
    found = read_robot_poses(path)
    assert (found.form.name, found.certain, found.names) == (form, certain, ("a.png",))
    np.testing.assert_array_equal(found.places, [[1, 2, 3]])


@pytest.mark.parametrize("names", ["qx,qy,qz,qw", "qw,qx,qy,qz"])
def test_named_quaternions_in_any_order(tmp_path, names):
    values = {"qx": 0.5, "qy": -0.5, "qz": 0.5, "qw": 0.5}
    row = ",".join(str(values[n]) for n in names.split(","))
    found = read_robot_poses(write(tmp_path / "p.csv", f"view,x,y,z,{names}\nv,1,2,3,{row}\n"))
    theirs = Rotation.from_quat([0.5, -0.5, 0.5, 0.5]).as_matrix()
    assert found.certain
    np.testing.assert_allclose(found.poses().rotation[0], theirs, atol=1e-12)


def test_inverse_and_unit(tmp_path):
    path = write(tmp_path / "p.csv", "view,x,y,z,rx,ry,rz\nv,1,2,3,0.1,0.2,0.3\n")
    found = read_robot_poses(path, "ur").scaled(1000)
    both = found.poses()[0] @ found.poses(None, inverse=True)[0]
    np.testing.assert_allclose(both.matrix, np.eye(4), atol=1e-9)
    assert found.certain and found.places[0, 2] == 3000


@pytest.mark.parametrize(
    "text, error, said",
    [
        ("view,x,y,z\nv,1,2,3\n", DataError, "has no columns rx,ry,rz"),
        ("view,rx,ry,rz\nv,1,2,3\n", DataError, "has no columns x,y,z"),
        ("x,y,z,rx,ry,rz\n1,2,3,0,0,0\n", DataError, "no column view and no column time"),
        (
            "view,x,y,z,rx,ry,rz\nv,1,2,3,0,0,0\nv,1,2,3,0,0,0\n",
            DataError,
            "p.csv:3: the view 'v' has a pose already, in line 2",
        ),
        ("view,x,y,z,rx,ry,rz\nv,1,2,3,0,0,a\n", DataError, "'a' is not a number"),
        ("view,x,y,z,rx,ry,rz\nv,1,2,3,0,0,nan\n", DataError, "a finite number is needed"),
        ("view,x,y,z,q1,q2,q3,q4\nv,1,2,3,0.9,0.9,0,0\n", DataError, "length 1.273; 1 is needed"),
        (
            "time,x,y,z,rx,ry,rz\n1,1,2,3,0,0,0\n1,1,2,3,0,0,0\n",
            DataError,
            "p.csv:3: its time 1 is not after",
        ),
        ("view,x,y,z,rx,ry,rz\n", DataError, "holds no rows"),
    ],
)
def test_bad_tables(tmp_path, text, error, said):
    with pytest.raises(error, match=re.escape(said)) as caught:
        read_robot_poses(write(tmp_path / "p.csv", text))
    assert caught.value.hint


@pytest.mark.parametrize("length, good", [(0.996, True), (0.994, False)])
def test_quaternions_of_length_one(tmp_path, length, good):
    path = write(tmp_path / "p.csv", f"view,x,y,z,q1,q2,q3,q4\nv,1,2,3,{length},0,0,0\n")
    if good:
        assert len(read_robot_poses(path)) == 1
        return
    with pytest.raises(DataError, match=r"a quaternion of length 0\.994; 1 is needed"):
        read_robot_poses(path)


def test_a_form_of_other_numbers(tmp_path):
    path = write(tmp_path / "p.csv", "view,x,y,z,rx,ry,rz\nv,1,2,3,0,0,0\n")
    with pytest.raises(UsageError, match="3 numbers for a rotation; 'quaternion-wxyz' takes 4"):
        read_robot_poses(path, "abb")


@pytest.mark.parametrize(
    "poses, views, rows",
    [
        ("a b c", "c a", [2, 0]),
        ("in/a.png in/b.png", "b.png a.png", [1, 0]),
        ("a b", "folder/b.png folder/a.jpg", [1, 0]),
        ("a b", "c d", []),
    ],
)
def test_views_are_matched_by_name(tmp_path, poses, views, rows):
    lines = [f"{n},1,2,3,0,0,0" for n in poses.split()]
    found = read_robot_poses(write(tmp_path / "p.csv", "\n".join(["view,x,y,z,rx,ry,rz", *lines])))
    got = matched(found, views.split())
    assert got == (rows, list(range(len(rows))))


def test_stream_between_its_poses():
    turns = np.array([[0, 0, 0], [0, 0, 0.4], [0.3, 0, 0.4]])
    stream = Stream(
        np.array([0.0, 1, 3]), Poses(so3.exp(turns), np.array([[0, 0, 0], [2.0, 0, 0], [2, 4, 0]]))
    )
    at, speed = stream.at(np.array([0.25, 2.0]))
    np.testing.assert_allclose(at.translation, [[0.5, 0, 0], [2, 2, 0]])
    np.testing.assert_allclose(so3.log(at.rotation)[0], [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(speed[0], [0, 0, 0.4, 2, 0, 0], atol=1e-12)
    h = 1e-6
    later, _ = stream.at(np.array([0.25, 2.0]) + h)
    np.testing.assert_allclose(
        so3.log(later.rotation @ np.swapaxes(at.rotation, 1, 2)) / h, speed[:, :3], atol=1e-5
    )
    assert list(stream.covers(np.array([-0.1, 0, 3, 3.1]))) == [False, True, True, False]
