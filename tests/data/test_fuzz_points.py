"""Whatever stands in a file of points, only camcal's own errors come out, one line each with a hint."""

import io

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.data.points import read_points
from camcal.errors import CamcalError

FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300)
SCRAPS = [
    "view",
    "X",
    "Y",
    "Z",
    "u",
    "v",
    "sigma",
    "id",
    "1",
    "2.5",
    "-3",
    "1e5",
    "1e999",
    "nan",
    "x",
    "é",
    '"',
]
SCRAPS += [
    ",",
    ",",
    ",",
    ";",
    "\t",
    " ",
    " ",
    "\n",
    "\n",
    "\r\n",
    "\r",
    "#",
    "\ufeff",
    "\0",
    "\x0b",
    "\x1c",
    "\x85",
]
TEXT = st.lists(st.sampled_from(SCRAPS), max_size=40).map(lambda parts: "".join(parts).encode())
ANYTHING = TEXT | st.binary(max_size=80) | st.text(max_size=60).map(lambda t: t.encode(errors="replace"))

FIELD = st.sampled_from(
    ["1", "2", "3", "4", "-5.5", "1e-3", "nan", "", "x", " 7 ", '"8"', '"9', "1,5", "+2", "0x1"]
)
ROWS = st.lists(st.lists(FIELD, min_size=4, max_size=7), min_size=1, max_size=6)


def well_behaved(*paths, **more):
    try:
        found = read_points(*paths, **more)
    except CamcalError as error:
        assert "\n" not in error.message
        assert error.hint
        return
    for view in found.views:
        assert len(view.id.strip())
        assert len(view) == len(view.uv) > 0
        assert np.isfinite(view.xyz).all()
        assert np.isfinite(view.uv).all()


@FUZZ
@given(data=ANYTHING)
def test_any_bytes(tmp_path, data):
    path = tmp_path / "p.csv"
    path.write_bytes(data)
    well_behaved(path)


@FUZZ
@given(
    rows=ROWS,
    separator=st.sampled_from([",", ";", "\t", " "]),
    header=st.sampled_from(["", "X,Y,u,v", "view,X,Y,u,v"]),
)
def test_near_tables(tmp_path, rows, separator, header):
    path = tmp_path / "p.csv"
    lines = [separator.join(row) for row in rows]
    path.write_text("\n".join([header.replace(",", separator)] * bool(header) + lines))
    well_behaved(path)


@FUZZ
@given(world=ANYTHING, image=ANYTHING)
def test_any_pair(tmp_path, world, image):
    (tmp_path / "w").write_bytes(world)
    (tmp_path / "i").write_bytes(image)
    well_behaved(points3d=tmp_path / "w", points2d=tmp_path / "i")


@FUZZ
@given(place=st.integers(0, 2000), value=st.integers(0, 255), cut=st.integers(0, 2000))
def test_damaged_archives(tmp_path, place, value, cut):
    stream = io.BytesIO()
    np.savez_compressed(
        stream, xyz=np.arange(18.0).reshape(6, 3), uv=np.arange(12.0).reshape(6, 2), view=["a"] * 6
    )
    data = bytearray(stream.getvalue())
    data[place % len(data)] = value
    path = tmp_path / "p.npz"
    path.write_bytes(data[: max(cut, 200)] if cut % 3 == 0 else data)
    well_behaved(path)
