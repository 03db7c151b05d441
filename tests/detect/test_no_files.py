"""Pictures and films that are not regular files are named at once; nobody waits for a pipe."""

import os

import pytest

from camcal.detect.images import detect_images
from camcal.errors import DataError


@pytest.mark.parametrize("name", ["a.tif", "a.mp4", "a.png"])
def test_pipes_and_devices(tmp_path, name):
    os.mkfifo(tmp_path / name)
    (tmp_path / f"zero-{name}").symlink_to("/dev/zero")
    for path in (tmp_path / name, tmp_path / f"zero-{name}"):
        with pytest.raises(DataError, match=r"no (target|frame|board)") as caught:
            detect_images([path], cache=False)
        assert "not a regular file" in caught.value.hint
