"""When cv2 is asked and what counts as the same optimum, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.peers import calibrate_camera_ro, refinement, register_cameras, stereo_calibrate
from camcal.peers.base import PROJECTION_PX, LeftOutError, NotComparableError, Result
from tests.sides import LESS, MORE
from tests.solved import solved


@pytest.fixture(scope="module")
def good():
    return solved(views=4)


@pytest.mark.parametrize(("share", "status"), [(LESS, "pass"), (MORE, "fail")])
def test_projections_of_the_same_optimum(good, monkeypatch, share, status):
    """By pixels alone where the parameters are off by more standard deviations than are allowed."""
    monkeypatch.setattr(refinement, "distance_in_sigmas", lambda *_: np.inf)
    apart = SimpleNamespace(max_px=share * PROJECTION_PX)
    monkeypatch.setattr(refinement, "difference", lambda *_: apart)
    monkeypatch.setattr(refinement, "_figures", lambda *_: {})
    same = Result(good.camera, good.poses, good.rms_point, np.zeros(5), "there", rounded=False)
    assert refinement._judged(good, same, "cv2", [])["status"] == status


def test_steps_that_show_whether_cv2_stays(good):
    """Most of what there is to gain from a focal length that is off by a tenth, which two steps do not find."""
    off = replace(good.camera, params=good.camera.params * 1.1)
    asked = []

    def run(task, start):
        asked.append((task.iterations, start))
        raise LeftOutError("enough", ())

    with pytest.raises(LeftOutError):
        refinement.compare(good, "cv2", run=run, full=False)
    iterations, start = asked[0]
    assert start is good.camera
    form = refinement.load(refinement.CALIBRATORS["calibrateCamera"])
    task = refinement.task_of(good)
    ends = [form(replace(task, iterations=n), off).rms_point for n in (2, iterations, 2 * iterations)]
    least = good.rms_point
    assert ends[0] > least * 1.001 and ends[1] < least * 1.001 and ends[2] < least * 1.001


@pytest.mark.parametrize(("points", "kept"), [(27, True), (26, False)])
def test_the_share_of_points_that_all_views_show(good, points, kept):
    """Each of two views shows so many of 54 points that the other one shows, too, and the other half alone."""
    assert 26 / 54 < calibrate_camera_ro.LEAST_SHARE <= 27 / 54
    data = good.observations.of_views([0, 1])
    shown = replace(data.views[1], xyz=data.views[0].xyz.copy(), uv=data.views[0].uv.copy())
    other = shown.xyz.copy()
    other[points:] += [100.0, 0, 0]
    ids = np.arange(54) + np.where(np.arange(54) < points, 0, 100)
    two = data.with_views([data.views[0], replace(shown, xyz=other, point_ids=ids)])
    if kept:
        assert calibrate_camera_ro.complete(two).point_count == 2 * points
    else:
        with pytest.raises(NotComparableError, match="too few views"):
            calibrate_camera_ro.complete(two)


class EnoughError(Exception):
    """Raised where the instants are enough."""


def enough(*_):
    raise EnoughError


@pytest.mark.parametrize("call", ["pair", "registered"])
@pytest.mark.parametrize(("count", "error"), [(3, EnoughError), (2, NotComparableError)])
def test_instants_that_a_pair_needs(monkeypatch, call, count, error):
    """By both functions of cv2: 3 is what `LEAST_INSTANTS` says."""
    assert stereo_calibrate.LEAST_INSTANTS == 3
    cameras = {"a": None, "b": None}
    whole = SimpleNamespace(
        rig=SimpleNamespace(cameras=cameras, with_reference=lambda _: SimpleNamespace(cameras=cameras)),
        start=SimpleNamespace(cameras=cameras),
    )
    instants = np.arange(count)
    if call == "pair":
        monkeypatch.setattr(stereo_calibrate, "_function", lambda _: "calibrateCamera")
        monkeypatch.setattr(stereo_calibrate, "_shared", lambda *_: (None, instants))
        with pytest.raises(NotComparableError if error is NotComparableError else AttributeError):
            stereo_calibrate._pair(whole, "a", "b", None)
        return
    monkeypatch.setattr(
        stereo_calibrate, "_pair", lambda *_: (_ for _ in ()).throw(NotComparableError("why"))
    )
    monkeypatch.setattr(register_cameras.cv2, "registerCameras", None, raising=False)
    monkeypatch.setattr(register_cameras, "_model", lambda _: None)
    monkeypatch.setattr(register_cameras, "_of_pair", lambda *_: (None, instants))
    whole.rig.with_reference = enough
    if error is EnoughError:
        with pytest.raises(EnoughError):
            stereo_calibrate._entry("refine", whole, "a", "b", None)
    else:
        assert stereo_calibrate._entry("refine", whole, "a", "b", None)["status"] == "not_applicable"
