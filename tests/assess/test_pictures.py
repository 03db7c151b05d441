"""Faults of pictures become warnings of the calibration."""

from dataclasses import replace

from camcal.assess.checks import check
from camcal.assess.checks.pictures import REMEDIES, faults
from camcal.detect import quality
from tests.solved import solved


def with_quality(**said):
    solution = solved(views=8)
    measured = {name: {"warnings": words} for name, words in said.items()}
    return replace(solution, observations=replace(solution.observations, picture_quality=measured))


def test_each_fault_is_a_warning_with_its_pictures():
    names = [v.id for v in solved(views=8).observations.views]
    found = with_quality(
        **{
            names[0]: ["blurred: the edges are 3.1 px wide"],
            names[3]: ["blurred: the edges are 2.9 px wide", "small: the board covers 1 %"],
            "left out": ["flat: black and white differ by 9"],
        }
    )
    said = {w.code: w for w in check(found) if w.code.startswith("pictures-")}
    assert set(said) == {"pictures-blurred", "pictures-small"}
    assert "2 of 8" in said["pictures-blurred"].message and names[3] in said["pictures-blurred"].message
    assert said["pictures-small"].hint == REMEDIES["small"]


def test_good_pictures_give_none():
    assert list(faults(with_quality().observations)) == []


def test_every_fault_that_is_measured_has_a_remedy():
    worst = {
        "blur_px": 9.0, "square_px": 10.0, "blur_ratio": 3.0, "saturated": 1.0, "contrast": 5.0, "residual": 5.0,
        "coverage": 0.0,
    }  # fmt: skip
    assert {w.partition(":")[0] for w in quality.warnings(worst)} == set(REMEDIES)
