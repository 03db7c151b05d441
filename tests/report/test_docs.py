"""docs/report.md explains every key of the schema, and every warning that a check gives."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camcal.assess import checks
from camcal.data.observations import SkippedView
from camcal.peers.run import crosscheck
from camcal.report.document import document
from camcal.schema import Camera, Report, keys, unknown_key
from camcal.schema.figures import Fit
from camcal.schema.structure import hints_of
from camcal.schema.views import View
from camcal.solve.calibration import Stage
from tests.solved import rig, solved

DOCS = Path(__file__).resolve().parents[2] / "docs" / "report.md"


@pytest.fixture(scope="module")
def report():
    s = solved("opencv4", views=1, xyz=rig(), shift=0.3, fix={"aspect": None})
    stage = Stage("dlt", 1.0, s.camera.matrix, 0.1, np.ones((3, 4)), s.camera, s.poses, {"why": "x"})
    skipped = (SkippedView("b", "unreadable", "empty"),)
    data = replace(s.observations.with_used(s.observations.point > 1), skipped=skipped, weight=np.ones(60))
    s = replace(s, stages=(stage,), observations=data)
    return document(replace(s, crosscheck=crosscheck(s)))


def test_the_tables_of_keys_are_current():
    """Renew them with `python -m camcal.schema.keys docs/report.md`."""
    page = DOCS.read_text(encoding="utf-8")
    assert page == keys.renewed(page)
    shown = set(re.findall(r"<!-- keys: (.*?) -->", page))
    explained = {kind for path, kind in keys.sections() if path in shown}
    assert [path for path, kind in keys.sections() if kind not in explained] == []


def test_a_report_has_the_keys_of_the_schema_in_its_order(report):
    assert unknown_key(Report, report) is None
    order = list(hints_of(Report))
    assert list(report) == sorted(report, key=order.index)
    for section, kind in ((report["camera"], Camera), (report["fit"], Fit), (report["views"][0], View)):
        order = list(hints_of(kind))
        assert list(section) == sorted(section, key=order.index)


def test_every_warning_is_explained():
    folder = Path(checks.__file__).parent
    given = {
        c for f in folder.glob("*.py") for c in re.findall(r'"([a-z]+(?:-[a-z]+)+)"', f.read_text("utf-8"))
    }
    explained = set(re.findall(r"`([a-z]+(?:-[a-z]+)+)`", DOCS.read_text(encoding="utf-8")))
    assert given and given <= explained, given - explained


def test_the_snippet_reads_the_data(report):
    import base64
    import zlib

    data = report["data"]
    raw = zlib.decompress(base64.b64decode(data["text"]))
    table = np.frombuffer(raw, "<f8").reshape(len(data["columns"]), -1)
    assert table.shape == (len(data["columns"]), data["rows"])
