"""The strict configuration loader, and what a file may hold."""

import re
import subprocess
import sys
import textwrap
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.errors import CamcalError, UsageError
from camcal.settings.commands import OPTIONS, options_of
from camcal.settings.config import NEAREST, Config, load_config, values_for


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write_and_load(text):
        data = text if isinstance(text, bytes) else textwrap.dedent(text).encode()
        (tmp_path / "camcal.yaml").write_bytes(data)
        return load_config("camcal.yaml")

    return write_and_load


def value_of(load, text):
    return load(f"key: {text}").data["key"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-5", 1e-5),
        ("1.5E+3", 1500.0),
        (".5", 0.5),
        ("3", 3),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("true", True),
        ("FALSE", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("no", "no"),
        ("yes", "yes"),
        ("on", "on"),
        ("Off", "Off"),
        ("y", "y"),
        ("none", "none"),
        ("12:30:45", "12:30:45"),
        ("2024-01-31", "2024-01-31"),
        ("1_000", "1_000"),
        ("'5'", "5"),
        ("0b11", "0b11"),
        ("[a, 2, .inf]", ["a", 2, float("inf")]),
    ],
)
def test_scalars_are_what_yaml_1_2_says(load, text, value):
    found = value_of(load, text)
    assert found == value
    assert type(found) is type(value)


def test_lines_are_kept(load):
    config = load("# a comment\nmodel: opencv5\n\nestimate:\n  max-rms: 0.5\n")
    assert config.where("model") == "camcal.yaml:2"
    assert config.where("estimate", "max-rms") == "camcal.yaml:5"


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n", "{}"])
def test_an_empty_file_is_an_empty_configuration(load, text):
    assert values_for("estimate", load(text)) == {}


def test_values_are_converted_under_the_names_of_the_options(load):
    config = load("""
        max-rms: 1
        fix: [aspect, cx=320]
        robust: none
        crosscheck: false
        plot_format: [png, svg]
        estimate:
          image_size: 640x480
        """)
    assert values_for("estimate", config) == {
        "max_rms": 1.0,
        "fix": {"aspect": None, "cx": 320.0},
        "robust": "none",
        "crosscheck": False,
        "image_size": (640, 480),
    }
    assert values_for("report", config) == {"plot_format": ("png", "svg")}


def test_the_commands_own_key_wins_over_the_top(load):
    config = load("max_rms: 1\nestimate: {max_rms: 2}\nevaluate: {max_rms: 3}\n")
    assert values_for("estimate", config)["max_rms"] == 2.0
    assert values_for("evaluate", config)["max_rms"] == 3.0
    assert values_for("images", config)["max_rms"] == 1.0


def test_a_group_of_commands_shares_its_keys(load):
    config = load("simulate:\n  noise: 0.5\n  views: 3\n  cells: 4\n")
    assert values_for("simulate points", config) == {"noise": 0.5, "views": 3}
    assert values_for("simulate frames", config) == {"noise": 0.5}


def test_an_option_and_a_command_of_one_name(load):
    """`report` is a command, and an option of `track`: a group of keys is the command's."""
    assert values_for("track", load("report: r.yaml\n"))["report"].name == "r.yaml"
    assert values_for("report", load("report: {force: true}\n")) == {"force": True}
    assert values_for("track", load("report: {force: true}\n")) == {}


def test_an_option_that_differs_between_commands(load):
    """At the top, a value must suit the running command; one that only another command takes is no error."""
    assert values_for("detect", load("format: csv\n")) == {}
    assert values_for("track", load("format: csv\n")) == {"format": "csv"}
    with pytest.raises(UsageError, match=r"camcal\.yaml:1: format: 'csv' is not known here"):
        values_for("estimate", load("format: csv\n"))
    with pytest.raises(UsageError, match=r"camcal\.yaml:1: format: 'xml' is not known here"):
        values_for("detect", load("format: xml\n"))


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("\nmodle: x", "camcal.yaml:2: unknown key 'modle'.", "Did you mean 'model'?"),
        ("estimate:\n  modle: x", "camcal.yaml:2: unknown key 'modle'.", "Did you mean 'model'?"),
        ("detect: {folds: 3}", "camcal.yaml:1: unknown key 'folds'.", "The nearest under detect: "),
        ("\n\nmax_rms: abc", "camcal.yaml:3: max_rms: 'abc' is not a number above 0.", None),
        ("max_rms: .nan", "camcal.yaml:1: max_rms: nan is not a number above 0.", None),
        ("max_rms: .inf", "camcal.yaml:1: max_rms: inf is not a number above 0.", None),
        ("max_rms: true", "camcal.yaml:1: max_rms: true is not a number above 0.", None),
        ("max_rms: [1]", "camcal.yaml:1: max_rms: [1] is not a number above 0.", None),
        ("max_rms:", "camcal.yaml:1: 'max_rms' has no value.", "Remove the line"),
        ("seed: 1.0", "camcal.yaml:1: seed: 1.0 is not a whole number from 0 up.", None),
        ("crosscheck: no", "camcal.yaml:1: crosscheck: 'no' is not true, false or full.", None),
        ("model: 5", "camcal.yaml:1: model: unknown model '5'.", "Known: pinhole,"),
        ("robust: hubr", "camcal.yaml:1: robust: unknown robust method 'hubr'.", "Did you mean 'huber'?"),
        ("fix: [a, 3]", "camcal.yaml:1: fix: 3 is not NAME[=VALUE],...", "Try: p1,p2,k3=0.1"),
        ("estimate: 3", "camcal.yaml:1: estimate: 3 found; options of the command are needed.", "Write"),
        ("image_size: {a: 2}", "camcal.yaml:1: image_size: {'a': 2} is not an image size;", "Try: 640x480"),
        ("max_rms: 1\nmax-rms: 1", "camcal.yaml:2: 'max-rms' is given a second time", "Remove one."),
        ("config: other.yaml", "camcal.yaml:1: unknown key 'config'.", "The nearest: "),
    ],
)
def test_what_is_refused(load, text, message, hint):
    config = load(text)
    with pytest.raises(UsageError, match="^" + re.escape(message)) as caught:
        values_for("estimate", config)
    if hint is None:
        assert caught.value.hint is None
    else:
        assert caught.value.hint.startswith(hint)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("text", "where"), [("xyzzy: 1", "camcal COMMAND --help"), ("detect: {folds: 3}", "camcal detect --help")]
)
def test_an_unknown_key_like_no_other_gets_the_nearest_three(load, text, where):
    with pytest.raises(UsageError, match="unknown key") as caught:
        values_for("estimate", load(text))
    near, _, rest = caught.value.hint.partition(": ")[2].partition(".")
    assert len(near.split(", ")) == NEAREST and set(near.split(", ")) <= {
        n for o in OPTIONS for n in options_of(o)
    }
    assert rest.endswith(where)


@pytest.mark.parametrize(
    "text", ["output: a.yaml", "force: true", "track: {state: s}", "save_camera: [a.yml]"]
)
def test_only_a_file_that_is_named_says_what_is_written(load, text):
    """A camcal.yaml that came with somebody's data must overwrite nothing."""
    config = load(text)
    values_for("estimate", config)
    with pytest.raises(UsageError, match="names an output, which a file not given by --config cannot set"):
        values_for("estimate", replace(config, named=False))


@pytest.mark.parametrize("value", ["../camera.yaml", "/etc/passwd", "link/camera.yaml"])
def test_a_file_that_came_with_data_reads_nothing_elsewhere(load, tmp_path, value):
    (tmp_path / "link").symlink_to("/etc")
    config = replace(load(f"undistort:\n  camera: {value}"), path=str(tmp_path / "camcal.yaml"))
    values_for("undistort", config)
    with pytest.raises(UsageError, match="leads out of the folder"):
        values_for("undistort", replace(config, named=False))
    inside = replace(load("undistort:\n  camera: own/camera.yaml"), path=str(tmp_path / "camcal.yaml"))
    values_for("undistort", replace(inside, named=False))


def test_a_file_that_came_with_data_names_no_other_machine(load):
    config = load("batch:\n  scheduler: tcp://elsewhere:8786")
    with pytest.raises(UsageError, match="is an address"):
        values_for("batch", replace(config, named=False))


def test_outputs_are_known_as_such():
    """Every option whose file is written; the others with a file read it."""
    from camcal.settings.commands import OPTIONS
    from camcal.settings.kinds import FilePath, Several

    written, read = set(), set()
    for option in (o for options in OPTIONS.values() for o in options):
        kind = option.kind.item if isinstance(option.kind, Several) else option.kind
        if isinstance(kind, FilePath):
            (written if option.writes else read).add(option.name)
    assert {"camera", "config", "distortion", "points2d", "points3d", "reference"} <= read
    assert not read & {"output", "plot", "summary", "maps"}
    assert {"output", "state", "trace", "junit", "plots", "save_camera", "save_corners"} <= written


def test_every_option_takes_its_own_default(load):
    """What a report lists under `options` can stand in a file."""
    from camcal.settings.commands import OPTIONS

    for options in OPTIONS.values():
        for option in options:
            if option.default is not None:
                value = option.convert(option.default)
                assert option.convert(value) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb:\n  c: 1\n  c: 2", "camcal.yaml:4: 'c' is given a second time, after line 3"),
        ("model: [1,", "camcal.yaml:1: not valid YAML"),
        ("a: 1\n b: 2", "camcal.yaml:2: not valid YAML"),
        ("a: 1\n---\nb: 2", "camcal.yaml:2: not valid YAML"),
        ("a: 1\nb: \x01", "camcal.yaml:2: not valid YAML: the character '\\x01'"),
        ('a: "\\UFFFFFFFF"', "camcal.yaml: not valid YAML"),
        ("- a\n- b", "camcal.yaml:1: a list found; `key: value` lines are needed"),
        ("just text", "camcal.yaml:1: 'just text' found"),
        ("5: a", "camcal.yaml:1: a key is '5'; a name is needed"),
        ("? [a]\n: b", "camcal.yaml:1: a key is 'a list'; a name is needed"),
        ("a: &x 1\nb: *x", "camcal.yaml:1: anchors and aliases"),
        ("a: !!python/object/apply:os.system [ls]", "camcal.yaml:1: the tag !!python/object/apply:os.system"),
        ("a: " + "[" * 5000, "camcal.yaml:1: nested more than"),
        ("a: " + "9" * 5000, "camcal.yaml:1: a number of 5000 digits"),
        (b"a: 1\nb: \xff", "camcal.yaml:2: not UTF-8 text"),
        (b"#" * (2 << 20), "more than 1 MB"),
    ],
)
def test_what_the_loader_refuses(load, text, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        load(text)


def test_missing_file(tmp_path):
    with pytest.raises(UsageError, match="cannot be read: there is no file"):
        load_config(tmp_path / "absent.yaml")


def test_a_byte_order_mark_is_skipped(load):
    assert load(b"\xef\xbb\xbfmodel: a\r\n").data == {"model": "a"}


def test_numpy_is_not_loaded():
    code = (
        "import sys, camcal.settings.config, camcal.data.writing;"
        "assert not {'numpy', 'cv2', 'click'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


YAML_SCRAPS = st.lists(
    st.sampled_from(
        [
            "model",
            "estimate",
            ":",
            " ",
            "\n",
            "- ",
            "[",
            "]",
            "{",
            "}",
            ",",
            "&a",
            "*a",
            "!!int",
            "!x",
            "'",
            '"',
        ]
        + ["|", ">", "#", "?", "%", "---", "...", "1e5", "no", "\t", "~", "\\", "@", "`", "<<"]
    ),
    max_size=25,
).map(lambda parts: "".join(parts).encode())


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=400)
@given(
    data=st.binary(max_size=60) | YAML_SCRAPS | st.text(max_size=60).map(lambda t: t.encode(errors="replace"))
)
def test_whatever_stands_in_the_file_only_camcals_errors_come_out(load, data):
    try:
        values_for("estimate", load(data))
    except CamcalError as error:
        assert error.message.endswith(".")


KEYS = st.sampled_from(
    ["model", "fix", "max_rms", "image_size", "at", "keep", "seed", "skew", "square", "tilt"]
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=5,
)


@settings(deadline=None, max_examples=300)
@given(key=KEYS, value=VALUES)
def test_whatever_a_key_holds_only_camcals_errors_come_out(key, value):
    config = Config("c.yaml", {key: value}, {(key,): 1})
    for command in ("estimate", "undistort", "simulate points"):
        try:
            values_for(command, config)
        except CamcalError as error:
            assert error.message.startswith("c.yaml:1: ")
