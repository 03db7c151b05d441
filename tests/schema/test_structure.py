"""The schema: reading, what is refused, and what is documented."""

import re
import subprocess
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.errors import DataError
from camcal.schema import Report, keys, structure, unknown_key
from camcal.schema.camera import Camera, Rig
from camcal.schema.structure import hints_of

FX = {"value": 800, "sigma": None, "start": 790.0, "fixed": True}
CAMERA = {
    "model": "pinhole",
    "image_size": [640, 480],
    "pixel_center": "integer",
    "matrix": [[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]],
    "parameters": {"fx": FX},
}


def test_a_camera():
    camera = structure(Camera, CAMERA, "c.yaml")
    assert camera.image_size == (640, 480)
    assert camera.parameters["fx"].value == 800.0
    assert camera.correlations is msgspec.UNSET


def test_keys_of_a_newer_camcal_are_ignored():
    assert structure(Camera, {**CAMERA, "colour": "red"}, "c.yaml").model == "pinhole"
    assert unknown_key(Camera, {**CAMERA, "colour": "red"}) == "colour"
    deeper = {**CAMERA, "parameters": {"fx": {**FX, "unit": "px"}}}
    assert unknown_key(Camera, deeper) == "parameters.fx.unit"
    assert unknown_key(Camera, CAMERA) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image_size": [640, -1]}, "cameras.left.image_size[1] is -1; a whole number from 1 up is needed."),
        ({"image_size": "640x480"}, "cameras.left.image_size is '640x480'; a list of 2 is needed."),
        ({"parameters": {}}, "cameras.left.parameters is a group of keys; a group of keys with entries is needed."),
        ({"parameters": {"fx": {**FX, "value": "abc"}}}, "cameras.left.parameters.fx.value is 'abc'; a finite"),
        ({"parameters": {"fx": {**FX, "sigma": -1}}}, "parameters.fx.sigma is -1; a number from 0 up is needed."),
        ({"parameters": {"fx": {"start": 1.0}}}, "'cameras.left.parameters.fx.value' is missing."),
        ({"pixel_center": "corner"}, "cameras.left.pixel_center is 'corner'; 'integer' is needed."),
        ({"matrix": [[1, 0, 0]] * 2}, "cameras.left.matrix is a list of 2; a list of 3 is needed."),
        ({"model": ""}, "cameras.left.model is ''; text that is not empty is needed."),
    ],
)  # fmt: skip
def test_errors_name_the_path(change, message):
    found = {"left": {**CAMERA, **change}, "right": CAMERA}
    with pytest.raises(DataError, match=f"^'rig.yaml' is damaged: .*{re.escape(message)}"):
        structure(dict[str, Camera], found, "rig.yaml", "cameras")


def test_a_rig():
    pose = {"rotation_vector": [0, 0.1, 0], "translation": [-0.1, 0, 0], "sigma_rotation_deg": None}
    found = structure(Rig, {"reference": "left", "cam_from_rig": {"right": pose}}, "rig.yaml", "rig")
    assert found.cam_from_rig["right"].translation == (-0.1, 0.0, 0.0)
    bad = {**pose, "rotation_vector": [0, float("nan"), 0]}
    with pytest.raises(DataError, match=r"rig\.cam_from_rig\.right\.rotation_vector\[1\] is nan; a finite"):
        structure(Rig, {"reference": "left", "cam_from_rig": {"right": bad}}, "rig.yaml", "rig")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from([*CAMERA, *FX, "views", "fit"]), inner, max_size=4)
    ),
    max_leaves=8,
)


@given(value=VALUES, key=st.sampled_from([*CAMERA, *FX]))
def test_whatever_stands_there_only_data_errors_come_out(value, key):
    for kind, found in ((Camera, {**CAMERA, key: value}), (Report, value), (Camera, {"parameters": value})):
        try:
            structure(kind, found, "c.yaml")
        except DataError as error:
            assert error.message.startswith("'c.yaml' is damaged: ")


def test_every_key_has_its_text():
    for path, kind in keys.sections():
        for name in hints_of(kind):
            assert f"| `{name}` | " in keys.table(kind), path
        assert "|  |" not in keys.table(kind), path


def test_numpy_is_not_loaded():
    code = "import sys, camcal.schema; assert not {'numpy', 'cv2', 'yaml'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
