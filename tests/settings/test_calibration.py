"""The options of a calibration, as keywords of a call."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import camcal
from camcal import solve
from camcal.errors import UsageError
from camcal.settings.calibration import CalibrationOptions
from camcal.solve.board import KINDS
from camcal.solve.losses import LOSSES
from tests.solved import solved


def test_defaults_are_valid():
    made = CalibrationOptions()
    assert (made.model, made.robust, made.fix, made.max_rms) == ("auto", "none", {}, None)
    for name, option in CalibrationOptions.options().items():
        assert option.name == name
        option.convert(option.default)


def test_values_are_converted_as_on_the_command_line():
    made = CalibrationOptions.resolve(fix="k3,p1=0.1", max_rms="0.5", seed=np.int64(3), skew=np.True_)
    assert made.fix == {"k3": None, "p1": 0.1}
    assert (made.max_rms, made.seed, made.skew) == (0.5, 3, True)
    assert type(made.seed) is int and type(made.skew) is bool


@pytest.mark.parametrize(
    ("keywords", "message", "hint"),
    [
        ({"modle": "opencv5"}, "unknown option 'modle'.", "Did you mean 'model'?"),
        ({"max_rsm": 1}, "unknown option 'max_rsm'.", "Did you mean 'max_rms'?"),
        ({"zzz": 1}, "unknown option 'zzz'.", "Known: model, skew, fix"),
        ({"model": "opencv6"}, "model: unknown model 'opencv6'.", "Did you mean"),
        ({"robust": "hubr"}, "robust: unknown robust method 'hubr'.", "Did you mean 'huber'?"),
        ({"max_rms": 0}, "max_rms: 0 is not a number above 0.", None),
        ({"max_rms": float("nan")}, "max_rms: nan is not a number above 0.", None),
        ({"seed": -1}, "seed: -1 is not a whole number from 0 up.", None),
        ({"seed": 1.5}, "seed: 1.5 is not a whole number from 0 up.", None),
        ({"seed": True}, "seed: true is not a whole number from 0 up.", None),
        ({"seed": None}, "seed: None is not a whole number from 0 up.", None),
        ({"holdout": -1}, "holdout: -1 is not a whole number from 0 up.", None),
        ({"skew": "no"}, "skew: 'no' is not true or false.", None),
        ({"fix": {"k1": "x"}}, "fix: k1=x: 'x' is not a number.", "Try: "),
        ({"fix": 3}, "fix: 3 is not NAME[=VALUE],...", "Try: "),
    ],
)
def test_what_is_refused(keywords, message, hint):
    with pytest.raises(UsageError, match="^" + re.escape(message)) as caught:
        CalibrationOptions.resolve(**keywords)
    if hint is None:
        assert caught.value.hint is None
    else:
        assert caught.value.hint.startswith(hint)


def test_calibrate_refuses_unknown_keywords_before_it_works():
    with pytest.raises(UsageError, match="unknown option 'max_rsm'"):
        camcal.calibrate(None, max_rsm=1e-6)


@pytest.mark.parametrize(("bound", "verdict"), [(1e-6, "fail"), (100.0, "pass"), (None, "pass")])
def test_max_rms_decides_the_verdict(bound, verdict):
    data = solved(views=4).observations
    found = camcal.calibrate(data, checks=False, max_rms=bound)
    assert found.verdict == verdict
    assert bool(found.failures) == (verdict == "fail")


def test_options_stand_in_the_solution():
    found = camcal.calibrate(solved(views=4).observations, checks=False, seed=5)
    assert found.options["seed"] == {"value": 5, "from": "keyword"}
    assert found.options["max_rms"] == {"value": None, "from": "default"}


def test_the_lines_of_the_page_on_configuration():
    page = (Path(__file__).parents[2] / "docs" / "configuration.md").read_text(encoding="utf-8")
    *lines, refused = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0].splitlines()
    names = {"camcal": camcal, "data": solved(views=4).observations}
    exec(lines[0], names)
    assert (
        eval(lines[1].partition("#")[0], names) == "pass"
    )  # at 0.2 px noise, as the comment says of the other case
    assert eval(lines[2].partition("#")[0], names) == {"value": 0.5, "from": "keyword"}
    with pytest.raises(UsageError) as caught:
        exec(refused, names)
    assert f"{caught.value.message} {caught.value.hint}" in refused


def test_tables_name_what_exists():
    assert set(solve.ROBUST_SUMMARIES) == {"none", "auto", *LOSSES} - {"linear"}
    assert set(solve.BOARD_SHAPE_SUMMARIES) == {"flat", "auto", *KINDS}


def test_nothing_heavy_is_loaded():
    code = (
        "import sys\n"
        "from camcal.settings.calibration import CalibrationOptions as C\n"
        "C.resolve(model='kb4', robust='huber', board_shape='free', optimizer='lm', fix='k1')\n"
        "assert not {'numpy', 'scipy', 'cv2', 'yaml', 'click'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
