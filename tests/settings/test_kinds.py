"""Kinds of values: what each takes, on both sides of its limits, and that converting twice changes nothing."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.errors import UsageError
from camcal.settings.commands import OPTIONS
from camcal.settings.kinds import Assignments, FilePath, Name, Real, Several, Switch, Text, Whole, Words
from camcal.settings.sizes import DISTANCE, BoardSize, ImageSize, KeptField, LengthKind, Numbers, Pixel

MODEL = Name("model", "camcal.model.lenses:LENSES", also=("auto",))
SHAPE = Name("board shape", "camcal.solve:BOARD_SHAPE_SUMMARIES", files=True)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (Switch(), np.False_, False),
        (Whole(1), 1, 1),
        (Whole(1, 50), "50", 50),
        (Whole(0), np.int32(7), 7),
        (Real(0, 1, above=True), 1, 1.0),
        (Real(0, 1, above=True), 5e-324, 5e-324),
        (Real(10, 2400), "10", 10.0),
        (Real(), "-1e5", -1e5),
        (DISTANCE, "inf", math.inf),
        (Text(), 5, "5"),
        (FilePath(), "a/b.csv", Path("a/b.csv")),
        (Words(("png", "svg")), "svg", "svg"),
        (MODEL, " brown:radial=2,decentering=1 ", "brown:radial=2,decentering=1"),
        (MODEL, "auto", "auto"),
        (SHAPE, Path("old.yaml"), "old.yaml"),
        (Assignments(), "k1 , k2=0.5", {"k1": None, "k2": 0.5}),
        (Assignments(), ["k1", {"k2": 1}], {"k1": None, "k2": 1.0}),
        (Assignments(), {"k1": None}, {"k1": None}),
        (Assignments(), (), {}),
        (Several(Pixel()), "1,2", ((1.0, 2.0),)),
        (Several(Words(("a", "b"))), ["a", "b"], ("a", "b")),
        (ImageSize(), "640X480", (640, 480)),
        (ImageSize(), np.array([1, 1]), (1, 1)),
        (BoardSize(), (2, 1000), (2, 1000)),
        (LengthKind(), ("25", "mm"), (25.0, "mm")),
        (LengthKind(), 2.5, (2.5, "unit")),
        (Pixel(), [100, -3.5], (100.0, -3.5)),
        (Numbers(3, "1,2,3"), "1,2,3", (1.0, 2.0, 3.0)),
        (KeptField(), "no-black", "no-black"),
        (KeptField(), 90, math.pi / 2),
        (KeptField(), 90.0, math.pi / 2),
        (KeptField(), "359.9deg", math.radians(359.9)),
    ],
)
def test_takes(kind, value, expected):
    found = kind.convert(value)
    assert found == (pytest.approx(expected) if isinstance(expected, float) else expected)
    assert kind.convert(found) == found


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        (Switch(), 1, "1 is not true or false."),
        (Whole(1), 0, "0 is not a whole number from 1 up."),
        (Whole(1, 50), 51, "51 is not a whole number from 1 to 50."),
        (Whole(1), 1.0, "1.0 is not a whole number from 1 up."),
        (Whole(1), "1e3", "'1e3' is not a whole number from 1 up."),
        (Real(0, 1, above=True), 0, "0 is not a number above 0 and at most 1."),
        (Real(0, 1, above=True), math.nextafter(1, 2), "1.0000000000000002 is not a number above 0 and at most 1."),
        (Real(0, 1), -1e-300, "-1e-300 is not a number from 0 to 1."),
        (Real(0), math.inf, "inf is not a number from 0 up."),
        (Real(), "x", "'x' is not a number."),
        (DISTANCE, 0, "0 is not a number above 0, or inf."),
        (DISTANCE, math.nan, "nan is not a number above 0, or inf."),
        (Text(), None, "None is not text."),
        (FilePath(), "", "'' is not the name of a file."),
        (Words(("png", "svg")), "sgv", "'sgv' is not known here."),
        (MODEL, "old.yaml", "unknown model 'old.yaml'."),
        (Assignments(values=True), "k1", "'k1' has no value; a number is needed."),
        (Assignments(), "1k", "'1k' is not NAME or NAME=VALUE."),
        (Assignments(), {"k1": math.inf}, "k1=inf: inf is not a number."),
        (Several(Pixel()), ["1"], "'1' is not a pixel; its two coordinates are needed."),
        (ImageSize(), "640x0", "a picture of 640x0 has no pixels."),
        (ImageSize(), [640, 480, 3], "[640, 480, 3] is not an image size; width x height in pixels is needed."),
        (BoardSize(), "2x1001", "a board of 2x1001 cannot be used."),
        (BoardSize(), "1x2", "a board of 1x2 cannot be used."),
        (LengthKind(), "0mm", "'0mm' is not a length."),
        (LengthKind(), "25 ft", "'25 ft' is not a length."),
        (Pixel(), "1,nan", "'1,nan' is not a pixel; its two coordinates are needed."),
        (Numbers(2, "1,2"), 5, "5 is not 2 numbers with commas."),
        (KeptField(), 0, "0 is not all, no-black or an angle."),
        (KeptField(), "360", "'360' is not all, no-black or an angle."),
    ],
)  # fmt: skip
def test_refuses(kind, value, message):
    with pytest.raises(UsageError, match=f"^{re.escape(message)}$"):
        kind.convert(value)


ALL = sorted({id(o.kind): o for options in OPTIONS.values() for o in options}.values(), key=lambda o: o.name)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10) | st.binary(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)


@pytest.mark.parametrize("option", ALL, ids=lambda o: o.name)
@given(value=ANYTHING)
def test_whatever_comes_is_converted_once_or_refused(option, value):
    try:
        found = option.convert(value)
    except UsageError as error:
        assert error.message.endswith((".", "..."))
        return
    assert option.convert(found) == found


def test_flags_and_variables_are_unique_in_each_command():
    for command, options in OPTIONS.items():
        flags = [f for o in options for f in (o.long, o.short, o.off) if f]
        assert len(flags) == len(set(flags)), command
        assert len({o.name for o in options}) == len(options), command


def test_an_option_is_parsed_without_numpy():
    """Defaults of all options are converted, and all names that completion offers are listed."""
    code = (
        "import sys\n"
        "from camcal.settings.commands import OPTIONS\n"
        "for options in OPTIONS.values():\n"
        "    for option in options:\n"
        "        option.convert(option.default) if option.default is not None else None\n"
        "        option.kind.words()\n"
        "assert not {'numpy', 'scipy', 'cv2', 'yaml', 'rich'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
