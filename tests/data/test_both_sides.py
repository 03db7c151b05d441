"""Numbers that decide something in readers and tables, each just below and just above."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.data import blocks, columns, dlt_table, points, robot_poses, shape, table, table_checks
from camcal.data.formats import base, checks, colmap, foreign, literal, matlab, mrcal, terms
from camcal.data.observations import View
from camcal.data.point_files import written
from camcal.data.robot_poses import read_robot_poses
from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.pose import Pose
from tests.sides import LESS, MORE


# ------------------------------------------------------------------------------------ cameras
def test_the_widest_image():
    assert base.image_size(base.WIDEST - 1, 1) == (base.WIDEST - 1, 1)
    for size in ((base.WIDEST, 1), (1, 0), (640.5, 480)):
        with pytest.raises(ValueError, match="an image of"):
            base.image_size(*size)


def test_a_rotation_of_few_digits():
    """A scale of 1 + e puts R Rᵀ by 2 e from the identity."""
    turn = rotations.exp(np.array([0.3, -0.2, 0.5]))
    for share, fits in ((0.99, True), (1.01, False)):
        matrix = turn * np.sqrt(1 + share * checks.ROTATION)
        if fits:
            mended = checks.rigid(Pose(matrix, np.zeros(3)), "a").rotation
            np.testing.assert_allclose(mended @ mended.T, np.eye(3), atol=1e-15)
        else:
            with pytest.raises(DataError, match="is not a rotation"):
                checks.rigid(Pose(matrix, np.zeros(3)), "a")
    with pytest.raises(DataError, match="is not a rotation"):
        checks.rigid(Pose(np.diag([1.0, 1, -1]), np.zeros(3)), "a")


def test_an_exact_rotation_stays_as_it_is():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert (checks.rigid(Pose(quarter, np.zeros(3)), "a").rotation == quarter).all()
    off = quarter * (1 + 2 * checks.ROUNDING)
    assert (checks.rigid(Pose(off, np.zeros(3)), "a").rotation != off).any()


@pytest.mark.parametrize("share", [LESS, MORE])
def test_the_depth_of_the_origin(share):
    matrix = np.array([[900.0, 0, 400, 1], [0, 900, 300, 1], [0, 0, 1, share * dlt_table.NO_DEPTH]])
    if share > 1:
        assert len(dlt_table.dlt_text([matrix]).splitlines()) == dlt_table.ROWS
    else:
        with pytest.raises(DataError, match="the eleven coefficients need m34 = 1"):
            dlt_table.dlt_text([matrix])


@pytest.mark.parametrize(
    ("count", "known"), [(1, True), (colmap.MOST_CAMERAS - 1, True), (colmap.MOST_CAMERAS, False), (0, False)]
)
def test_the_head_of_a_binary_file_of_colmap(count, known):
    data = struct.pack("<Qii", count, 1, 1) + bytes(40)
    assert colmap._sniff(SimpleNamespace(kind="binary", data=data)) == known
    assert not colmap._sniff(SimpleNamespace(kind="binary", data=data[:-1]))


@pytest.mark.parametrize(
    "knots", [mrcal.LEAST_KNOTS - 1, mrcal.LEAST_KNOTS, mrcal.MOST_KNOTS, mrcal.MOST_KNOTS + 1]
)
def test_the_knots_of_a_splined_model(knots):
    name = f"SPLINED_STEREOGRAPHIC_order=3_Nx={knots}_Ny=10_fov_x_deg=150"
    found = mrcal.SPLINED.fullmatch(name)
    matrix = np.array([500.0, 500, 320, 240, 0])
    if mrcal.LEAST_KNOTS <= knots <= mrcal.MOST_KNOTS:
        assert mrcal._splined(name, found, matrix, np.zeros(2 * knots * 10), (640, 480)) is not None
    else:
        with pytest.raises(ValueError, match="the configuration of"):
            mrcal._splined(name, found, matrix, np.zeros(2 * knots * 10), (640, 480))


def test_structs_inside_each_other():
    camera = SimpleNamespace(FocalLength=np.ones(2))
    assert matlab._is_camera(camera)
    for depth, found in ((matlab.DEEPEST + 1, True), (matlab.DEEPEST + 2, False)):
        value = camera
        for _ in range(depth):
            value = SimpleNamespace(inner=value)
        assert (matlab._find(value) is camera) == found


def test_models_that_a_message_names():
    names = [f"model{i}" for i in range(terms.NAMED + 1)]
    lens = lenses.make("pinhole")
    assert "..." not in terms._no_room(lens, ["k1"], names[:-1], "X").hint
    assert "..." in terms._no_room(lens, ["k1"], names, "X").hint


def test_the_message_about_a_literal():
    with pytest.raises(ValueError, match="not a Python literal") as error:
        literal.literal("[" * 5 + "x" * 500)
    assert len(str(error.value)) <= len("not a Python literal: ") + literal.LONGEST


def test_a_fold_is_not_jumped_over():
    """w (1 - w²) turns round at 1 / sqrt(3): what lies beyond its height has no pixel."""
    height = 2 / (3 * np.sqrt(3))

    def forward(w):
        return w * (1 - np.square(w).sum(1, keepdims=True))

    target = np.array([[LESS * height, 0.0], [MORE * height, 0.0]])
    w, found = foreign.inverse(forward, target)
    assert found.tolist() == [True, False] and 0 < w[0, 0] < 1 / np.sqrt(3)


# ------------------------------------------------------------------------------------ points
def test_a_field_in_a_message():
    assert columns.shown("x" * columns.LONGEST) == "x" * columns.LONGEST
    longer = columns.shown("x" * (columns.LONGEST + 1))
    assert longer.endswith("x...") and len(longer) == columns.LONGEST


@pytest.mark.parametrize(("count", "one"), [(points.LEAST_NAMED, True), (points.LEAST_NAMED - 1, False)])
def test_points_with_a_name_each(tmp_path, count, one):
    """Without a header, names that are all different are those of points, if there are enough of them."""
    path = tmp_path / "p.csv"
    rng = np.random.default_rng(0)
    rows = [f"n{i} " + " ".join(f"{x:.3f}" for x in rng.uniform(1, 9, 5)) for i in range(count)]
    path.write_text("\n".join(rows) + "\n")
    found = points.read_points(str(path))
    assert len(found) == (1 if one else count)


@pytest.mark.parametrize("share", [LESS, MORE])
def test_the_length_of_a_quaternion(tmp_path, share):
    length = np.sqrt(1 + share * robot_poses.UNIT_QUATERNION)
    q = length * np.array([0.5, 0.5, 0.5, 0.5])
    path = tmp_path / "robot.csv"
    rows = [f"v{i},{i},0,0," + ",".join(f"{x:.9f}" for x in q) for i in range(3)]
    path.write_text("view,x,y,z,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")
    if share < 1:
        read_robot_poses(path)
    else:
        with pytest.raises(DataError, match=r"a quaternion of length 1\.005"):
            read_robot_poses(path)


def test_a_grid_with_hidden_points():
    """3 x 4 cells of which so many have a point."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(4.0), np.arange(3.0)))
    enough = int(np.ceil(12 / table_checks.FULL_GRID))
    order = np.random.default_rng(1).permutation(12)
    for count, whole in ((enough, True), (enough - 1, False)):
        kept = order[:count]
        if len(np.unique(x[kept])) * len(np.unique(y[kept])) == 12:
            assert table_checks._is_grid(x[kept], y[kept]) == whole


def test_coordinates_of_one_place(tmp_path):
    """The same corner in two views, written with another rounding; farther apart, the board is no grid."""
    digit = 10.0**-written.DIGITS
    grid = np.c_[np.stack(np.meshgrid(np.arange(3.0), np.arange(2.0)), -1).reshape(-1, 2), np.zeros(6)]
    from camcal.data.observations import Observations, View
    from camcal.errors import UsageError

    uv = 100 * grid[:, :2] + 50
    for off, one in ((0.4 * digit, True), (2 * digit, False)):
        moved = grid.copy()
        moved[2, 0] += off
        observations = Observations.from_views([View("a", grid, uv), View("b", moved, uv)], (640, 480))
        if one:
            assert written.vnl(observations).startswith("## 3x2 corners")
        else:
            with pytest.raises(UsageError, match="a rectangular board"):
                written.vnl(observations)


# ------------------------------------------------------------------------------------ tables
def written_table(path, rows, header="X,Y,Z,u,v"):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


ROWS = [f"{i % 3},{i // 3},{i % 2},{100 + 9.7 * i + i * i / 7},{50 + 3.3 * i}" for i in range(9)]


def test_the_largest_coordinate(tmp_path):
    for value, good in (
        (f"{0.99 * table.LARGEST_VALUE:.17g}", True),
        (f"{1.01 * table.LARGEST_VALUE:.17g}", False),
    ):
        path = written_table(tmp_path / "p.csv", [*ROWS[:-1], f"{value},2,0,120,90"])
        if good:
            assert points.read_points(path).xyz.max() == float(value)
        else:
            with pytest.raises(DataError, match="a number below 1e"):
                points.read_points(path)


def test_the_largest_name_of_a_point():
    """Beyond 2^53 not all whole numbers are float64."""
    assert table.is_id(np.array([float(2**53), -5.0, 0.5, 2.0**53 + 2])).tolist() == [
        True,
        True,
        False,
        False,
    ]


def test_the_longest_line(tmp_path):
    for spaces, good in (
        (blocks.LONGEST_LINE - 100, True),
        (blocks.LONGEST_LINE + blocks.BLOCK_BYTES, False),
    ):
        path = written_table(tmp_path / "p.csv", [*ROWS, ROWS[3][:-2] + " " * spaces + "7"][: 9 + good])
        if not good:
            path.write_text(path.read_text() + "1," + " " * spaces)
            with pytest.raises(DataError, match="a line has more than"):
                points.read_points(path)


def pixels_as_points(count, scale=1.0, header=True):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(1, 1 + scale, (2, count))
    x[:2], y[:2] = (1, 1 + scale), (1, 1 + scale)
    side = int(np.sqrt(count))
    u, v = np.meshgrid(np.arange(float(side)), np.arange(float(count // side)))
    columns_ = {"X": x, "Y": y, "Z": np.zeros(count), "u": u.ravel(), "v": v.ravel()}
    return SimpleNamespace(
        header=header,
        view_index=None,
        columns=tuple(columns_),
        values=np.stack(list(columns_.values()), 1),
        column=columns_.get,
        where=lambda row: f"row {row}",
    )


def test_points_that_look_like_pixels():
    for count, said in ((table_checks.FEWEST_FOR_GRID, True), (table_checks.FEWEST_FOR_GRID - 1, False)):
        made = pixels_as_points(count, 100.0)
        if said:
            with pytest.raises(DataError, match="like a board"):
                table_checks.check_not_swapped(made)
        else:
            table_checks.check_not_swapped(made)
    for scale, said in ((MORE * table_checks.PIXELS_SPAN, True), (LESS * table_checks.PIXELS_SPAN, False)):
        made = pixels_as_points(9, scale)
        if said:
            with pytest.raises(DataError, match="like a board"):
                table_checks.check_not_swapped(made)
        else:
            table_checks.check_not_swapped(made)


def test_columns_that_a_camera_explains_in_another_order(monkeypatch):
    def made(count):
        values = np.random.default_rng(0).uniform(0, 1, (count, 5))
        return SimpleNamespace(view_index=None, columns=("X", "Y", "Z", "u", "v"), values=values)

    few, most = table_checks.FEWEST_FOR_DLT, table_checks.MOST_FOR_DLT
    for count, given, other, exchanged in (
        (few, 0.5, 0.01, True),
        (few - 1, 0.5, 0.01, False),
        (most, 0.5, 0.01, True),
        (most + 1, 0.5, 0.01, False),
        (few, MORE * table_checks.NO_CAMERA, 0.0, True),
        (few, LESS * table_checks.NO_CAMERA, 0.0, False),
        (few, 0.5, LESS * 0.5 * table_checks.FITS, True),
        (few, 0.5, MORE * 0.5 * table_checks.FITS, False),
    ):
        misfits = iter((given, other))
        monkeypatch.setattr(table_checks, "_misfit", lambda *_, m=misfits: next(m))
        assert table_checks._pixels_first(made(count)) == exchanged


def test_points_that_are_nearly_a_plane():
    xyz = np.array([[x, y, 0.0] for y in range(4) for x in range(4)])
    extent = np.linalg.svd(xyz - xyz.mean(0), compute_uv=False)[0] / 4
    for share, planar in ((0.98, True), (1.02, False)):
        bent = xyz.copy()
        bent[:, 2] = np.where((xyz[:, 0] + xyz[:, 1]) % 2, 1.0, -1.0) * share * shape.NEARLY_PLANAR * extent
        view = View("a", bent, bent[:, :2])
        assert shape.shapes([view]).planar[0] == planar


@pytest.mark.parametrize(("share", "singular"), [(LESS, True), (MORE, False)])
def test_the_determinant_of_dlt_coefficients(share, singular):
    matrix = np.diag([900.0, 900, share * dlt_table.ROUNDING, 1])[:3]
    matrix[2] += [0, 1, 0, 1]  # row 3 along row 2
    assert dlt_table._singular(matrix) == singular
