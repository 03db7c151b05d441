"""How many samples a first camera is drawn from, and how often a state is written: just below and just above."""

import numpy as np
import pytest

from camcal.cli.boundary import run
from camcal.errors import CamcalError, UsageError
from camcal.settings.tracking import FROM_FILE, FROM_PIPE
from camcal.track import first


def test_samples_of_a_first_camera():
    """Of 40 % outliers all samples hold one in a thousand frames at most; of a twentieth fewer in more."""
    bad = 1 - 0.6**first.SAMPLE
    assert bad**first.SAMPLES <= 1e-3 < bad ** (0.95 * first.SAMPLES)


def test_points_of_a_sample():
    """Twelve equations determine the eleven numbers of a matrix, and ten do not."""
    xyz = np.random.default_rng(0).uniform(-1, 1, (first.SAMPLE, 3))
    uv = 500 * xyz[:, :2] / (xyz[:, 2:] + 4)
    found = first.projection_matrix(xyz, uv)
    image = np.c_[xyz, np.ones(len(xyz))] @ found.T
    np.testing.assert_allclose(image[:, :2] / image[:, 2:], uv, atol=1e-6)
    with pytest.raises(CamcalError):
        first.projection_matrix(xyz[:-1], uv[:-1])


@pytest.mark.parametrize(("source", "every"), [("-", FROM_PIPE), ("frames.csv", FROM_FILE)])
def test_frames_between_checkpoints(monkeypatch, tmp_path, source, every):
    """Frames of a pipe cannot be read again, so that each is kept; of a file the last thousand can."""
    given = []

    def follower(*_, **options):
        given.append(options["every"])
        raise UsageError("enough", "")

    monkeypatch.setattr("camcal.track.follow.Follower", follower)
    (tmp_path / "frames.csv").write_text("frame,X,Y,Z,u,v\n")
    frames = source if source == "-" else str(tmp_path / source)
    assert run(["track", frames, "-o", str(tmp_path / "track.csv")]) == 2
    assert given == [every] and (every == 1) == (source == "-")
