"""The report's figures of what the views cover."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.report.coverage import section
from tests.solved import rig, solved


def test_what_the_views_cover():
    s = solved(views=8)
    found = section(s)
    uv = np.concatenate([v.uv for v in s.observations.views])
    box = np.prod(np.ptp(uv, axis=0)) / (640 * 480)
    assert 0.5 * box < found["image"] < box
    # the poses are drawn at 11 to 16 from the camera, up to 2 aside, and turned by up to 0.5 about x and y
    assert 10.8 < found["distance"]["least"] < found["distance"]["most"] < 16.6
    assert 0 < found["tilt_degrees"]["least"] < found["tilt_degrees"]["most"] < np.degrees(0.75)
    assert found["different_views"] == 8


def test_views_that_repeat_one_another_count_once():
    s = solved(views=4, noise=0.05)
    views = s.observations.views
    twice = replace(
        s,
        observations=s.observations.with_views((*views, *views)),
        poses=s.poses[np.r_[:4, :4]],
        residuals=np.tile(s.residuals, (2, 1)),
    )
    assert section(twice)["different_views"] == 4


def test_a_rig_has_distances_but_no_tilt():
    found = section(solved("pinhole", views=1, xyz=rig(), shift=0.3))
    assert found["tilt_degrees"] is None and found["normals_spread_degrees"] is None
    assert found["distance"]["least"] == pytest.approx(found["distance"]["most"])
