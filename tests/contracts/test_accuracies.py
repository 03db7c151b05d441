"""Accuracies at which iterations end: a finer one changes less than the tolerance, a much coarser one more.

The tolerance is a part of what noise does to the result. Limits of rounds and steps are in `test_limits_of_work`,
numbers of the detection in `tests/detect/test_accuracy_limits.py`.
"""

import importlib

import numpy as np
import pytest

from camcal.geometry import rotations
from camcal.start import dlt_distorted, fitzgibbon, mdlt, radial
from camcal.start import pose as start_pose
from tests.contracts import test_limits_of_work as work
from tests.sides import same_with_finer_and_not_with_coarser
from tests.start import scenes


def initial_poses():
    rng = np.random.default_rng(0)
    views = scenes.scene(scenes.board(), scenes.tilts(4), noise=0.0).observations.views
    ab = [(v.uv - scenes.K[:2, 2]) / 1000 + 2e-3 * rng.normal(size=v.uv.shape) for v in views]
    found = start_pose.initial_poses([v.xyz for v in views], ab, [None] * 4)
    return np.r_[rotations.log(found.rotations).ravel(), found.translations.ravel()]


def radial_focal():
    made = work.noisy(scenes.board(), scenes.tilts(6), 0.3, scenes.K_NO_SKEW, bend=-0.2)
    return np.array([radial.estimate(made).camera.params[0]])


#: module.NAME: (coarse, fine, tolerance, example)
ACCURACIES = {
    "solve.condition._ACCURACY": (0.5, 1e-9, 1e-2, work.condition_number),
    "solve.noise._SETTLED": (1e4, 1e-9, 1e-2, work.noise_parts),
    "solve.outliers._SETTLED": (0.9, 1e-12, 1e-6, work.scale_of_view),
    "start.absolute_pose.SETTLED": (10.0, 1e-14, 1e-4, work.pose),
    "start.mdlt.SETTLED": (
        1e3, 1e-14, 1e-3, work.closed_form(mdlt.estimate, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.5),
    ),
    "start.dlt_distorted.SETTLED": (
        1.0, 1e-13, 1e-3,
        work.closed_form(dlt_distorted.estimate12, scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.3, bend=-0.2),
    ),
    "start.fitzgibbon.SETTLED": (
        1.0, 1e-15, 0.1,
        work.closed_form(fitzgibbon.estimate, scenes.board(), scenes.tilts(8), noise=0.3, bend=-0.2),
    ),
    "start.pose.SETTLED": (1e9, 1e-9, 1e-4, initial_poses),
    "start.radial.ROUNDS": (1, 40, 1.0, radial_focal),
    "start.radial.LEAST_ROUNDS": (0, 6, 1.0, radial_focal),
    "start.radial.CENTRE_SPREAD": (1e-4, 0.07, 1.5, radial_focal),
}  # fmt: skip


@pytest.mark.parametrize("name", ACCURACIES)
def test_finer_is_the_same_and_coarser_is_not(monkeypatch, name):
    module, _, constant = name.rpartition(".")
    owner = importlib.import_module(f"camcal.{module}")
    same_with_finer_and_not_with_coarser(monkeypatch, owner, constant, *ACCURACIES[name])
