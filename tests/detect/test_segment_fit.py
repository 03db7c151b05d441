"""Segments fitted to the maxima of the gradient: rendered edges of known places."""

import numpy as np

from camcal.detect.segment_fit import refined


def edge(angle, offset, blur=0.8, size=(120, 160), noise=2.0):
    """A half plane whose edge is `offset` px from the picture's middle, and two points of that edge."""
    v, u = np.indices(size)
    middle = np.array([79.5, 59.5])
    across, along = np.array([-np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    distance = (u - middle[0]) * across[0] + (v - middle[1]) * across[1] - offset
    grey = 60 + 120 / (1 + np.exp(-1.7 * distance / blur)) + np.random.default_rng(0).normal(0, noise, size)
    ends = middle + offset * across + np.outer([-30, 30], along)
    return grey.clip(0, 255).round().astype(np.uint8), ends, across


def test_a_rough_segment_ends_on_the_edge():
    for angle in (0.0, 0.3, 0.8, 1.4, 2.2):
        grey, ends, across = edge(angle, 0.37)
        rough = ends + np.outer([1.2, -0.9], across)
        off = (refined(grey, rough[None])[0] - ends) @ across
        assert np.abs(off).max() < 0.05  # the segment itself is off by about 1 px


def test_another_edge_under_a_part_of_it_has_no_say():
    grey, ends, across = edge(0.0, 0.0)
    grey[:, 100:] = np.roll(grey, 2, axis=0)[:, 100:]  # the last sixth is an edge 2 px farther down
    off = (refined(grey, ends[None])[0] - ends) @ across
    assert np.abs(off).max() < 0.1


def test_where_there_is_no_edge_a_segment_stays():
    short = np.array([[[20.0, 20], [28, 20]]])
    assert np.array_equal(refined(np.full((60, 60), 90, np.uint8), short), short)
