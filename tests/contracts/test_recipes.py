"""docs/recipes: the code of each page, registered from outside the package, works like what camcal brings."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import camcal
from camcal import start
from camcal.assess import checks
from camcal.data import formats
from camcal.detect import targets
from camcal.detect.targets.base import Detection
from tests.detect.scenes import picture, random_view
from tests.solved import camera_of, grid, observe, solved, tilted_poses

PAGES = Path(__file__).resolve().parents[2] / "docs" / "recipes"


@pytest.fixture
def outside(tmp_path, monkeypatch):
    """Make a page's first block of code a module outside camcal, and run its second block on tables."""

    def make(page, module, **tables):
        code, lines = re.findall(r"```python\n(.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.S)
        (tmp_path / f"{module}.py").write_text(code, encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        importlib.invalidate_caches()
        made = importlib.import_module(module)
        lines = re.sub(r"my_package\.\w+", module, lines)
        names = {name: value for name, value in vars(made).items() if not name.startswith("_")}
        exec(lines, names | tables, tables)
        return made, tables

    return make


def test_a_closed_form(outside, monkeypatch):
    known = {"CLOSED_FORMS": dict(start.CLOSED_FORMS), "SUMMARIES": dict(start.SUMMARIES)}
    _, tables = outside("closed-form.md", "outside_vanishing", **known)
    monkeypatch.setattr(start, "CLOSED_FORMS", tables["CLOSED_FORMS"])
    rng = np.random.default_rng(2)
    data = observe(camera_of("pinhole"), tilted_poses(grid(), 8, rng), grid(), 0.1, rng)
    found = camcal.calibrate(data, model="pinhole", start="vanishing", checks=False)
    usual = camcal.calibrate(data, model="pinhole", checks=False)
    assert [s.name for s in found.stages] == ["vanishing", "refine"]
    # the closed form is within some per cent, the refinement at the same minimum
    assert found.stages[0].matrix[0, 0] == pytest.approx(533, rel=0.1)
    assert found.camera.params == pytest.approx(usual.camera.params, rel=1e-6)


@pytest.mark.parametrize(("stretch", "severity"), [(1.0, None), (1.004, "note"), (1.05, "doubtful")])
def test_a_check(outside, monkeypatch, stretch, severity):
    _, tables = outside("check.md", "outside_check", CHECKS=checks.CHECKS)
    monkeypatch.setattr(checks, "CHECKS", tables["CHECKS"])
    truth = {"fx": 533.0, "fy": 533.0 * stretch, "cx": 322.0, "cy": 238.0}
    fit = solved("pinhole", views=12, noise=0.05, truth=truth)
    found = {w.code: w.severity for w in checks.check(fit)}
    assert found.get("pixels-not-square") == severity


def test_a_format(outside, monkeypatch, tmp_path):
    known = {"FORMATS": dict(formats.FORMATS), "SUMMARIES": dict(formats.SUMMARIES)}
    _, tables = outside("format.md", "outside_labcam", **known)
    for name, table in tables.items():
        monkeypatch.setattr(formats, name, table)
    monkeypatch.setattr("camcal.data.formats.files.FORMATS", tables["FORMATS"])
    import outside_labcam

    truth = camera_of("opencv4", {"fx": 533.0, "fy": 534.0, "cx": 322.0, "cy": 238.0, "k1": -0.2, "k2": 0.05})
    text = outside_labcam.write(formats_file(truth), ".labcam")
    assert text.startswith("labcam 533")
    path = tmp_path / "camera.labcam"
    path.write_text(text)
    back = camcal.load(path)
    points = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 3], (50, 3))
    np.testing.assert_allclose(back.project(points), truth.project(points), atol=1e-9)


def formats_file(camera):
    from camcal.data.formats.base import CameraFile

    return CameraFile.one(camera)


def test_a_target(outside, monkeypatch):
    known = {"TARGETS": dict(targets.TARGETS), "SUMMARIES": dict(targets.SUMMARIES)}
    _, tables = outside("target.md", "outside_framed", **known)
    monkeypatch.setattr(targets, "TARGETS", tables["TARGETS"])
    target = targets.make("framed:7x5:20mm")
    usual = targets.make("checkerboard:7x5:20mm")
    widths = [t.pattern().extent[2] - t.pattern().extent[0] for t in (target, usual)]
    assert widths[0] - widths[1] == pytest.approx(3 * 20)
    rng = np.random.default_rng(3)
    gray = picture(target, *random_view(target, rng), rng)
    gray = gray[0] if isinstance(gray, tuple) else gray
    assert isinstance(target.find(gray), Detection)
