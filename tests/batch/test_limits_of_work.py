"""What a batch asks of clusters, disks and frames, and the efficiencies of robust figures."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from camcal.batch import executors, fleet, grabber, work
from camcal.errors import UsageError


def test_the_efficiencies_of_medians():
    """Of 2,000 samples of 101 normal numbers each; the figures of large samples hold to a tenth."""
    sample = np.random.default_rng(0).normal(size=(2000, 101))
    middle = np.median(sample, axis=1)
    mad = np.median(np.abs(sample - middle[:, None]), axis=1)
    # the relative variance of a standard deviation is 1 / (2 n)
    efficiency = 1 / (2 * 101 * mad.var() / mad.mean() ** 2)
    assert pytest.approx(efficiency, rel=0.1) == fleet.MAD_EFFICIENCY
    assert pytest.approx(101 * middle.var(), rel=0.1) == fleet.MEDIAN_VARIANCE


@pytest.mark.parametrize(("width", "still"), [(grabber.WIDTH, True), (10 * grabber.WIDTH, False)])
def test_the_width_at_which_frames_are_compared(monkeypatch, width, still):
    """Noise of five grey levels is no motion; at the width of the pictures it would be."""
    monkeypatch.setattr(grabber, "WIDTH", width)
    noise = np.random.default_rng(0).normal(100, 5, (2, 480, 640)).clip(0, 255).astype(np.uint8)
    selector = grabber.Selector()
    assert [selector.wants(frame) for frame in noise] == [False, still]


def cluster(monkeypatch, answers_after):
    """A stand-in for Dask's client, which reaches its scheduler after so many seconds."""
    asked = {}

    class Client:
        def __init__(self, address, timeout, set_as_default):
            if answers_after > timeout:
                raise TimeoutError

        def get_executor(self, pure, retries):
            asked["retries"] = retries
            return SimpleNamespace()

    scheduler = ModuleType("distributed.scheduler")
    scheduler.KilledWorker = RuntimeError
    package = ModuleType("distributed")
    package.Client, package.scheduler = Client, scheduler
    monkeypatch.setitem(sys.modules, "distributed", package)
    monkeypatch.setitem(sys.modules, "distributed.scheduler", scheduler)
    executors.Cluster("tcp://host:8786")
    return asked["retries"]


def test_a_cluster_that_answers_in_time(monkeypatch):
    """A job whose worker is lost is given to three others: a fourth loss is the job's own."""
    assert cluster(monkeypatch, executors.CONNECT) == 3
    with pytest.raises(UsageError, match="no Dask scheduler answers"):
        cluster(monkeypatch, executors.CONNECT + 0.1)
    assert executors.CONNECT == 10  # as long as Dask's own tools wait, of which a busy one takes a second


def test_reports_that_are_written_at_a_time(monkeypatch, tmp_path):
    """Only the time depends on it: one after the other all are there too."""
    for writers in (1, work.WRITERS):
        monkeypatch.setattr(work, "WRITERS", writers)
        monkeypatch.setattr(work, "_reported", lambda some, _: [(job, row, job.name) for job, row in some])
        kept = []
        monkeypatch.setattr(work, "_keep", lambda job, row, text, storage, k=kept: k.append(text))
        jobs = [SimpleNamespace(name=str(i), type="", digest="") for i in range(20)]
        monkeypatch.setattr(work, "_together", lambda _: {})
        rows = work.run_jobs(jobs, str(tmp_path))
        assert sorted(kept) == sorted(r["name"] for r in rows) and len(kept) == 20
