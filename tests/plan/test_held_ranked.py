"""Parameters to be held where the lens model is chosen from the data: what the chosen one has of them."""

import numpy as np
import pytest

import camcal
from camcal.errors import UsageError
from camcal.plan import selection
from camcal.plan.lens import SMALL, _with_held
from camcal.plan.options import Options
from tests import solved

QUICK = {"checks": False, "crosscheck": False}


@pytest.mark.parametrize(
    ("fix", "models"),
    [
        ({"p1": None}, SMALL),
        ({"p1": 0.0, "p2": 0.0}, SMALL),
        ({"p1": 1e-4}, ("opencv4", "opencv5")),
        ({"k2": 0.01}, ("brown:radial=2,decentering=0", "opencv4", "opencv5")),
        ({"aspect": 1.5, "cx": 320.0}, SMALL),
    ],
)
def test_models_that_can_hold_it(fix, models):
    """A model without a coefficient has it at 0, which is what a name without a value holds it at."""
    assert _with_held(SMALL, Options.resolve(fix=fix)) == models


def test_names_that_no_model_has():
    with pytest.raises(UsageError, match="none of the models to choose from has a parameter 'k9'"):
        _with_held(SMALL, Options.resolve(fix={"k9": None}))
    with pytest.raises(UsageError, match="has all of p1, xi"):
        _with_held(("opencv4", "ds"), Options.resolve(fix={"p1": 1e-4, "xi": 0.3}))


@pytest.mark.parametrize("model", ["auto", "select"])
def test_the_chosen_model_need_not_have_it(model, monkeypatch):
    """Two views of twelve points, too few for opencv5: the pinhole is chosen, and holds p1 at 0."""
    rng, grid = np.random.default_rng(0), solved.grid(4, 3, 2.0)
    poses = solved.tilted_poses(grid, 2, rng)
    data = solved.observe(solved.camera_of("pinhole"), poses, grid, 0.1, rng)
    monkeypatch.setattr(selection, "AUTO", ("pinhole", "opencv4"))
    monkeypatch.setattr("camcal.plan.lens.SMALL", ("pinhole", "opencv4"))
    found = camcal.calibrate(data, model=model, fix={"p1": None, "cx": 322.0}, **QUICK)
    assert found.camera.lens.name == "pinhole" and found.camera.params[2] == 322.0
    with pytest.raises(UsageError, match=r"no parameter 'k9'|has a parameter 'k9'"):
        camcal.calibrate(data, model=model, fix={"k9": None}, **QUICK)
