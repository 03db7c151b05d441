"""The Python interface and the order of things: `camcal.calibrate` on simulated cameras."""

import numpy as np
import pytest

import camcal
from camcal.errors import DataError, EstimationError, UsageError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.placement import simulate_poses
from camcal.solve.refine import refine
from camcal.study.points import simulate_points

SIZE = (640, 480)
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2)
TRUTH = {"opencv5": [533.0, 534.0, 341.0, 234.0, -0.28, 0.1, 1e-3, -5e-4, -0.02]}
TRUTH["pinhole"] = TRUTH["opencv5"][:4]


def boards(model="opencv5", views=10, noise=0.0, seed=0, board=None):
    """Views of a 9x6 board and the true camera; nothing is random but by the seed."""
    rng = np.random.default_rng(seed)
    lens = lenses.make(model)
    params = np.array(TRUTH[model])
    board = np.c_[GRID, np.zeros(54)] if board is None else board
    made = []
    while len(made) < views:
        rotation = rotations.exp(rng.uniform(-0.6, 0.6, 3))
        centre = np.array([*rng.uniform(-2, 2, 2), rng.uniform(12, 20)])
        uv, valid = lens.project(params, (board - board.mean(0)) @ rotation.T + centre)
        if valid.all() and (uv >= 0).all() and (uv < SIZE).all():
            made.append((board, uv + rng.normal(0, noise, uv.shape)))
    return made, params


@pytest.mark.parametrize("model", sorted(TRUTH))
def test_exact_data_give_the_exact_camera(model):
    made, params = boards(model)
    found = camcal.calibrate(camcal.Correspondences.from_views(made, SIZE), model=model)
    # the digits that the weakest parameter, k3, keeps: 1e-16 of u times its sigma for 1 px of noise
    assert np.abs(found.camera.params - params).max() < 1e-6
    assert found.rms_point < 1e-9
    assert found.fit.converged


def test_noisy_data_are_within_their_sigmas():
    from camcal.assess.covariance import covariance

    made, params = boards(noise=0.1, views=20)
    found = camcal.calibrate(camcal.Correspondences.from_views(made, SIZE))
    sigmas = np.array(list(covariance(found).sigmas.values()))
    assert (np.abs(found.camera.params - params) < 4.5 * sigmas).all()  # 1 in 16,000 for 9 parameters
    assert found.rms_point == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_the_pieces_of_a_solution_fit_together():
    made, _ = boards(noise=0.1)
    data = camcal.Correspondences.from_views(made, SIZE)
    found = camcal.calibrate(data)
    assert len(found.poses) == len(data) and len(found.residuals) == data.point_count
    for pose, residual, view in zip(found.poses, data.split(found.residuals), data.views, strict=True):
        again = found.camera.project(pose.apply(view.xyz)) - view.uv
        np.testing.assert_allclose(again, residual, atol=1e-10)  # px; rounding of coordinates of 1e3
    assert [s.name for s in found.stages] == ["zhang", "refine"]
    assert found.stages[-1].rms_point == found.rms_point


def test_the_order_of_views_does_not_matter():
    made, _ = boards(noise=0.1)
    a = camcal.calibrate(camcal.Correspondences.from_views(made, SIZE), robust="auto")
    b = camcal.calibrate(camcal.Correspondences.from_views(made[::-1], SIZE), robust="auto")
    # both stop within 1e-14 of the same cost, hence within 1e-5 of a sigma
    np.testing.assert_allclose(a.camera.params, b.camera.params, rtol=1e-6, atol=1e-6)


def test_fixed_parameters_stay_and_aspect_ties():
    made, _ = boards(noise=0.1)
    data = camcal.Correspondences.from_views(made, SIZE)
    found = camcal.calibrate(data, fix={"k3": 0.25, "cx": 330.0, "aspect": None})
    values = found.camera.values
    assert (values["k3"], values["cx"]) == (0.25, 330.0)
    assert values["fx"] == pytest.approx(values["fy"], rel=1e-14)


def test_boards_far_from_the_origin_keep_their_digits():
    """A national grid: the same camera although the coordinates are 1e6 larger than the board."""
    made, params = boards()
    moved = [(xyz + [4.5e6, 5.3e6, 300.0], uv) for xyz, uv in made]
    found = camcal.calibrate(camcal.Correspondences.from_views(moved, SIZE))
    # the coordinates themselves are rounded to 1e-9, 1e-8 px in the image
    assert np.abs(found.camera.params[:4] - params[:4]).max() < 1e-4
    assert found.rms_point < 1e-6


def test_views_of_different_lengths_and_sigmas():
    made, params = boards(noise=0.0, views=12)
    rng = np.random.default_rng(5)
    views = []
    for i, (xyz, uv) in enumerate(made):
        keep = rng.random(54) < (0.6 if i % 3 else 1.0)
        sigma = rng.choice([0.02, 1.0], keep.sum())  # half of the points tell next to nothing
        views.append((xyz[keep], uv[keep] + rng.normal(0, 1, (keep.sum(), 2)) * sigma[:, None], sigma))
    weighted = camcal.calibrate(camcal.Correspondences.from_views(views, SIZE))
    plain = camcal.calibrate(camcal.Correspondences.from_views([v[:2] for v in views], SIZE))
    error = [np.linalg.norm(s.camera.params[:4] - params[:4]) for s in (weighted, plain)]
    assert error[0] < 0.3 * error[1]  # sigmas of about 1 : 14 are expected


def test_unusable_views_are_left_out_and_said():
    made, _ = boards()
    made.append((np.c_[np.arange(5.0), np.zeros((5, 2))], np.c_[np.arange(5.0) * 9, np.full(5, 3.0)]))
    found = camcal.calibrate(camcal.Correspondences.from_views(made, SIZE))
    (skipped,) = found.observations.skipped
    assert skipped.status == "rejected" and "line" in skipped.reason
    assert len(found.poses) == len(made) - 1


def test_a_left_handed_frame_is_refused():
    rng = np.random.default_rng(2)
    xyz = rng.uniform(-1, 1, (30, 3))
    cam = xyz * [1, 1, -1] + [0, 0, 5]
    uv = cam[:, :2] / cam[:, 2:] * 500 + [320, 240]
    with pytest.raises(DataError, match="left-handed"):
        camcal.calibrate(camcal.Correspondences.from_views([(xyz, uv)], SIZE), model="pinhole")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"model": "opencv6"}, "unknown model 'opencv6'"),
        ({"fix": {"k9": None}}, "model 'opencv5' has no parameter 'k9'"),
        ({"robust": "maybe"}, "unknown robust method 'maybe'"),
        ({"optimizer": "magic"}, "unknown optimizer 'magic'"),
        ({"board_shape": "round"}, "unknown board shape 'round'"),
    ],
)
def test_what_does_not_exist_is_named(change, said):
    made, _ = boards()
    with pytest.raises(UsageError, match=said):
        camcal.calibrate(camcal.Correspondences.from_views(made, SIZE), **change)


def test_too_few_points_for_the_unknowns():
    made, _ = boards(views=3)
    few = [(xyz[[0, 8, 45, 53]], uv[[0, 8, 45, 53]]) for xyz, uv in made]
    with pytest.raises(EstimationError, match="unknowns"):
        camcal.calibrate(camcal.Correspondences.from_views(few, SIZE), model="opencv8")


def test_a_board_that_is_not_flat_is_found():
    board = np.c_[GRID, np.zeros(54)]
    rng = np.random.default_rng(9)
    bent = board + rng.normal(0, 0.004, board.shape)
    made, params = boards(noise=0.03, views=14, board=bent)
    ideal = [(board, uv) for _, uv in made]
    data = camcal.Correspondences.from_views(ideal, SIZE)
    flat = camcal.calibrate(data)
    auto = camcal.calibrate(data, board_shape="auto")
    assert auto.observations.target["shape"]["kind"] == "free"
    assert auto.rms_point < 0.5 * flat.rms_point
    assert (
        np.abs(auto.camera.params[:4] - params[:4]).max() < np.abs(flat.camera.params[:4] - params[:4]).max()
    )


def test_a_flat_board_stays_flat():
    made, _ = boards(noise=0.1, views=12)
    found = camcal.calibrate(camcal.Correspondences.from_views(made, SIZE), board_shape="auto")
    assert found.observations.target["shape"]["kind"] == "flat"


def test_events_tell_how_far_it_is():
    made, _ = boards(noise=0.1, views=6)
    heard = []
    data = camcal.Correspondences.from_views(made, SIZE)
    listen = lambda name, details: heard.append((name, details))  # noqa: E731
    found = camcal.calibrate(data, on_event=listen, model="opencv5")
    assert [name for name, _ in heard] == ["refined", "checked"]
    assert heard[0][1] == {"rms_point": found.rms_point, "points": 324, "rejected": 0}


@pytest.mark.parametrize("robust", ["none", "auto", "huber"])
def test_the_better_of_two_minima_is_taken(robust):
    # of these seeds the closed form of each leads to the double sphere's wrong minimum
    lens = lenses.make("ds")
    truth = camcal.Camera(lens, *lens.examples()[0])
    board = np.c_[GRID, np.zeros(54)]
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        poses = simulate_poses(board, truth, rng, 12)
        data = simulate_points(truth, board, poses, rng, noise=0.2)
        best = refine(truth, poses, data)
        found = camcal.calibrate(data, model="ds", robust=robust)
        # outliers are rejected beyond some sigmas, so that a Gaussian point or two may be missing; a loss weighs
        # points down, and its rms over all of them is not the least
        assert found.rms_point == pytest.approx(best.rms_point, rel=1e-6 if robust == "none" else 0.02)
        assert (found.observations.weight is not None) == (robust == "huber")
        assert found.camera.values["xi"] < 0 and found.camera.values["fx"] == pytest.approx(365, rel=0.05)
