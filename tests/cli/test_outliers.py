"""Data that lie: each kind is left out or used, but always named in the report and on the screen."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from camcal.data.writing import write_points
from camcal.model.placement import simulate_poses
from camcal.study.cameras import example_camera
from camcal.study.points import simulate_points

COLUMNS, ROWS = 9, 6
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0), [0.0]), -1).reshape(-1, 3)
CAMERA = example_camera("opencv5")
WHICH = 3  # the view that lies
NAME = "view04"


def boards(noise=lambda rng, shape: rng.normal(0, 0.2, shape), board=GRID, seed=1):
    """Twelve views; the one that lies holds the ideal points, whatever board it shows."""
    rng = np.random.default_rng(seed)
    poses = simulate_poses(GRID, CAMERA, rng, 12)
    data = simulate_points(CAMERA, GRID, poses, rng, clip=False)
    lying = CAMERA.project(poses[WHICH].apply(board))
    views = [
        replace(v, uv=(lying if i == WHICH else v.uv) + noise(rng, v.uv.shape))
        for i, v in enumerate(data.views)
    ]
    return data.with_views(tuple(views))


def reordered(change):
    """The corners of the lying view, as (rows, columns, 2), changed."""
    data = boards()
    uv = change(data.views[WHICH].uv.reshape(ROWS, COLUMNS, 2).copy()).reshape(-1, 2)
    return data.with_views(tuple(replace(v, uv=uv) if v.id == NAME else v for v in data.views))


def shifted_row(grid):
    grid[2, :-1] = grid[2, 1:].copy()
    return grid


def shifted_rows(grid):
    return np.concatenate([grid[:2], grid[3:], grid[2:3]])


def swapped(grid):
    grid[0, 5], grid[4, 4] = grid[4, 4].copy(), grid[0, 5].copy()
    return grid


def twice():
    data = boards()
    return data.with_views((*data.views, replace(data.views[WHICH], id="again")))


def mirrored_picture(grid):
    grid[..., 0] = 639 - grid[..., 0]
    return grid[:, ::-1]  # found in good order: the board looks the same from behind


def disorder(grid):
    return np.random.default_rng(0).permutation(grid.reshape(-1, 2))


LIES = {
    "uniform noise": (
        lambda: boards(lambda rng, shape: rng.uniform(-0.35, 0.35, shape)),
        "light-tailed-residuals",
        "uniform noise 1.4",
    ),
    "heavy-tailed noise": (
        lambda: boards(lambda rng, shape: 0.1 * rng.standard_t(3, shape)),
        "heavy-tailed-residuals",
        "more frequent",
    ),
    "a shifted row": (
        lambda: reordered(shifted_row),
        "mismatched-points",
        "18, 19, 20, 21, 22, 23, 24, 25 match the points displaced by (1, 0, 0)",
    ),
    "shifted rows": (lambda: reordered(shifted_rows), "mismatched-points", "displaced by (0, -1, 0)"),
    "two swapped corners": (lambda: reordered(swapped), "mismatched-points", "5 and 40 are swapped"),
    "another board": (lambda: boards(board=GRID * [1, 1.1, 1]), "other-board", "1.1 times as long in y"),
    "nearly the same board": (
        # fits a pose to .8 px, bends fx by 3.5 px, and is known only once the others have been seen
        lambda: boards(board=GRID * [1, 1.05, 1], seed=2),
        "other-board",
        "1.051 times as long in y",
    ),
    "points in disorder": (lambda: reordered(disorder), "other-board", "out of order"),
    "a mirrored order": (lambda: reordered(lambda g: g[:, ::-1]), "mirrored-views", f"behind: {NAME}"),
    "a mirrored picture": (lambda: reordered(mirrored_picture), "rejected-mirror-image", "as a mirror image"),
    "a view taken twice": (twice, "repeated-view", f"again ({NAME})"),
}


@pytest.fixture
def estimate(camcal, tmp_path):
    """The report, and what is on the screen, of points written to a table."""

    def run(data, *more):
        path, report = tmp_path / "points.csv", tmp_path / "report.yaml"
        write_points(path, data)
        args = ["estimate", path, "--image-size", "640x480", "--no-crosscheck", "--holdout", "0", *more]
        code, out, err = camcal(*args, "-o", report)
        assert code == 0, err
        return yaml.safe_load(report.read_text()), out + err

    return run


@pytest.mark.parametrize("name", LIES)
def test_each_lie_is_named_and_harmless(estimate, name):
    make, code, words = LIES[name]
    report, screen = estimate(make())
    warning = next(w for w in report["warnings"] if w["code"] == code)
    assert words in warning["message"]
    assert warning["hint"]
    assert code in screen
    # at 0.2 px noise fx has a sigma of .6 px
    assert report["camera"]["parameters"]["fx"]["value"] == pytest.approx(CAMERA.params[0], abs=1.8)


def test_what_is_rejected_stands_in_the_report(estimate):
    report, _ = estimate(reordered(swapped))
    entry = next(v for v in report["views"] if v["id"] == NAME)
    assert entry["rejected_points"] == 2
    assert [r["row"] for r in entry["rejected"]] == [5, 40]
    assert all(np.hypot(*r["residual"]) > 50 for r in entry["rejected"])


def test_a_view_that_is_left_out_has_its_reason_and_residual(estimate):
    report, _ = estimate(boards(board=GRID * [1, 1.1, 1]))
    entry = next(v for v in report["views"] if v["id"] == NAME)
    assert entry["status"] == "rejected"
    assert "another board" in entry["reason"]
    assert entry["rms_point"] > 1


def test_clean_views_get_no_warning(estimate):
    report, _ = estimate(boards())
    assert report["warnings"] == []
    assert report["fit"]["points_rejected"] == 0
