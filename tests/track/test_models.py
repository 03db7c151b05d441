"""What is tracked: derivatives, moves and their inverses, and the link to Central and Column."""

import numpy as np
import pytest

from camcal.model import lenses
from camcal.start.central import Central
from camcal.track import decompose, motion
from camcal.track.decompose import Cameras
from camcal.track.frames import Frame
from camcal.track.matrix_model import MatrixModel
from camcal.track.physical_model import Physical, PhysicalModel
from camcal.track.table import Table, inverse_left_jacobian

from .helpers import round_trip, sequence

BENT = "opencv5"


def matrix_model():
    (frame,), (truth,) = sequence("static", 1, noise=0.0)
    model = MatrixModel()
    model.settle(frame)
    return model, model.from_matrix(truth.matrix), frame


def physical_model(spec="pinhole", skew=False, **fixed):
    (frame,), (truth,) = sequence("static", 1, noise=0.0)
    lens = lenses.make(spec, skew)
    model = PhysicalModel(lens, None, fixed)
    model.settle(frame)
    params = lens.from_matrix(truth.k)
    params[4 + skew :] = np.linspace(-0.1, 0.05, lens.size - 4 - skew)
    return model, Physical(params, truth.rotation, truth.translation), frame


MODELS = {
    "matrix": matrix_model,
    "pinhole": physical_model,
    "bent": lambda: physical_model(BENT),
    "skew": lambda: physical_model(BENT, skew=True),
    "aspect": lambda: physical_model(aspect=None),
    "held": lambda: physical_model(BENT, fx=900.0, k1=0.0),
}
every_model = pytest.mark.parametrize("name", MODELS)


@every_model
def test_design_is_the_derivative_of_the_projection(name):
    model, x, frame = MODELS[name]()
    design, valid = model.linearise(x, frame)
    assert valid.all()
    for i in range(model.size):
        # scaled so that a step moves the points by about 1e-3 px: central differences then lose 1e-7
        size = 1e-3 / np.abs(design[i]).max()
        ahead, behind = (
            model.linearise(model.retract(x, s * size * np.eye(model.size)[i]), frame)[0][-1] for s in (1, -1)
        )
        np.testing.assert_allclose(
            design[i], (behind - ahead) / (2 * size), atol=1e-6 * np.abs(design[i]).max()
        )


@every_model
def test_local_undoes_retract(name):
    model, x, _ = MODELS[name]()
    rng = np.random.default_rng(1)
    for size in (1e-9, 1e-3, 0.2):
        delta = size * rng.normal(size=model.size)
        np.testing.assert_allclose(model.local(x, model.retract(x, delta)), delta, atol=1e-12)


@every_model
def test_packs_to_the_last_bit(name):
    _, x, _ = MODELS[name]()
    again = round_trip({"x": x})["x"]
    assert type(again) is type(x)
    assert all(np.array_equal(a, b) for a, b in zip(again, x, strict=True))


def test_rows_are_those_of_central_over_the_depth():
    """The identity the matrix model rests on: Central with the projected points, divided by the depth."""
    model, x, frame = matrix_model()
    rng = np.random.default_rng(2)
    seen = Frame(0, frame.xyz, frame.uv + rng.normal(0, 0.3, frame.uv.shape))
    design, _ = model.linearise(x, seen)
    keep = np.ones(len(frame), bool)
    xyz, measured = model.normalise(seen, keep)
    _, projected = model.normalise(frame, keep)
    depth = np.repeat(xyz @ x[8:] + 1, 2)
    jacobian = design[:11].transpose(2, 1, 0).reshape(-1, 11)
    np.testing.assert_allclose(
        jacobian * model.per_pixel * depth[:, None], Central(xyz, projected), atol=1e-9
    )
    # and with the measured ones, the residual of Central is the pixel's times the depth
    algebraic = measured.ravel() - Central(xyz, measured) @ x
    residual = design[11].T.ravel() * model.per_pixel
    np.testing.assert_allclose(algebraic, residual * depth, atol=1e-9)


def test_split_composes_back():
    rng = np.random.default_rng(3)
    k = np.array([[800.0, 3, 300], [0, 780, 250], [0, 0, 1]])
    rotation = np.linalg.qr(rng.normal(size=(7, 3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))[:, None, None]
    pose = np.concatenate([rotation, rng.normal(size=(7, 3, 1))], -1)
    found = decompose.split(2.5 * k @ pose)
    np.testing.assert_allclose(found[0], np.broadcast_to(k, (7, 3, 3)), rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(found[1], rotation, atol=1e-12)
    np.testing.assert_allclose(found[2], pose[..., 3], atol=1e-12)


def test_matrix_coordinates_follow_the_physical_ones():
    """The derivative that carries the motion over to the matrix, against differences."""
    model, x, _ = matrix_model()
    k, rotation, translation = decompose.split(model.to_matrix(x))
    tangent = model.tangent(k, np.c_[rotation, translation])
    physical = PhysicalModel(lenses.make("pinhole", True))
    start = Physical(physical.lens.from_matrix(k), rotation, translation)
    order = [0, 1, 4, 2, 3, 5, 6, 7, 8, 9, 10]  # the lens has skew last
    for i in range(11):
        unit = np.zeros(11)
        unit[order[i]] = 1e-5
        ahead, behind = (physical.retract(start, s * unit) for s in (1, -1))
        matrices = [
            physical.lens.matrix(y.params) @ np.c_[y.rotation, y.translation] for y in (ahead, behind)
        ]
        slope = (model.from_matrix(matrices[0]) - model.from_matrix(matrices[1])) / 2e-5
        np.testing.assert_allclose(tangent[:, i], slope, atol=1e-8 * max(1, np.abs(slope).max()))


@pytest.mark.parametrize("name", ["matrix", "skew"])
def test_a_motion_means_the_same_in_both_models(name):
    model, x, _ = MODELS[name]()
    figures = {**dict.fromkeys(motion.GROUPS, 0.0), "focal": 0.01, "rotation": 0.5, "principal": 2.0}
    columns = model.motion(x, figures)
    cameras = model.describe([x], [np.hstack([columns, np.zeros((model.size, model.size))])])
    sigma = np.linalg.norm(cameras.factor[0], axis=1)[:11]
    focal = cameras.k[0, 0, 0]
    expected = [0.01 * focal, 0.01 * focal, 0, 2, 2, *[np.deg2rad(0.5)] * 3, 0, 0, 0]
    np.testing.assert_allclose(sigma, expected, atol=1e-8 * focal)


def test_unknown_motions_and_groups_are_refused():
    from camcal.errors import UsageError

    for motions, drift, said in (
        ("thermel", {}, "unknown motion 'thermel'"),
        ("thermal", {"fokal": 1.0}, "unknown group of parameters 'fokal'"),
        ("thermal", {"focal": -1.0}, "focal=-1.0 is negative"),
    ):
        with pytest.raises(UsageError, match=said):
            motion.figures(motions, drift)


def test_sigmas_of_the_table_are_those_of_its_numbers():
    """First-order propagation against a sample of ten thousand cameras."""
    model, x, _ = physical_model(BENT)
    rng = np.random.default_rng(4)
    size = np.array([0.5, 0.5, 0.3, 0.3, *[1e-3] * 5, *[3e-4] * 3, *[2e-3] * 3])
    mix = np.eye(model.size) + 0.3 * rng.normal(size=(model.size, model.size))
    factor = 0.2 * size[:, None] * mix
    draws = [model.retract(x, factor @ rng.normal(size=model.size)) for _ in range(10_000)]
    table = Table(model)
    cameras = model.describe(draws, [factor] * len(draws))
    count = 23 + len(model.extra_names)
    sample = table._numbers(cameras)[:, :count]
    stated = table._numbers(model.describe([x], [factor]))[0, count : 2 * count]
    # standard deviation of a sample's standard deviation: 0.7 %; five of them
    np.testing.assert_allclose(sample.std(0), stated, rtol=0.035, atol=1e-12)


def test_inverse_left_jacobian_against_differences():
    from camcal.geometry import rotations

    rng = np.random.default_rng(5)
    vectors = rng.normal(size=(6, 3))
    vectors *= np.array([1e-7, 1e-3, 0.5, 1.0, 2.0, 3.1])[:, None] / np.linalg.norm(vectors, axis=1)[:, None]
    found = inverse_left_jacobian(vectors)
    for v, j in zip(vectors, found, strict=True):
        step = 1e-6 * np.eye(3)
        slope = (rotations.log(rotations.exp(step) @ rotations.exp(v)) - v) / 1e-6
        np.testing.assert_allclose(j, slope.T, atol=5e-6)


def test_matrix_without_depth_at_the_origin_is_scaled_by_its_norm():
    k, rotation = np.eye(3)[None] * [900.0, 900.0, 1.0], np.eye(3)[None]
    cameras = Cameras(k, rotation, np.array([[1.0, 2.0, 0.0]]), np.eye(11)[None], np.zeros((1, 0)))
    from camcal.track.table import _scaled

    matrix, derivative = _scaled(cameras)
    assert np.linalg.norm(matrix) == pytest.approx(1)
    assert np.isfinite(derivative).all()


def test_every_column_is_documented():
    from pathlib import Path

    from camcal.track.table import COLUMNS

    page = (Path(__file__).parents[2] / "docs" / "tracking.md").read_text(encoding="utf-8")
    for name, text in COLUMNS.items():
        assert f"| `{name}` | {text} |" in page
