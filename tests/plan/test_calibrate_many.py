"""Many cameras at once: every result is that of `calibrate`, and an error stands in its place."""

import re
from pathlib import Path

import numpy as np
import pytest

import camcal
from camcal.data.observations import Correspondences
from camcal.data.writing import write_points
from camcal.errors import DataError, EstimationError, UsageError
from camcal.plan import calibrate as module
from camcal.plan import progress
from camcal.plan.progress import Attempt, Change, advance_all
from camcal.plan.solution import Solution
from camcal.solve import together
from tests import solved

QUICK = {"checks": False, "crosscheck": False}


def camera(seed, views=5, distance=(11.0, 16.0), tilt=0.5):
    rng = np.random.default_rng(seed)
    poses = solved.tilted_poses(solved.grid(), views, rng, tilt, distance)
    return solved.observe(solved.camera_of(), poses, solved.grid(), 0.1, rng)


def same(a, b):
    assert np.array_equal(a.camera.params, b.camera.params) and np.array_equal(a.residuals, b.residuals)
    assert np.array_equal(a.poses.translations, b.poses.translations)
    assert [w.code for w in a.warnings] == [w.code for w in b.warnings]
    assert [(s.name, s.rms_point) for s in a.stages] == [(s.name, s.rms_point) for s in b.stages]
    assert a.options == b.options and a.verdict == b.verdict and str(a.holdout) == str(b.holdout)  # NaN = NaN
    return True


@pytest.fixture(scope="module")
def cameras():
    """Alike and unlike ones; small boards, whose poses have two minima, and one that cannot be calibrated."""
    flat = camera(5, tilt=0.0)
    line = Correspondences.from_views([(v.xyz[:9], v.uv[:9]) for v in camera(6).views])
    return [camera(0), camera(1), camera(2, distance=(40.0, 60.0)), line, camera(3, views=7), flat, camera(4)]


@pytest.mark.parametrize("model", ["opencv5", "kb4"])
def test_the_same_as_one_by_one(cameras, model):
    found = camcal.calibrate_many(cameras, model=model, **QUICK)
    assert len(found) == len(cameras)
    for one, data in zip(found, cameras, strict=True):
        if isinstance(one, Solution):
            same(one, camcal.calibrate(data, model=model, **QUICK))
        else:
            with pytest.raises(type(one)) as raised:
                camcal.calibrate(data, model=model, **QUICK)
            assert str(raised.value) == str(one)
    assert isinstance(found[3], DataError) and isinstance(found[0], Solution)


def test_a_model_that_is_chosen(cameras, monkeypatch):
    """The default model is fitted to all together; where it does not hold, others are ranked for that one."""
    data = [cameras[0], camera(7, views=1), cameras[1]]
    calls, own = [], together.refine_all

    def ranked(given, asked, models, why):
        raise EstimationError(f"ranked: {models[0]}, {given.point_count} points, {why}")

    monkeypatch.setattr("camcal.plan.camera.refine_all", lambda tasks: calls.append(len(tasks)) or own(tasks))
    monkeypatch.setattr("camcal.plan.lens._ranked", ranked)
    found = camcal.calibrate_many(data, **QUICK)
    assert calls == [3] and str(found[1]).startswith("ranked: pinhole, 54 points, opencv5 is unsuitable")
    for i in (0, 2):
        assert found[i].selection["chosen"] == "opencv5"
        same(found[i], camcal.calibrate(data[i], **QUICK))


def test_with_all_checks(cameras):
    found = camcal.calibrate_many(cameras[:2], model="opencv5", crosscheck=False)
    assert found[0].holdout and all(
        same(f, camcal.calibrate(d, model="opencv5", crosscheck=False))
        for f, d in zip(found, cameras[:2], strict=True)
    )


def test_some_at_a_time(cameras, monkeypatch):
    """An iterable is taken in portions, and their size does not matter."""
    monkeypatch.setattr(module, "AT_A_TIME", 2)
    taken = []

    def one_by_one():
        for i, data in enumerate(cameras[:5]):
            taken.append(i)
            yield data

    found = camcal.calibrate_many(one_by_one(), model="opencv5", **QUICK)
    assert taken == [0, 1, 2, 3, 4] and len(found) == 5
    same(found[4], camcal.calibrate(cameras[4], model="opencv5", **QUICK))
    assert camcal.calibrate_many([], model="opencv5") == []


@pytest.mark.parametrize(("world", "image", "said"), [
    (1.01e70 / 8, 1, "points have a coordinate above"), (1, 1e68, "image points have a coordinate above"),
    (0.99e-70 / 8, 1, "at least 1e-70 is needed"), (0.99e70 / 8, 1, ""), (1.01e-70 / 8, 1, ""),
])  # fmt: skip
def test_a_camera_of_absurd_numbers_is_an_error_in_place(cameras, world, image, said):
    """Powers of them would be infinite or 0, and a decomposition of all views together would fail."""
    views = [(v.xyz * world, v.uv * image) for v in camera(3).views]  # a board of 8 x 5
    found = camcal.calibrate_many([cameras[0], Correspondences.from_views(views)], model="opencv5", **QUICK)
    assert isinstance(found[0], Solution) and isinstance(found[1], DataError if said else Solution)
    assert said in str(found[1])


def test_wrong_options_are_an_error_of_the_call(cameras):
    with pytest.raises(UsageError, match="opencv6"):
        camcal.calibrate_many(cameras[:1], model="opencv6")
    with pytest.raises(UsageError):
        camcal.calibrate_many(cameras[:1], colour="red")
    with pytest.raises(UsageError, match="no parameter 'k9'"):
        camcal.calibrate_many(cameras[:1], model="opencv5", fix={"k9": 0.0})


@pytest.mark.parametrize("other", ["table.csv", None])
def test_what_is_not_a_camera_is_an_error_in_place(cameras, other):
    found = camcal.calibrate_many([cameras[0], other], model="opencv5", **QUICK)
    assert isinstance(found[0], Solution) and isinstance(found[1], UsageError)
    assert f"not a {type(other).__name__}" in str(found[1])
    named = re.findall(r"camcal\.(\w+)", found[1].hint)
    assert named and set(named) <= set(camcal.__all__)
    with pytest.raises(UsageError, match="observations of a camera"):
        camcal.calibrate(other, model="opencv5", **QUICK)


def test_attempts_that_are_made_together():
    """Those that apply, in one call; an error of one ends or fails that one alone."""
    calls = []

    def some(members):
        calls.append([m.notes["name"] for m in members])
        found = {"a": Change(notes={"made": True}), "b": EstimationError("no"), "c": UsageError("never")}
        return [found[m.notes["name"]] for m in members]

    def member(name):
        return progress.Progress(None, None, None, None, None, notes={"name": name})

    attempt = Attempt("x", lambda p: p.notes["name"] != "d", lambda p: None, some)
    a, b, c, d, e = advance_all([attempt], [*map(member, "abcd"), DataError("before")])
    assert calls == [["a", "b", "c"]]
    assert a.notes["made"] and str(b.error) == "no" and isinstance(c, UsageError) and isinstance(e, DataError)
    assert d == member("d")


def test_the_example_of_the_page(tmp_path, monkeypatch, capsys):
    """What docs/batch.md shows runs as it stands there."""
    for seed, name in enumerate(("left.csv", "right.csv")):
        write_points(tmp_path / name, camera(seed))
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "batch.md").read_text()
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    assert capsys.readouterr().out.count("<Solution: opencv5, 5 views") == 2


def test_cameras_without_views():
    empty = Correspondences.from_views([], (640, 480))
    found = camcal.calibrate_many([empty, camera(0), empty], model="opencv5", **QUICK)
    assert (
        isinstance(found[0], DataError) and isinstance(found[1], Solution) and isinstance(found[2], DataError)
    )
    assert isinstance(camcal.calibrate_many([empty], model="opencv5", **QUICK)[0], DataError)


def test_a_camera_that_is_known_needs_no_start():
    fix = dict(zip(("fx", "fy", "cx", "cy"), (533.0, 534.0, 322.0, 238.0), strict=True))
    data = [camera(0), camera(1)]
    found = camcal.calibrate_many(data, model="pinhole", fix=fix, **QUICK)
    for one, d in zip(found, data, strict=True):
        same(one, camcal.calibrate(d, model="pinhole", fix=fix, **QUICK))
