"""Inputs are made once for all tests of a worker."""

import os
import random
import resource

import cv2
import numpy as np
import pytest

from camcal.cli.boundary import run
from tests.hardening import inputs, readers

#: bytes of address space that a reader of small hostile files may take besides what the process has
ROOM = 4 << 30


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A folder with the inputs."""
    folder = tmp_path_factory.mktemp("inputs")
    fill(folder)
    return folder


def fill(folder):
    """Make all inputs in a folder."""
    before = os.getcwd()  # noqa: PTH109
    os.chdir(folder)
    try:
        inputs.make(folder, _run)
        readers.make_state(folder)
        rng = np.random.default_rng(0)
        picture = cv2.GaussianBlur(rng.integers(0, 255, (48, 64), np.uint8), (0, 0), 2)
        for ending in readers.PICTURES:
            try:
                values = picture.astype(np.float32) if ending in (".exr", ".hdr") else picture
                values = cv2.merge([values] * 3) if ending in (".hdr", ".gif", ".avif") else values
                done, data = cv2.imencode(ending, values)
            except cv2.error:
                done = False
            (folder / f"picture{ending}").write_bytes(data.tobytes() if done else b"GIF89a" + bytes(40))
        _seeds_of_formats(folder)
    finally:
        os.chdir(before)


def _run(*args):
    code = run(["-q", *args])
    assert code in (0, 1), f"camcal {' '.join(args)} ended with {code}"


def _seeds_of_formats(folder):
    """A file of each format, as camcal writes it; of those that it only reads, a file of points or a report."""
    from tests.data.formats.test_fuzz import samples

    for sample in samples():
        name = sample.id.partition(".")[0]
        ending = sample.id[len(name) :]
        (folder / f"format-{name}{ending}").write_bytes(sample.values[1])


@pytest.fixture
def limited():
    """An array that a few bytes claim is refused by the system, not taken from the machine."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    with open("/proc/self/statm") as stream:  # noqa: PTH123
        now = int(stream.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + ROOM, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.fixture
def rng():
    return random.Random(0)
