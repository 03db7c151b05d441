"""Further numbers that decide something in the plan, each just below and just above."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import DataError, UsageError
from camcal.model.pose import Pose, Poses
from camcal.plan import hand_eye, known_rig, lens, outlying, rig_boards, second_pass, selection
from tests.sides import LESS, MORE
from tests.solved import solved


# ------------------------------------------------------------------------------------ a camera
def test_coefficients_about_which_nothing_is_known(monkeypatch):
    monkeypatch.setattr(lens, "_too_few", lambda *_: "")
    for module, name in ((lens.fit_checks, "large_residuals"), (lens.fit_checks, "systematic")):
        monkeypatch.setattr(module, name, lambda _: [])
    for name in ("outside_domain", "fold_in_image"):
        monkeypatch.setattr(lens.lens_checks, name, lambda _: [])
    for share, loose in ((LESS, False), (MORE, True)):
        facts = SimpleNamespace(
            covariance=SimpleNamespace(sigmas={"k3": share * lens.UNKNOWN}), groups=lambda _: ["k3"]
        )
        monkeypatch.setattr(lens, "Facts", lambda _, f=facts: f)
        fit = solved(views=4)
        said = lens._does_not_hold(SimpleNamespace(fit=fit))[0]
        assert ("k3" in said) == loose


def test_rounds_of_the_second_pass(monkeypatch):
    """They end where the camera moves its projections by little, and after so many."""

    class Held(Exception):
        pass

    def hold_out(*_):
        raise Held

    monkeypatch.setattr(second_pass, "_in_best_windows", lambda _: (1, None, None, None))
    monkeypatch.setattr(second_pass, "_refitted", lambda *_: None)
    monkeypatch.setattr(second_pass, "hold_out", hold_out)
    progress = SimpleNamespace(fit=None, given=None, how=None)
    for moved, more in (
        (LESS * second_pass.SETTLED, 0),
        (MORE * second_pass.SETTLED, second_pass.ROUNDS - 1),
    ):
        again = []
        monkeypatch.setattr(second_pass, "_again", lambda *_, a=again: (a.append(1), None))
        monkeypatch.setattr(second_pass, "_projections_moved", lambda *_, m=moved: m)
        with pytest.raises(Held):
            second_pass._second_pass(progress)
        assert len(again) == more


def test_rounds_of_weighting(monkeypatch):
    """They end where the sigmas change by little beside a common factor, and after so many."""
    good = solved(views=4, sigma=np.full(54, 0.2))
    progress = SimpleNamespace(
        fit=good, given=good.observations, how=None, options=SimpleNamespace(robust="auto")
    )
    ratio = np.where(np.arange(54 * 4) % 2, 0.5, -0.5)
    for spread, fits in ((LESS, 1), (MORE, outlying.WEIGHTINGS)):
        made = []
        monkeypatch.setattr(outlying, "refine", lambda *_, m=made: m.append(1) or good)

        def model(*_, each=2 * (1 + spread * outlying.SAME_SIGMA * ratio), m=made):
            ratios = each ** len(m)
            return SimpleNamespace(sigmas=lambda _: ratios, scale=1.0, floor=0.0)

        monkeypatch.setattr(outlying.noise, "noise_model", model)
        monkeypatch.setattr(outlying.noise, "NoiseModel", model)
        monkeypatch.setattr(outlying, "replace", lambda data, **_: data)
        outlying._weight(progress)
        assert len(made) == fits


def test_an_inner_model_that_is_lower_but_for_rounding(monkeypatch):
    fit = solved(views=4)
    done = []
    monkeypatch.setattr(selection, "embed", lambda *_: fit.camera.params)
    monkeypatch.setattr(selection.starts, "adopted", lambda *_: (fit.camera, fit.poses))
    monkeypatch.setattr(selection, "refine", lambda *_: done.append(1) or fit)
    monkeypatch.setattr(selection, "check", lambda _: ())
    monkeypatch.setattr(selection, "hold_out", lambda *_: None)
    rounding = selection.AS_LOW - 1
    for share, tried in ((LESS, 1), (MORE, 0)):
        done.clear()
        inner = replace(fit, fit=replace(fit.fit, cost=fit.fit.cost * (1 + share * rounding)))
        cast = SimpleNamespace(fixed=lambda _: {}, failed={})
        selection._Bench.candidate(
            cast, fit.camera.lens, fit.observations, fit, [SimpleNamespace(solution=inner)], 4
        )
        assert len(done) == tried


# ------------------------------------------------------------------------------------ rigs
def test_cameras_that_have_the_board_apart(monkeypatch):
    """Both see the board's centre; a rig twice as large puts it elsewhere by a part of its distance."""
    for share, refused in ((LESS, False), (MORE, True)):
        # ahead of camera 0 at 1; camera 1, beside it, has it at (-b, 0, 1) where the rig says 2 b
        apart = share * known_rig.APART
        rig = Poses(np.tile(np.eye(3), (2, 1, 1)), np.array([[0, 0, 0], [-2 * apart, 0, 0.0]]))
        poses = [Pose(np.eye(3), np.array(t)) for t in ([0, 0, 1.0], [-apart, 0, 1.0])]
        pictures = SimpleNamespace(view=np.array([0, 0]), camera=np.array([0, 1]), poses=poses)
        data = SimpleNamespace(xyz=np.zeros((1, 3)), target=None)
        if refused:
            with pytest.raises(DataError, match="in another unit"):
                known_rig._check_scale(pictures, rig, data)
        else:
            known_rig._check_scale(pictures, rig, data)


def test_boards_that_stand_fast_before_moving_rigs(monkeypatch):
    camera = Poses(np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3)))
    robot = Poses(np.tile(np.eye(3), (4, 1, 1)), np.tile([0, 0, 2.0], (4, 1)))
    monkeypatch.setattr(rig_boards, "agreed_both", lambda g, c, _: (g, c))
    monkeypatch.setattr(rig_boards, "_solved", lambda *_: ("x", "z"))
    for share, fast in ((LESS, True), (MORE, False)):
        off = np.zeros((4, 6))
        off[:, 4] = share * rig_boards.FAST * 2.0
        monkeypatch.setattr(rig_boards, "residuals", lambda *_, o=off: o)
        assert (rig_boards._both(robot, camera, np.ones(4)) is not None) == fast


# ------------------------------------------------------------------------------------ times of pictures
@pytest.mark.parametrize(("bound", "units"), hand_eye.STAMPS)
def test_names_that_are_time_stamps(bound, units):
    assert hand_eye._time(f"{int(bound)}.png", None) == bound / units
    below = int(LESS * bound)
    if bound == hand_eye.STAMPS[-1][0]:
        with pytest.raises(UsageError, match="has none"):
            hand_eye._time(f"{below}.png", None)
    else:
        assert hand_eye._time(f"{below}.png", None) > below / units
