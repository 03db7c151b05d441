"""A prior from the fleet: better cameras from few views, and uncertainties that hold."""

import numpy as np
import pytest
import yaml

from camcal.batch import fleet
from camcal.batch.jobs import read_jobs
from camcal.batch.prior import regularised, write_fleet
from camcal.batch.run import run
from camcal.batch.storage import Storage
from camcal.report.loading import load_camera

from .cameras import write_camera


def drawn(count, between, error, seed=0):
    """True parameters of a fleet, their estimates, and the covariance of these."""
    rng = np.random.default_rng(seed)
    mean = np.array([800.0, 320.0, -0.2])
    truth = rng.multivariate_normal(mean, between, count)
    return (
        truth,
        truth + rng.multivariate_normal(np.zeros(3), error, count),
        np.broadcast_to(error, (count, 3, 3)),
    )


BETWEEN = np.diag([4.0, 3.0, 0.01]) ** 2
ERROR = np.array([[100.0, 40, 0.1], [40, 50, 0.05], [0.1, 0.05, 4e-4]])


def test_the_best_linear_estimate_and_its_covariance():
    truth, found, covariances = drawn(40_000, BETWEEN, ERROR)
    moved, left, between = regularised(found, covariances)
    np.testing.assert_allclose(np.sqrt(np.diag(between)), [4, 3, 0.01], rtol=0.05)
    wanted = ERROR - ERROR @ np.linalg.inv(ERROR + BETWEEN) @ ERROR  # with the true mean and T
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose((np.cov((moved - truth).T) - wanted) / size / size[:, None], 0, atol=0.03)
    np.testing.assert_allclose(np.diag(left[0]), np.diag(wanted), rtol=0.1)


def test_a_camera_that_is_known_well_stays():
    _, found, covariances = drawn(50, BETWEEN, 1e-8 * ERROR)
    moved, _, _ = regularised(found, covariances)
    np.testing.assert_allclose(moved, found, rtol=1e-6)


def test_equal_cameras_become_their_mean():
    _, found, covariances = drawn(200, 0 * BETWEEN, ERROR)
    moved, _, between = regularised(found, covariances)
    # the sampling of S leaves some of the errors' variance as scatter between cameras: less than a fifth
    assert (np.sqrt(np.diag(between)) < 0.45 * np.sqrt(np.diag(ERROR))).all()
    assert (moved.std(0) < 0.2 * found.std(0)).all()


def test_cameras_from_few_views_come_closer_to_the_truth(tmp_path):
    rng = np.random.default_rng(1)
    truth = {}
    for number in range(24):
        name = f"c{number:02d}"
        truth[name] = write_camera(
            tmp_path / f"{name}.csv", number, 800 + rng.normal(0, 1), views=3, noise=0.3
        )
    common = {"model": "pinhole", "checks": False, "crosscheck": False, "robust": "none"}
    entries = [{"name": n, "points": f"{n}.csv", **common, "fleet_prior": True} for n in truth]
    (tmp_path / "jobs.yaml").write_text(yaml.safe_dump({"jobs": entries}))
    rows = run(read_jobs(str(tmp_path / "jobs.yaml")), str(tmp_path / "out"))
    rows = fleet.with_fleet(rows, fleet.controls(rows))
    assert write_fleet(rows, Storage(str(tmp_path / "out"))) == 24
    errors = {
        where: np.array([load_camera(tmp_path / where / f"{n}.yaml").params[0] - truth[n] for n in truth])
        for where in ("out", "out/fleet")
    }
    assert errors["out/fleet"].std() < 0.5 * errors["out"].std()
    sigma = [
        yaml.safe_load((tmp_path / "out/fleet" / f"{n}.yaml").read_text())["camera"]["parameters"]["fx"][
            "sigma"
        ]
        for n in truth
    ]
    assert np.abs(errors["out/fleet"] / sigma).max() < 4.5


@pytest.mark.parametrize("count", [fleet.LEAST - 1, fleet.LEAST])
def test_a_type_that_is_too_small_has_no_prior(tmp_path, count):
    for number in range(count):
        write_camera(tmp_path / f"c{number}.csv", number, views=3)
    common = {"model": "pinhole", "checks": False, "crosscheck": False, "robust": "none", "fleet_prior": True}
    jobs = read_jobs(str(tmp_path), common)
    rows = fleet.with_fleet(run(jobs, str(tmp_path / "out")), ())
    assert write_fleet(rows, Storage(str(tmp_path / "out"))) == (count if count >= fleet.LEAST else 0)


def test_a_job_that_was_not_noted_before_a_kill_is_repeated_for_its_covariance(tmp_path):
    """Its report is there, but has no covariances: the camera would lack its prior after --resume."""
    write_camera(tmp_path / "c0.csv", 0, views=3)
    common = {"model": "pinhole", "checks": False, "crosscheck": False, "robust": "none", "fleet_prior": True}
    jobs, out = read_jobs(str(tmp_path), common), tmp_path / "out"
    (first,) = run(jobs, str(out))
    (again,) = run(jobs, str(out), resume=True, on_row=lambda *_: pytest.fail("repeated"))
    assert again == first and "covariance" in first
    for path in (out / "batch-state").iterdir():
        path.unlink()
    (after,) = run(jobs, str(out), resume=True)
    assert after["covariance"] == first["covariance"]
