"""The velocity of points of a plane's picture is that of a moving plane before a camera."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry import rotations
from camcal.geometry.plane_flow import LEAST_POINTS, fit_flow, flow_at
from tests.solved import grid

SIZE, FOCAL = (640, 480), 600.0
BOARD = grid() - [4, 2.5, 0]


def seen(turn, at):
    x = BOARD @ rotations.exp(np.array(turn)).T + at
    return FOCAL * x[:, :2] / x[:, 2:] + [319.5, 239.5]


@given(st.integers(0, 10_000))
def test_a_moving_plane_has_eight_numbers(seed):
    rng = np.random.default_rng(seed)
    turn, at = rng.normal(0, 0.4, 3), np.r_[rng.normal(0, 1, 2), 16]
    spin, speed = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
    step = 1e-4  # central differences: the error is of the order of its square
    after = seen(rotations.log(rotations.exp(step * spin) @ rotations.exp(turn)), at + step * speed)
    before = seen(rotations.log(rotations.exp(-step * spin) @ rotations.exp(turn)), at - step * speed)
    velocity = (after - before) / (2 * step)
    flow = fit_flow(seen(turn, at), velocity, SIZE)
    off = np.abs(flow_at(flow, seen(turn, at), SIZE) - velocity).max()
    assert off < 1e-5 * max(1.0, np.abs(velocity).max())


def test_points_that_do_not_determine_it_have_none():
    line = np.c_[np.linspace(0, 600, 9), np.linspace(0, 300, 9)]
    assert fit_flow(line, np.ones_like(line), SIZE) is None
    uv = seen(np.zeros(3), np.array([0, 0, 16.0]))[[0, 8, 20, 30, 45, 53]]
    assert fit_flow(uv[:LEAST_POINTS], np.zeros((LEAST_POINTS, 2)), SIZE) is not None
    assert fit_flow(uv[: LEAST_POINTS - 1], np.zeros((LEAST_POINTS - 1, 2)), SIZE) is None
