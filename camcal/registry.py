"""Tables of name -> "module:object", loaded on first use.

A table is a plain dict, so that `--help` and completion read it without importing numpy or cv2.
"""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Iterable, Mapping
from typing import Any

from camcal.errors import UsageError


def load(path: str) -> Any:
    """Import `"package.module:attribute"` and return the attribute."""
    module, _, attribute = path.partition(":")
    # asked for in every calibration: a look-up in place of the import machinery, which waits where another thread
    # has not finished the import
    found = sys.modules.get(module)
    if found is None or getattr(getattr(found, "__spec__", None), "_initializing", False):
        found = importlib.import_module(module)
    return getattr(found, attribute)


#: what a name is called elsewhere (OpenCV, ROS, Kalibr, MATLAB, COLMAP) -> the name here, or what to choose from
ELSEWHERE = {
    "rational": "'opencv8'",
    "rational_polynomial": "'opencv8'",
    "full_opencv": "'opencv8'",
    "fisheye": "'kb4'",
    "equidistant": "'kb4'",
    "opencv_fisheye": "'kb4'",
    "plumb_bob": "'opencv5'",
    "brown-conrady": "'opencv5' (or 'brown:radial=3,decentering=1')",
    "brown_conrady": "'opencv5' (or 'brown:radial=3,decentering=1')",
    "radtan": "'opencv4'",
    "radial-tangential": "'opencv4'",
    "simple_pinhole": "'pinhole'",
    "omni": "'mei'",
    "omnidir": "'mei'",
    "--size": "'--image-size' (of the pictures, px) or '--board' (inner corners of the board)",
    "--pattern": "'--board' (inner corners), or '--target' for targets other than checkerboards",
    "--pattern-size": "'--board'",
    "--resolution": "'--image-size'",
    "--square-size": "'--square'",
    "--distortion-model": "'--model'",
    "--camera-model": "'--model'",
    "--flags": "'--model' and '--fix'",
    "--method": "'--start'",
    "calibrate": "'checkerboard' (pictures) or 'estimate' (points)",
    "intrinsics": "'checkerboard' (pictures) or 'estimate' (points)",
    "charuco": "'images'",
    "apriltag": "'images'",
    "video": "'images' (it takes films)",
    "film": "'images' (it takes films)",
    "dlt": "'estimate --start dlt'",
    "stereo": "'rig' (left=PICTURES right=PICTURES)",
    "stereo-calibrate": "'rig' (left=PICTURES right=PICTURES)",
    "extrinsics": "'pose' (one camera) or 'rig' (several)",
    "pnp": "'pose'",
    "validate": "'evaluate'",
    "verify": "'evaluate'",
    "test": "'evaluate'",
    "check": "'doctor'",
    "show": "'report'",
    "view": "'report'",
    "plot": "'report'",
    "residuals": "'report'",
}


def suggestion(word: str, known: Iterable[str]) -> str | None:
    """Return "Did you mean 'x'?" for the closest known word, or None where nothing is close.

    What the word is called elsewhere (`ELSEWHERE`) comes first, where one of the names that it stands for is known.
    """
    known = list(known)
    meant = ELSEWHERE.get(word.lower())
    if meant is not None and word not in known and any(f"'{k}" in meant for k in known):
        return f"Did you mean {meant}?"
    # without the dashes of options, which all of these have in common
    bare = {name.lstrip("-"): name for name in known}
    close = difflib.get_close_matches(word.lstrip("-"), bare, n=1)
    return f"Did you mean '{bare[close[0]]}'?" if close else None


def look_up(table: Mapping[str, str], name: str, kind: str) -> Any:
    """Load the entry `name` of a table.

    Raises
    ------
    UsageError
        If the table has no such name; the hint names the closest one, or all of them.
    """
    if name not in table:
        hint = suggestion(name, table) or "Known: " + ", ".join(sorted(table)) + "."
        raise UsageError(f"unknown {kind} '{name}'.", hint)
    return load(table[name])


def split_spec(spec: str) -> tuple[str, list[str], dict[str, str]]:
    """Split `"name:a:b,key=value"` into the name, the plain arguments and the keyword arguments.

    Arguments are separated by colons or commas: `brown:radial=2,decentering=1`, `charuco:9x7:40mm`.
    """
    name, _, rest = spec.partition(":")
    plain: list[str] = []
    named: dict[str, str] = {}
    for part in rest.replace(",", ":").split(":"):
        if not part:
            continue
        key, equals, value = part.partition("=")
        if equals:
            named[key.strip()] = value.strip()
        else:
            plain.append(part.strip())
    return name.strip(), plain, named
