"""Every format of the table with every lens model: exact, or refused with the term or the model named."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camcal.data.formats import FORMATS, SUFFIXES, SUMMARIES, files, gaps
from camcal.data.formats.base import CameraFile, NamedCamera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import canonical, descriptions, room
from camcal.errors import CamcalError, UsageError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from tests.contracts.test_lenses import LENSES

WRITERS = [form for form in files.formats() if form.write is not None]
each_writer = pytest.mark.parametrize("form", WRITERS, ids=lambda form: form.name)
#: px; numbers are written with all their digits, so that only the formats' own scales round
EXACT = 1e-9


def cameras_of(lens, form):
    """The first example camera of a lens, with a pose: some formats are nothing without one."""
    params, size = lens.examples()[0]
    pose = Pose(rotations.exp(np.array([0.1, -0.2, 0.05])), np.array([0.3, -0.1, 2.0]))
    return CameraFile((NamedCamera("cam0", Camera(lens, np.array(params, float), size), pose),))


def square(cameras):
    """The same with one focal length."""
    named = cameras.cameras[0]
    params = named.camera.params.copy()
    params[1] = params[0]
    return replace(cameras, cameras=(replace(named, camera=replace(named.camera, params=params)),))


def through(form, cameras, suffix):
    """What the reader makes of what the writer writes, found out from the content alone."""
    path = Path(f"file{suffix}")
    written = files.rendered(form, cameras, path)
    data = written.content.encode() if isinstance(written.content, str) else written.content
    source = Source(path, data)
    source.beside = written.beside
    found = files.recognised(source)
    assert found.name == form.name
    return files.parsed(form, source)


def holds(form, lens, suffix):
    """Whether the format holds a lens, with one focal length."""
    try:
        through(form, square(cameras_of(lens, form)), suffix)
    except UsageError:
        return False
    return True


def test_the_table_is_complete():
    assert set(FORMATS) == set(SUMMARIES) and set(SUFFIXES.values()) <= set(FORMATS)
    assert [form.name for form in files.formats()] == list(FORMATS)
    for form in files.formats():
        assert form.title and form.order and form.source


@each_writer
def test_every_lens_is_exact_or_refused_by_name(form):
    held = 0
    for lens in LENSES:
        for cameras in (cameras_of(lens, form), square(cameras_of(lens, form))):
            for suffix in form.endings:
                try:
                    again = through(form, cameras, suffix)
                except UsageError as refusal:
                    described = descriptions(cameras.cameras[0].camera)[0]
                    shown = {"d1": "k4", "d2": "k5", "d3": "k6"}
                    terms = [shown.get(n, n) for n in described.needed] + [
                        "skew",
                        "fx",
                        lens.name.partition(":")[0],
                    ]
                    assert any(re.search(rf"\b{re.escape(t)}\b", refusal.message) for t in terms), (
                        refusal.message
                    )
                    assert "--to-model" in refusal.hint
                else:
                    held += 1
                    assert gaps.gap(cameras, again).max_px <= EXACT
                    if form.size:
                        size = cameras.cameras[0].camera.image_size
                        assert again.cameras[0].camera.image_size == size
    assert held


@each_writer
def test_a_skew_is_exact_or_refused_by_name(form):
    """The skew of every lens, in every ending: a writer that left it out would read back several px apart."""
    for lens in LENSES:
        bent = lenses.make(lens.name, True)
        params, size = bent.examples()[0]
        values = np.array(params, float)
        values[bent.index("skew")] = 2.5
        values[1] = values[0]
        camera = NamedCamera("cam0", Camera(bent, values, size), Pose(np.eye(3), np.array([0.1, 0.2, 5.0])))
        for suffix in form.endings:
            try:
                again = through(form, CameraFile((camera,)), suffix)
            except UsageError as refusal:
                named = "skew" if holds(form, lens, suffix) else "cannot hold"  # of the lens without a skew
                assert named in refusal.message
            else:
                assert gaps.gap(CameraFile((camera,)), again).max_px <= EXACT


@each_writer
def test_it_holds_what_it_says(form):
    """Each model that a format names goes through it: with its skew, and with one focal length where it says so."""
    for text in form.models:
        place = room(text)
        cameras = cameras_of(lenses.make(place.spec, place.skew), form)
        cameras = square(cameras) if place.square else cameras
        assert gaps.gap(cameras, through(form, cameras, form.endings[0])).max_px <= EXACT


@each_writer
def test_a_rig_keeps_names_and_poses(form):
    lens = lenses.make("pinhole")
    params, size = lens.examples()[0]
    params = np.r_[params[0], params[0], params[2:]]
    turns, shifts = ((0.1, 0.0, 0.0), (0.0, 0.2, 0.1)), ((1.0, 2.0, 9.0), (-1.0, 0.5, 8.0))
    poses = [Pose(rotations.exp(np.array(v)), np.array(t)) for v, t in zip(turns, shifts, strict=True)]
    camera = Camera(lens, params, size)
    rig = CameraFile(tuple(NamedCamera(n, camera, p) for n, p in zip(("1", "2"), poses, strict=True)))
    if not form.several:
        with pytest.raises(UsageError, match="one camera"):
            files.rendered(form, rig, Path("x.yaml"))
        return
    again = through(form, rig, form.endings[0])
    assert len(again.cameras) == 2
    if form.poses:
        apart = gaps.gap(rig, again)
        assert max(apart.rotation, apart.shift, apart.max_px) <= EXACT


def test_the_size_is_asked_for():
    lens = lenses.make("pinhole")
    cameras = CameraFile.one(Camera(lens, lens.pinhole(500, 500, 300, 200)))
    for form in WRITERS:
        if form.size:
            with pytest.raises(UsageError, match="image size") as error:
                files.rendered(form, cameras, Path("x.yaml"))
            assert "--image-size" in error.value.hint


def test_terms_are_named_for_every_lens():
    for lens in LENSES:
        kind, names = canonical(lens)
        own = [p for p in lens.parameters if p.group == "distortion"]
        assert kind and len(names) == len(own) == len(set(names))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.69])
def test_the_unified_model_is_mei_and_eucm(alpha):
    lens = lenses.make("ucm", True)
    camera = Camera(lens, np.array([350.0, 351, 318, 242, 0.8, alpha]), (640, 480))
    for terms in descriptions(camera):
        spec = {"ucm": "ucm", "eucm": "eucm", "unified": "mei", "polynomial": "pinhole"}[terms.kind]
        from camcal.data.formats.terms import camera_of

        other = camera_of(
            spec, (terms.fx, terms.fy, terms.cx, terms.cy, terms.skew), camera.image_size, terms.values
        )
        assert gaps.difference(camera, other) < EXACT


def test_refusals_say_what_is_known():
    with pytest.raises(CamcalError, match="unknown format 'openvc'") as error:
        files.named_format("openvc")
    assert "opencv" in error.value.hint
