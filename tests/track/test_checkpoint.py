"""Checkpoint files: the same bits come back, and a changed file is never taken for one."""

import numpy as np
import pytest

from camcal.errors import DataError
from camcal.track import checkpoint

from .helpers import make, round_trip, sequence


@pytest.fixture
def state(tmp_path):
    estimator = make("window")
    for frame in sequence("static", 3)[0]:
        estimator.update(frame)
    path = tmp_path / "state"
    checkpoint.save(path, {"run": estimator.state()})
    return path


def test_the_same_bits_come_back(state):
    loaded = checkpoint.load(state)["run"]
    again = make("window")
    again.restore(loaded)
    checkpoint.save(state.with_name("again"), {"run": again.state()})
    assert state.with_name("again").read_bytes() == state.read_bytes()


def test_any_changed_byte_is_noticed(state):
    data = state.read_bytes()
    rng = np.random.default_rng(0)
    for place in [0, 5, 40, len(data) - 2, *rng.integers(0, len(data) - 1, 200)]:
        changed = bytearray(data)
        changed[place] ^= 1 << int(rng.integers(0, 8))
        state.write_bytes(changed)
        with pytest.raises(DataError, match=r"not a state|damaged|not text"):
            checkpoint.load(state)


@pytest.mark.parametrize("length", [0, 1, 60, 200, -1])
def test_a_cut_file_is_noticed(state, length):
    state.write_bytes(state.read_bytes()[:length].rstrip(b"\n")[:-1])
    with pytest.raises(DataError, match=r"not a state|damaged|not text"):
        checkpoint.load(state)


def test_what_cannot_be_stored_is_a_bug():
    with pytest.raises(TypeError, match="cannot hold a set"):
        round_trip({"x": set()})
