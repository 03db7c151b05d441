"""Mutated files of every format end in one line of camcal's own, or in a camera; nothing in them is run."""

import os
import random
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from camcal.data.formats import files
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.source import Source
from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.shared_data import DATA

#: files of each format and ending; `pytest -m slow` takes 10,000
COUNT = 300
SCRAPS = [
    b"\n",
    b" ",
    b"-",
    b"1e999",
    b"nan",
    b"0",
    b"[",
    b"]",
    b"{",
    b"}",
    b"<a>",
    b"&b;",
    b"\0",
    b"\xff",
    b"!!python/object/apply:os.system [x]",
    b"*a",
    b"&a ",
    b"'",
    b'"',
    b"9" * 30,
]


def samples():
    """A file of each format and ending, as camcal writes it, and those of other programs where they are here."""
    for form in files.formats():
        if form.write is None:
            continue
        text = form.models[-1]
        lens = lenses.make(text.partition("+")[0])
        params, size = lens.examples()[0]
        params = np.array(params, float)
        params[1] = params[0]
        camera = Camera(lens, params, size)
        cameras = CameraFile((NamedCamera("cam0", camera, Pose(np.eye(3), np.array([0.1, 0.2, 5.0]))),))
        for ending in form.endings:
            try:
                content = files.rendered(form, cameras, Path(f"a{ending}")).content
            except CamcalError:
                continue
            yield pytest.param(
                f"a{ending}",
                content.encode() if isinstance(content, str) else content,
                id=f"{form.name}{ending}",
            )


def mutated(data, rng):
    """Bytes changed, cut, repeated, exchanged and put in."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at = rng.randrange(len(out) + 1)
        what = rng.randrange(6)
        if what == 0 and at < len(out):
            out[at] = rng.randrange(256)
        elif what == 1:
            del out[at : at + rng.randrange(1, 40)]
        elif what == 2:
            out[at:at] = out[at : at + rng.randrange(1, 200)]
        elif what == 3:
            out[at:at] = rng.choice(SCRAPS)
        elif what == 4:
            del out[at:]
        else:
            other = rng.randrange(len(out) + 1)
            out[at : at + 8], out[other : other + 8] = out[other : other + 8], out[at : at + 8]
    return bytes(out)


def survives(name, data):
    """Read a file's content; only camcal's own errors come out, one line each."""
    source = Source(Path(name), data)
    try:
        found = files.parsed(files.recognised(source), source)
    except CamcalError as error:
        assert "\n" not in error.message and error.hint
        return
    for named in found.cameras:
        if isinstance(named.camera, Camera):
            assert np.isfinite(named.camera.params).all()


def run(name, data, count):
    rng = random.Random(name + str(len(data)))
    for _ in range(count):
        survives(name, mutated(data, rng))


@pytest.mark.parametrize("name, data", list(samples()))
def test_mutated_files(name, data, monkeypatch):
    monkeypatch.setattr(os, "system", lambda _: pytest.fail("a file was run"))
    run(name, data, COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("name, data", list(samples()))
def test_ten_thousand_mutated_files(name, data):
    run(name, data, 10_000)


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.skipif(not (DATA / "formats").is_dir(), reason="the reference data is not here")
def test_mutated_files_of_other_programs():
    for path in sorted((DATA / "formats").rglob("*.*")):
        if path.suffix != ".md" and path.stat().st_size < 1 << 20:
            run(path.name, path.read_bytes(), 1000)


BOMB = "\n".join(f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]" for a, b in ("ab", "bc", "cd", "de"))


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x]\n" + BOMB,
        "camera_matrix: !!python/object/apply:os.system ['true']",
        "a: " + "[" * 5000,
    ],
)
def test_hostile_yaml_stays_small(text):
    tracemalloc.start()
    survives("a.yaml", text.encode())
    assert tracemalloc.get_traced_memory()[1] < 50 << 20
    tracemalloc.stop()
