"""Parameters that are held at the estimate of a closed form are said."""

import re

import pytest

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.plan.held import held_at_start

LENS = lenses.make("pinhole")
CAMERA = Camera(LENS, LENS.from_values({"fx": 600.0, "fy": 601.0, "cx": 323.9, "cy": 234.5}), (640, 480))


@pytest.mark.parametrize(
    ("fix", "name", "typed"),
    [
        ({"fx": None}, "", "fx = 600 is held .* --fix fx=VALUE, or a camera: --start-camera FILE."),
        ({"cx": None, "cy": None}, "", "--fix cx=319.5,cy=239.5 .the middle of the picture., or"),
        ({"fx": None}, "left", "camera left: .* --fix left.fx=VALUE, or a camera: --cameras left=FILE."),
    ],
)
def test_what_to_type_is_said(fix, name, typed):
    (said,) = held_at_start(fix, CAMERA, name)
    assert said.code == "held-at-start"
    assert re.search(typed, f"{said.message} {said.hint}")


@pytest.mark.parametrize("fix", [{}, {"fx": 600.0}, {"aspect": None}, {"k1": None}])
def test_values_that_are_known_are_not_said(fix):
    assert not list(held_at_start(fix, CAMERA))
