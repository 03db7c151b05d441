"""The names of the columns of a table of points, and the columns that a table must have."""

from __future__ import annotations

import re

from camcal.errors import DataError
from camcal.records import dataclass
from camcal.registry import suggestion

LONGEST = 40  #: characters of a field that messages show
#: Names of each column, compared without case, blanks, and signs such as `_`, `-` and `[px]`.
ALIASES = {
    "view": "view file image frame name picture img filename imagename viewname viewid imageid frameid",
    "X": "x objectx objx worldx boardx modelx x3d 3dx",
    "Y": "y objecty objy worldy boardy modely y3d 3dy",
    "Z": "z objectz objz worldz boardz modelz z3d 3dz",
    "u": "u px pixelx imagex imgx imx col column x2d 2dx xpx ximage",
    "v": "v py pixely imagey imgy imy row y2d 2dy ypx yimage",
    "sigma": "sigma sigmapx std stddev",
    "id": "id pointid pointids point pt marker markerid cornerid",
    "t": "t time seconds timestamp",
    "printed": "printed",
}
#: what x and y are where X and Y are there, too
_IMAGE = {"x": "u", "y": "v"}
_BY_NAME = {alias: role for role, text in ALIASES.items() for alias in text.split()}


@dataclass(frozen=True)
class Form:
    """A kind of table: its required columns, and its columns if there is no header.

    Attributes
    ----------
    needed : tuple of str
        Columns that a header must name.
    allowed : tuple of str
        Columns that a header may name.
    headless : mapping of number of columns -> tuple of str
    said : str
        The headless forms in words, for messages.
    """

    needed: tuple[str, ...]
    allowed: tuple[str, ...]
    headless: dict[int, tuple[str, ...]]
    said: str


POINTS = Form(
    ("X", "Y", "u", "v"),
    ("view", "id", "X", "Y", "Z", "u", "v", "sigma", "printed"),
    {4: ("X", "Y", "u", "v"), 5: ("X", "Y", "Z", "u", "v"), 6: ("view", "X", "Y", "Z", "u", "v")},
    "4 (X Y u v), 5 (X Y Z u v) or 6 (view X Y Z u v)",
)
#: a stream of frames, `camcal track`; the column `view` is the frame's number
FRAMES = Form(
    ("view", "X", "Y", "Z", "u", "v"),
    ("view", "id", "X", "Y", "Z", "u", "v", "sigma", "t"),
    {6: ("view", "X", "Y", "Z", "u", "v")},
    "6 (frame X Y Z u v)",
)
POINTS_3D = Form(
    ("X", "Y"), ("view", "id", "X", "Y", "Z"), {2: ("X", "Y"), 3: ("X", "Y", "Z")}, "3 (X Y Z) or 2 (X Y)"
)
POINTS_2D = Form(("u", "v"), ("view", "id", "u", "v", "sigma"), {2: ("u", "v")}, "2 (u v)")


def shown(text: str) -> str:
    """A field as messages show it: one short line of printable characters."""
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text.strip())
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def plain(name: str) -> str:
    """The name in lower case without blanks, punctuation, and a unit in brackets."""
    return re.sub(r"\(.*?\)|\[.*?\]|[^0-9a-z]", "", name.strip().lower())


def role_of(name: str, form: Form) -> str | None:
    """The column that a header name stands for, or None.

    In a table of image points alone, `x` and `y` can only be pixels.
    """
    role = _BY_NAME.get(plain(name))
    if form is POINTS_2D:
        role = {"X": "u", "Y": "v"}.get(role or "", role)
    return role if role in form.allowed else None


def from_header(names: list[str], form: Form, where: str) -> tuple[str, ...]:
    """The columns that a header names.

    Raises
    ------
    DataError
        If a name is unknown or occurs twice, or a needed column is missing.
    """
    roles: list[str] = []
    stripped = [name.strip() for name in names]
    both = {"X", "Y", "x", "y"} <= set(stripped)  # X, Y, Z of the point and x, y of its image
    for name in names:
        role = role_of(name, form)
        if both and name.strip() in _IMAGE and _IMAGE[name.strip()] in form.allowed:
            role = _IMAGE[name.strip()]
        if role is None:
            raise DataError(f"{where}: unknown column '{shown(name)}'.", _hint(name, form))
        if role in roles:
            first = shown(names[roles.index(role)])
            raise DataError(
                f"{where}: the columns '{first}' and '{shown(name)}' both mean {role}; one is needed.",
                "Name the columns " + ",".join(form.allowed) + ".",
            )
        roles.append(role)
    missing = [role for role in form.needed if role not in roles]
    if missing:
        found = ", ".join(map(shown, names))
        raise DataError(
            f"{where}: the header ({found}) lacks {' and '.join(missing)}.",
            "Name the columns " + ",".join(form.allowed) + "; " + _optional(form) + " may be left out.",
        )
    return tuple(roles)


def without_header(row: list[str], numeric: list[bool], form: Form, where: str) -> tuple[str, ...]:
    """The columns of a table without a header, by their number.

    Raises
    ------
    DataError
        If no form has that many columns.
    """
    count = len(row)
    if form is POINTS and count == 5 and not numeric[0]:  # text in the first of five can only be a name
        return ("view", "X", "Y", "u", "v")
    if count in form.headless:
        return form.headless[count]
    pair = "; or give two files, --points3d and --points2d" if form is POINTS and count in (2, 3) else ""
    raise DataError(
        f"{where}: {count} column{'s' * (count != 1)} found; without a header, {form.said} are needed.",
        "Give the file a first row that names its columns: " + ",".join(form.allowed) + pair + ".",
    )


def _optional(form: Form) -> str:
    return ", ".join(role for role in form.allowed if role not in form.needed)


def _hint(name: str, form: Form) -> str:
    known = [alias for alias, role in _BY_NAME.items() if role in form.allowed]
    if plain(name) in ("camera", "cam", "cameraid"):
        return "A table of several cameras is for `camcal rig`; for a single camera, remove that column."
    near = suggestion(plain(name), known) if len(plain(name)) > 1 else None
    return near or "Columns that camcal knows: " + ",".join(form.allowed) + "."
