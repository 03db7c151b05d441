"""docs/recipes/lens.md: its code, registered from outside the package, is a lens model like the others."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import camcal
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.containment import contained
from camcal.model.lenses.conversion import convert
from tests import solved
from tests.contracts import lens_battery as battery

PAGE = Path(__file__).resolve().parents[2] / "docs" / "recipes" / "lens.md"
NAME = "scaled-tangent"


@pytest.fixture
def registered(tmp_path, monkeypatch):
    """The page's first block of code as a module outside camcal, and its second block run on the tables."""
    code, tables = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (tmp_path / "outside_lens.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    for table in ("LENSES", "SUMMARIES"):
        monkeypatch.setattr(lenses, table, dict(getattr(lenses, table)))
    tables = tables.replace("camcal.model.lenses.scaled_tangent", "outside_lens")
    exec(tables, {"LENSES": lenses.LENSES, "SUMMARIES": lenses.SUMMARIES})
    contained.cache_clear()
    yield lenses.make
    contained.cache_clear()


@pytest.mark.parametrize("skew", [False, True])
def test_the_contract_holds(registered, skew):
    lens = registered(NAME, skew)
    battery.check_everything(lens)
    assert contained(lens) == ("pinhole",) and battery.check_embedding(lens, lenses.make("pinhole", skew))


def test_it_calibrates_and_converts(registered):
    lens = registered(NAME)
    truth = Camera(lens, *lens.examples()[0])
    rng = np.random.default_rng(0)
    poses = solved.tilted_poses(solved.grid(), 8, rng)
    data = solved.observe(truth, poses, solved.grid(), 0.1, rng)
    found = camcal.calibrate(data, model=NAME, checks=False)
    assert found.fit.converged and abs(found.camera.values["h"] - 0.45) < 0.01
    assert convert(truth, lenses.make("kb4")).max_px < 0.05
    assert convert(convert(truth, lenses.make("kb4")).camera, lens).max_px < 0.05


def test_the_command_line_lists_it(registered):
    from click.testing import CliRunner

    from camcal.cli.group import camcal as group

    shown = CliRunner().invoke(group, ["list", "models"])
    assert shown.exit_code == 0 and NAME in shown.output
