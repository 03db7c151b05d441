"""From rays and pixels of one model to the parameters of another."""

import numpy as np
import pytest

from camcal.model import lenses
from camcal.model.lenses.regress import measure, minima, regress


def pairs(model, index=0, columns=30, rows=20):
    lens = lenses.make(model)
    params, size = lens.examples()[index]
    u, v = np.linspace(0, size[0] - 1, columns), np.linspace(0, size[1] - 1, rows)
    uv = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    rays, valid = lens.unproject(params, uv)
    return rays[valid], uv[valid], size


SPECS = [
    "pinhole", "opencv4", "opencv5", "opencv8", "brown:radial=2,decentering=1", "kb4", "kb:6", "ucm", "eucm",
    "ds", "mei", "fov", "division:1", "division:3", "division:2,direction=distort", "scaramuzza",
    "radial-profile", "radial-profile:6,centre=free", "rational-function", "bicubic", "polynomial:2",
]  # fmt: skip


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("spec", SPECS)
def test_finds_a_camera_of_its_own_model(spec, index):
    """From nothing but rays and pixels; parameters that the model's gauge holds are freed."""
    rays, uv, size = pairs(spec, index)
    lens = lenses.make(spec)
    hold = [n for n in lens.default_fixed if n == "reach"]
    found = regress(lens, rays, uv, size, hold=hold)
    assert found.covered.all()
    # px; hundredths are below what calibrations reach, and the valleys of mei and of splines are flat
    assert found.rms < (2e-2 if spec.startswith(("radial-profile", "mei")) else 1e-3)


@pytest.mark.parametrize(
    "source, index, target, bound",
    [
        # how well one model can stand for another, px rms over the picture: a little above what was measured
        ("kb4", 0, "ds", 0.04),
        ("kb4", 0, "eucm", 0.06),
        ("kb4", 0, "mei", 0.02),
        ("kb4", 0, "opencv8", 0.01),
        ("kb4", 0, "scaramuzza:6", 0.01),
        ("kb4", 1, "kb:6", 1e-6),
        ("opencv5", 0, "opencv14", 1e-6),
        ("opencv5", 0, "kb4", 0.5),
        ("opencv5", 0, "radial-profile", 0.5),
        ("opencv5", 0, "spline:8x6", 0.1),
    ],
)
def test_one_model_for_another(source, index, target, bound):
    rays, uv, size = pairs(source, index)
    found = regress(lenses.make(target), rays, uv, size)
    assert found.covered.all()
    assert found.rms < bound


def test_a_perspective_model_takes_what_it_can():
    """Rays of 128 degrees from the axis are no pinhole camera's: the others still come out roughly right."""
    rays, uv, size = pairs("kb4", 1)
    found = regress(lenses.make("opencv5"), rays, uv, size)
    assert not found.covered.all()
    assert 0.3 < found.covered.mean() < 0.9
    assert found.rms < 30  # px of 1032; a polynomial that gives up those beyond 60 degrees could have 1


def test_many_rays_are_thinned_but_all_measured():
    rays, uv, size = pairs("kb4", 0, 100, 60)
    found = regress(lenses.make("kb4"), rays, uv, size)
    assert found.errors.shape == (len(rays),) and found.rms < 1e-6
    np.testing.assert_array_equal(measure(lenses.make("kb4"), found.params, rays, uv).params, found.params)


def test_a_start_is_followed():
    rays, uv, size = pairs("ds")
    lens = lenses.make("ds")
    begin = lens.examples()[0][0] * 1.01
    assert regress(lens, rays, uv, size, start=begin).rms < 1e-6


def test_both_minima_of_the_double_sphere_are_found():
    lens = lenses.make("ds")
    params, size = lens.examples()[0]
    uv = np.stack(np.meshgrid(np.linspace(0, size[0], 15), np.linspace(0, size[1], 12)), -1).reshape(-1, 2)
    rays, seen = lens.unproject(params, uv)
    found = minima(lens, rays[seen], uv[seen], size)
    assert np.allclose(found[0], params, rtol=1e-6)
    # the other is a sphere on the other side, less than the noise of a corner away
    assert found[1][lens.index("xi")] > 0.1
    apart = np.linalg.norm(lens.project(found[1], rays[seen])[0] - uv[seen], axis=1)
    assert 1e-4 < np.median(apart) < 0.2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "spec", ["rational-function", "bicubic", "spline:5x4", "scaramuzza", "opencv8", "ds"]
)
@pytest.mark.parametrize("kind", ["few", "one plane", "noise", "behind"])
def test_data_that_determine_no_camera(spec, kind):
    """Too few rays, rays of one plane, pixels by chance: some result, no numerical accident."""
    rng = np.random.default_rng(4)
    count = {"few": 5}.get(kind, 40)
    angle = rng.uniform(2.0, 2.8, count) if kind == "behind" else rng.uniform(0, 1.4, count)
    turn = np.full(count, 0.3) if kind == "one plane" else rng.uniform(0, 2 * np.pi, count)
    rays = np.c_[np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)]
    uv = rng.uniform(0, 1000, (count, 2)) if kind in ("few", "noise") else 300 * rays[:, :2] + 400
    lens = lenses.make(spec)
    found = regress(lens, rays, uv, (1000, 800))
    assert found.params.shape == (lens.size,) and np.isfinite(found.score)
    assert all(np.isfinite(p).all() for p in minima(lens, rays, uv, (1000, 800)))
