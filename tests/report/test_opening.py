"""`camcal.load` and `camcal.save_camera`."""

import numpy as np
import pytest

import camcal
from camcal.errors import DataError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from tests.solved import solved


def camera_of(spec):
    lens = lenses.make(spec)
    params, size = lens.examples()[0]
    return Camera(lens, np.array(params, float), size)


def test_a_camera_in_any_format(tmp_path):
    camera = camera_of("opencv5")
    for name in ("a.yml", "a.cameramodel", "a.toml", "a.mat", "a.yaml"):
        assert all(px < 1e-9 for px in camcal.save_camera(camera, tmp_path / name).values())
        again = camcal.load(tmp_path / name)
        assert isinstance(again, Camera) and np.allclose(again.params, camera.params, rtol=1e-14)
    camcal.save_camera(camera, tmp_path / "cameras.txt", to="colmap")
    with pytest.raises(UsageError, match="k3"):
        camcal.save_camera(camera, tmp_path / "k.yaml", to="kalibr")


@pytest.mark.parametrize("name", ["rig.yaml", "rig.toml", "rig.yml"])
def test_a_rig(tmp_path, name):
    rig = Rig(
        {"left": camera_of("opencv5"), "right": camera_of("opencv5")},
        {"right": Pose(np.eye(3), np.array([-0.1, 0.0, 0.0]))},
        "left",
    )
    camcal.save_camera(rig, tmp_path / name)
    again = camcal.load(tmp_path / name)
    assert isinstance(again, Rig) and again.baseline("left", "right") == pytest.approx(0.1)
    one = camcal.load(f"{tmp_path / name}#right")
    assert isinstance(one, Camera) and np.array_equal(one.params, rig.cameras["right"].params)


def test_a_report(tmp_path):
    from camcal.report.document import document, save

    made = solved(views=4)
    save(document(made), tmp_path / "r.yaml")
    again = camcal.load(tmp_path / "r.yaml")
    assert type(again) is type(made) and np.array_equal(again.camera.params, made.camera.params)


def test_several_cameras_without_poses(tmp_path):
    (tmp_path / "cameras.txt").write_text(
        "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 510 500 320 240\n"
    )
    with pytest.raises(DataError, match="2 cameras"):
        camcal.load(tmp_path / "cameras.txt")
    assert camcal.load(f"{tmp_path / 'cameras.txt'}#2").params[0] == 510
