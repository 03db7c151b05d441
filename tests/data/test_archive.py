"""Correspondences from .npz archives."""

import hashlib

import numpy as np
import pytest

from camcal.data.points import read_points
from camcal.errors import DataError

XYZ = np.arange(18.0).reshape(6, 3)
UV = np.arange(12.0).reshape(6, 2) * 7
STACK = UV + np.arange(3)[:, None, None] * 100


@pytest.fixture
def read(tmp_path):
    def save_and_read(**arrays):
        np.savez(tmp_path / "p.npz", **arrays)
        return read_points(tmp_path / "p.npz")

    return save_and_read


def test_flat_arrays_are_one_view(read, tmp_path):
    c = read(xyz=XYZ, uv=UV)
    (view,) = c.views
    assert view.id == "p.npz"
    assert np.array_equal(view.xyz, XYZ)
    assert np.array_equal(view.uv, UV)
    assert c.files[0]["sha256"] == hashlib.sha256((tmp_path / "p.npz").read_bytes()).hexdigest()


@pytest.mark.parametrize("names", [["b", "a", "b", "a", "c", "c"], [7, 5, 7, 5, 9, 9], [b"b", b"a"] * 3])
def test_flat_arrays_with_views(read, names):
    c = read(
        xyz=XYZ, uv=UV, view=np.array(names), sigma=np.arange(1, 7), id=np.arange(6), image_size=[640, 480]
    )
    words = [n.decode() if isinstance(n, bytes) else str(n) for n in names]
    assert [v.id for v in c.views] == list(dict.fromkeys(words))
    rows = [i for i, n in enumerate(words) if n == words[0]]
    assert c.views[0].point_ids.tolist() == rows
    assert c.views[0].sigma.tolist() == [i + 1 for i in rows]
    assert np.array_equal(c.views[0].uv, UV[rows])
    assert c.image_size == (640, 480)


@pytest.mark.parametrize("xyz", [XYZ, XYZ[:, :2], np.stack([XYZ] * 3), XYZ.astype(np.float32)])
@pytest.mark.parametrize("uv", [STACK, STACK[:, :, None], STACK.astype(int)])
def test_stacked_views(read, xyz, uv):
    c = read(object_points=xyz, imagePoints=uv, mtx=np.eye(3))
    assert [v.id for v in c.views] == ["view1", "view2", "view3"]
    for view, pixels in zip(c.views, STACK, strict=True):
        assert np.array_equal(view.uv, pixels)
        assert np.array_equal(view.xyz[:, :2], XYZ[:, :2])


def test_stacked_views_have_names_ids_and_sigmas(read):
    c = read(xyz=XYZ, uv=STACK, view=["l", "m", "r"], id=np.arange(6), sigma=0.5)
    assert [v.id for v in c.views] == ["l", "m", "r"]
    assert c.views[2].point_ids.tolist() == [0, 1, 2, 3, 4, 5]
    assert c.views[2].sigma.tolist() == [0.5] * 6


def with_value(array, place, value):
    array = array.astype(float)
    array[place] = value
    return array


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"xyz": XYZ}, "no array 'uv'"),
        ({"uv": UV, "arr_0": XYZ}, "no array 'xyz'"),
        ({"xyz": XYZ, "uv": UV[:5]}, r"xyz \(6, 3\) and uv \(5, 2\) do not match"),
        ({"xyz": XYZ.T, "uv": UV.T}, "do not match"),
        ({"xyz": XYZ[:0], "uv": UV[:0]}, "do not match"),
        ({"xyz": XYZ, "uv": UV, "sigmaa": np.ones(6)}, "unknown array 'sigmaa'"),
        ({"xyz": XYZ, "uv": UV, "points2d": UV}, "two arrays mean uv"),
        ({"xyz": XYZ, "uv": UV.astype(str)}, r"uv holds <U32 of shape \(6, 2\); an array of real numbers"),
        ({"xyz": XYZ, "uv": np.array([UV, UV[:3]], dtype=object)}, "an array of Python objects"),
        ({"xyz": XYZ, "uv": UV + 0j}, "uv holds complex128"),
        ({"xyz": XYZ, "uv": with_value(UV, (4, 1), np.nan)}, r"p\.npz:row \[4\]: v is nan; a finite number"),
        ({"xyz": XYZ, "uv": with_value(STACK, (1, 4, 1), np.inf)}, r"p\.npz:row \[1, 4\]: v is inf"),
        ({"xyz": XYZ, "uv": UV, "sigma": np.arange(6)}, r"row \[0\]: sigma is 0; a number above 0"),
        ({"xyz": XYZ, "uv": UV, "sigma": np.ones(5)}, r"sigma holds float64 of shape \(5,\)"),
        ({"xyz": XYZ, "uv": UV, "id": np.arange(6) / 2}, r"row \[1\]: id is 0.5; a whole number"),
        ({"xyz": XYZ, "uv": UV, "view": ["a"] * 5}, r"view holds <U1 of shape \(5,\)"),
        ({"xyz": XYZ, "uv": UV, "view": ["a", ""] * 3}, r"view\[1\] is empty"),
        ({"xyz": XYZ, "uv": STACK, "view": ["a", "b", "a"]}, "3 stacked views were found, but 2 names"),
        ({"xyz": XYZ, "uv": UV, "image_size": [640, 0]}, r"image_size is \[640, 0\]"),
        (
            {"xyz": XYZ[[0, 1, 0]], "uv": UV[:3]},
            r"p\.npz:row \[2\]: the point \(0, 1, 2\) .* after row \[0\]",
        ),
    ],
)
def test_bad_arrays(read, arrays, message):
    with pytest.raises(DataError, match=message) as caught:
        read(**arrays)
    assert caught.value.hint


@pytest.mark.parametrize("cut", [0, 1, 30, 200, 400])
def test_broken_archives(tmp_path, cut):
    np.savez(tmp_path / "whole.npz", xyz=XYZ, uv=UV)
    path = tmp_path / "p.npz"
    path.write_bytes((tmp_path / "whole.npz").read_bytes()[:cut])
    with pytest.raises(DataError, match=r"not an? (readable )?\.npz archive|0 bytes"):
        read_points(path)


def test_a_single_array(tmp_path):
    np.save(tmp_path / "p.npy", XYZ)
    (tmp_path / "p.npy").rename(tmp_path / "p.npz")
    with pytest.raises(DataError, match="a single array was found; an archive is needed"):
        read_points(tmp_path / "p.npz")


def test_the_image_size_must_agree(tmp_path):
    np.savez(tmp_path / "p.npz", xyz=XYZ, uv=UV, image_size=[640, 480])
    with pytest.raises(DataError, match="pictures have 640x480 px; 800x600 is needed"):
        read_points(tmp_path / "p.npz", image_size=(800, 600))
