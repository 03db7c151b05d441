"""docs/report.md explains every key that a report has, and every warning that a check gives."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camcal.assess import checks
from camcal.data.observations import SkippedView
from camcal.peers.run import crosscheck
from camcal.report.document import document
from camcal.solve.solution import Stage
from tests.solved import rig, solved

DOCS = Path(__file__).resolve().parents[2] / "docs" / "report.md"

#: below these the keys are names of parameters, or another room's
FREE_FORM = ("parameters", "info", "options", "target", "quality", "files")


def keys_of(value, inside=""):
    if isinstance(value, dict):
        for key, item in value.items():
            if inside not in FREE_FORM:
                yield key
            yield from keys_of(item, key)
    elif isinstance(value, list):
        for item in value:
            yield from keys_of(item, inside)


@pytest.fixture(scope="module")
def report():
    s = solved("opencv4", views=1, xyz=rig(), shift=0.3, fix={"aspect": None})
    masks = (np.arange(len(s.inliers[0])) > 1,)
    stage = Stage("dlt", 1.0, s.camera.matrix, 0.1, np.ones((3, 4)), s.camera, s.poses, {"why": "x"})
    data = replace(s.correspondences, skipped=(SkippedView("b", "unreadable", "empty"),))
    s = replace(s, inliers=masks, stages=(stage,), correspondences=data, weights=(np.ones(60),))
    return document(replace(s, crosscheck=crosscheck(replace(s, stages=()))))


def test_every_key_is_explained(report):
    text = re.sub(r"```.*?```", "", DOCS.read_text(encoding="utf-8"), flags=re.DOTALL)
    named = set(re.findall(r"`([^`]+)`", text))
    words = {w for n in named for w in re.findall(r"[A-Za-z0-9_]+", n)}
    assert set(keys_of(report)) <= words, set(keys_of(report)) - words


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
