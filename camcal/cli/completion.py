"""Shell completion beyond files and names of tables: the cameras that the rest of the line names."""

from __future__ import annotations

import os
from pathlib import Path

#: options whose value is a camera of the files, or the words NAME=PICTURES, given before
OF_CAMERAS = ("camera", "reference", "hold")


def camera_names() -> list[str]:
    """The names in arguments NAME=PICTURES, and of the cameras in files, on the line to be completed.

    The words come from the shell (`COMP_WORDS`, which all of click's scripts set): click does not parse a line that
    ends with an option without a value.
    """
    from click.shell_completion import split_arg_string

    from camcal.settings.rig import split_camera

    found: dict[str, None] = {}
    for text in split_arg_string(os.environ.get("COMP_WORDS", ""))[2:]:
        pair = None if Path(text).exists() else split_camera(text)
        found |= dict.fromkeys([pair[0]] if pair else _in_file(Path(text)))
    return list(found)


def _in_file(path: Path) -> list[str]:
    """The cameras of a camera file or of a table with a column `camera`; none for other files."""
    from camcal.data.formats import read
    from camcal.data.labelled import read_labelled
    from camcal.errors import CamcalError

    if not path.is_file():
        return []
    try:
        if path.suffix.lower() == ".csv":
            return [str(n) for n in read_labelled(path, ("camera",)).names["camera"]]
        return read(path).names
    except CamcalError:
        return []
