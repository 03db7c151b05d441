"""The interval of a focal length that two views leave uncertain."""

from types import SimpleNamespace

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import focal_interval as module
from camcal.routes import selfcalib
from camcal.routes.bundle import Bundle, Tracks, adjust
from camcal.routes.focal_interval import focal_interval
from tests.sides import LESS, MORE

SIZE, F = (1280, 960), 1000.0


@pytest.fixture(scope="module")
def bundle():
    """Three views of thirty points, 1 px of noise, adjusted over f."""
    rng = np.random.default_rng(3)
    camera = Camera(lenses.make("pinhole"), np.array([F, F, 639.5, 479.5]), SIZE)
    world = rng.uniform(-1, 1, (30, 3)) + [0, 0, 4]
    turn = [0.0, 0.25, -0.3]
    poses = [
        Pose(np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]), np.array(t))
        for a, t in zip(turn, ([0, 0, 0], [-1.1, 0.3, 0.4], [1.3, -0.2, 0.5]), strict=True)
    ]
    uv = np.concatenate([camera.project(p.apply(world)) for p in poses]) + rng.normal(0, 1.0, (90, 2))
    tracks = Tracks(np.repeat(np.arange(3), 30), np.tile(np.arange(30), 3), uv)
    start = Bundle(
        camera, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]), world
    )
    free = np.array([[1.0], [1.0], [0], [0]])
    return adjust(start, tracks, free).state, tracks, free


def excess(bundle, focal):
    state, tracks, free = bundle
    best = np.square(state.residuals(tracks)).sum()
    held = module._with_focal(state, tracks, free[:, :0], focal)[1]
    return (held / best - 1) * (2 * 90 - 3 * 30 - 6 * 3 - 1 + 7)


def test_both_ends_are_as_unlikely(bundle):
    """t² of 78 degrees of freedom is 1.99²; the upper half is the longer one."""
    f = bundle[0].camera.params[0]
    low, high = focal_interval(*bundle, sigma=0.05 * f)
    assert low < F < high and high - f > f - low
    for end in (low, high):
        assert excess(bundle, end) == pytest.approx(1.99**2, rel=2 * module.CLOSE)


def test_a_focal_length_that_is_well_known_has_a_symmetric_interval(bundle):
    f = bundle[0].camera.params[0]
    for share, symmetric in ((LESS, True), (MORE, False)):
        low, high = focal_interval(*bundle, sigma=share * module.NEARLY_SYMMETRIC * f)
        assert (abs((high - f) / (f - low) - 1) < 1e-9) == symmetric


def test_a_focal_length_without_an_upper_limit(bundle, monkeypatch):
    """Residuals that do not depend on f: the search ends at 1 / f² = 0."""
    state, tracks, _ = bundle
    same = float(np.square(state.residuals(tracks)).sum())
    monkeypatch.setattr(module, "_with_focal", lambda at, *_: (at, same))
    assert focal_interval(*bundle, sigma=0.2 * F)[1] == np.inf


@pytest.mark.parametrize(("share", "refused"), [(LESS, False), (MORE, True)])
def test_the_widest_interval(bundle, monkeypatch, share, refused):
    state, tracks, _ = bundle
    f = float(state.camera.params[0])
    found = SimpleNamespace(bundle=state, used=np.ones(90, bool), covariance=np.eye(4), fixed=())
    ends = f * (1 - 0.1), f * (1 + share * selfcalib.WIDEST)
    monkeypatch.setattr(selfcalib, "focal_interval", lambda *_: ends)
    monkeypatch.setattr(selfcalib, "replace", lambda _, interval: interval)
    held = {"cx": None, "cy": None, "aspect": None}
    if refused:
        with pytest.raises(EstimationError, match="95 % interval"):
            selfcalib._with_interval(found, tracks, held)
    else:
        assert selfcalib._with_interval(found, tracks, held) == ends
