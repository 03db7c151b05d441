"""Which pictures of several cameras are of the same instant."""

from dataclasses import replace

import pytest

from camcal.detect.rig_images import match
from camcal.errors import DataError


@pytest.mark.parametrize(
    ("left", "right", "instants"),
    [
        (["left01.jpg", "left02.jpg"], ["right01.jpg", "right02.jpg"], ["1", "2"]),
        (["07.png", "08.png"], ["07.png", "08.png"], ["07", "08"]),
        (["cam0_7.png", "cam0_9.png"], ["cam1_9.png", "cam1_10.png"], ["7", "9"]),
        (["a.png", "b.png"], ["c.png", "d.png"], ["1", "2"]),
    ],
)
def test_names(left, right, instants):
    found = match({"left": left, "right": right})
    assert list(found["left"].values()) == instants


def test_a_missing_picture_shifts_nothing():
    found = match({"left": ["l1.png", "l2.png", "l3.png"], "right": ["r1.png", "r3.png"]})
    assert found["right"] == {"r1.png": "1", "r3.png": "3"}


def test_names_that_say_nothing():
    with pytest.raises(DataError, match=r"left 3, right 2"):
        match({"left": ["a.png", "b.png", "c.png"], "right": ["x.png", "y.png"]})


def test_frames_of_films_and_pictures_that_were_not_searched():
    from camcal.data.observations import Observations, SkippedView
    from camcal.detect.rig_images import _searched

    part = Observations.from_views([([[0, 0, 0]], [[1, 1]])])
    part = replace(part, view_ids=("b.png",), skipped=(SkippedView("a.png", "not_found", "no board"),))
    assert _searched(["a.png", "b.png"], part.view_ids, part) == ["a.png", "b.png"]
    frames = replace(part, view_ids=("f.mp4#10",), skipped=(SkippedView("f.mp4#9", "not_found", "no board"),))
    assert _searched(["f.mp4"], frames.view_ids, frames) == ["f.mp4#9", "f.mp4#10"]
    found = match({"l": ["f.mp4#9", "f.mp4#10"], "r": ["g.mp4#10", "g.mp4#12"]})
    assert found["l"]["f.mp4#10"] == found["r"]["g.mp4#10"] == "10"


@pytest.mark.parametrize(("shared", "refused"), [(2, False), (3, True), (4, True)])
def test_two_cameras_have_pictures_of_their_own(shared, refused):
    from camcal.data.observations import Observations
    from camcal.detect.rig_images import _check_own_pictures

    def part(first):
        files = tuple({"path": f"{i}.png", "sha256": str(i)} for i in range(first, first + 4))
        return replace(Observations.from_views([([[0, 0, 0]], [[1, 1]])]), files=files)

    parts = {"left": part(0), "right": part(4 - shared)}
    if refused:
        with pytest.raises(DataError, match=r"'left' and 'right' were given the same pictures"):
            _check_own_pictures(parts)
    else:
        _check_own_pictures(parts)
