"""What changed, in words: the simplest motion that explains the difference."""

import numpy as np
import pytest

from camcal.model import lenses
from camcal.track.events import Alarm, axis, explain
from camcal.track.frames import Frame
from camcal.track.physical_model import Physical, PhysicalModel
from camcal.track.robust import fit

from .helpers import follow, make, sequence

STEPS = {
    "rotation": (
        ["0.31 deg about y", "moved at frame 812"],
        [0, 0, 0, 0, 0, 0, np.deg2rad(0.31), 0, 0, 0, 0],
    ),
    "focal length": (["focal length changed by +0.8 % at frame 812"], [7.2, 7.2, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
    "translation": (["camera moved", "along -x"], [0, 0, 0, 0, 0, 0, 0, 0, -0.05, 0, 0]),
    "principal point": (["principal point moved", "(+8"], [0, 0, 0, 8, -3, 0, 0, 0, 0, 0, 0]),
    "zoom": (["focal length by +5 %", "principal point"], [45, 45, 0, 9, -6, 0, 0, 0, 0, 0, 0]),
    "pose": (["deg about x", "along z"], [0, 0, 0, 0, 0, 0.02, 0, 0, 0, 0, 0.2]),
}


@pytest.mark.parametrize("kind", STEPS)
def test_the_kind_of_a_change_is_recognised(kind):
    words, step = STEPS[kind]
    model = PhysicalModel(lenses.make("pinhole", True))
    (frame,), (truth,) = sequence("static", 1, noise=0.0, points=80)
    order = [0, 1, 3, 4, 2, 5, 6, 7, 8, 9, 10]  # the lens has skew last
    before = Physical(model.lens.from_matrix(truth.k), truth.rotation, truth.translation)
    after = model.retract(before, np.array(step)[order])
    cameras = []
    rng = np.random.default_rng(0)
    for x in (before, after):
        uv = model.lens.project(x.params, frame.xyz @ x.rotation.T + x.translation)[0]
        seen = Frame(0, frame.xyz, uv + rng.normal(0, 0.05, uv.shape))
        found = fit(model, x, seen, 0.05, 18.4)
        cameras.append(model.describe([found.estimate], [found.factor]))
    change = explain(Alarm(812, 812, "nis", *cameras))
    assert change.kind == kind
    for word in words:
        assert word in change.message
    stated = np.array(change.figures.get("rotation_deg", [0, 0, 0]))
    np.testing.assert_allclose(stated, np.rad2deg(step[5:8]), atol=0.03)


def test_axes_in_words():
    assert axis(np.array([0.01, -2.0, 0.1])) == "-y"
    assert axis(np.array([1.0, 1.0, 0.0])) == "(0.71, 0.71, 0.00)"


def test_held_intrinsics_neither_change_nor_disturb():
    from camcal.model.camera import Camera

    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(900, 900, 320, 240))
    frames, _ = sequence("knock", 40, knock=20, angle=0.5, thickness=0)
    states = follow(make("iekf", camera=camera, fix={"intrinsics": None}, motion="fixed"), frames)
    (alarm,) = [s.alarm for s in states if s.alarm]
    change = explain(alarm)
    assert change.kind == "rotation" and "deg about y" in change.message
    (angle, sigma) = change.figures["rotation_deg"][1], change.figures["sigma_rotation_deg"][1]
    assert abs(angle - 0.5) < 4 * sigma < 0.1
