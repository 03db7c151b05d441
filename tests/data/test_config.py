"""The strict configuration loader and its schema."""

import subprocess
import sys
import textwrap

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camcal.data.config import AnyOf, Choice, ListOf, Text, load_config, validate
from camcal.errors import CamcalError, UsageError

SCHEMA = {
    "model": str,
    "max_rms": float,
    "seed": int,
    "crosscheck": bool,
    "fix": ListOf(),
    "robust": Choice(("none", "huber")),
    "hold_out": AnyOf((int, Choice(("random",)))),
    "estimate": {"model": str, "max_rms": float, "image_size": Text("a size such as 640x480")},
}


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write_and_load(text):
        data = text if isinstance(text, bytes) else textwrap.dedent(text).encode()
        (tmp_path / "camcal.yaml").write_bytes(data)
        return load_config("camcal.yaml")

    return write_and_load


def value_of(load, text):
    return load(f"key: {text}")["key"]


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
    assert config.where("estimate", "max_rms") == "camcal.yaml:5"
    assert config.where("absent") == "camcal.yaml"


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n", "{}"])
def test_an_empty_file_is_an_empty_configuration(load, text):
    assert validate(load(text), SCHEMA) == {}


def test_validate_gives_the_schemas_types_and_spelling(load):
    config = load("""
        max-rms: 1
        fix: [aspect, cx=320]
        robust: none
        hold-out: random
        crosscheck: false
        estimate:
          image_size: 640
        """)
    assert validate(config, SCHEMA) == {
        "max_rms": 1.0,
        "fix": ["aspect", "cx=320"],
        "robust": "none",
        "hold_out": "random",
        "crosscheck": False,
        "estimate": {"image_size": "640"},
    }


def test_one_value_stands_for_a_list_of_one(load):
    assert validate(load("fix: aspect"), SCHEMA) == {"fix": ["aspect"]}


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("\nmodle: x", "camcal.yaml:2: unknown key 'modle'.", "Did you mean 'model'?"),
        ("estimate:\n  modle: x", "camcal.yaml:2: unknown key 'modle'.", "Did you mean 'model'?"),
        ("image_size: 3x4", "camcal.yaml:1: unknown key 'image_size'.", "It belongs under estimate."),
        ("estimate: {seed: 1}", "camcal.yaml:1: unknown key 'seed'.", "Known under estimate:"),
        ("\n\nmax_rms: abc", "camcal.yaml:3: 'max_rms' is 'abc'; a number is needed.", None),
        ("max_rms: .nan", "'max_rms' is 'nan'; a number is needed.", None),
        ("max_rms: true", "'max_rms' is 'true'; a number is needed.", None),
        ("max_rms: [1]", "'max_rms' is a list; a number is needed.", None),
        ("max_rms:", "'max_rms' has no value; a number is needed.", "Remove the line"),
        ("seed: 1.0", "'seed' is '1.0'; a whole number is needed.", None),
        ("crosscheck: no", "'crosscheck' is 'no'; true or false is needed.", None),
        ("model: 5", "'model' is '5'; text is needed.", None),
        ("robust: hubr", "'robust' is 'hubr'; one of none, huber is needed.", "Did you mean 'huber'?"),
        ("hold_out: 1.5", "'hold_out' is '1.5'; a whole number or one of random is needed.", None),
        ("fix: [a, [b]]", "'fix' is a list; text is needed.", None),
        ("estimate: 3", "'estimate' is '3'; a group of `key: value` lines under it is needed.", None),
        ("estimate: {image_size: [1, 2]}", "is a list; a size such as 640x480 is needed.", None),
        ("max_rms: 1\nmax-rms: 1", "camcal.yaml:2: 'max-rms' is given a second time", None),
    ],
)
def test_what_the_schema_refuses(load, text, message, hint):
    config = load(text)
    with pytest.raises(UsageError) as caught:
        validate(config, SCHEMA)
    assert message in caught.value.message
    assert (caught.value.hint or "").startswith(hint or "")
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb:\n  c: 1\n  c: 2", "camcal.yaml:4: 'c' is given a second time, after line 3"),
        ("model: [1,", "camcal.yaml:1: not valid YAML"),
        ("a: 1\n b: 2", "camcal.yaml:2: not valid YAML"),
        ("a: 1\n---\nb: 2", "camcal.yaml:2: not valid YAML"),
        ("a: 1\nb: \x01", "camcal.yaml:2: not valid YAML: the sign '\\x01'"),
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
        (b"#" * (2 << 20), "more than 1048576 bytes"),
    ],
)
def test_what_the_loader_refuses(load, text, message):
    with pytest.raises(UsageError) as caught:
        load(text)
    assert message in caught.value.message


def test_missing_file(tmp_path):
    with pytest.raises(UsageError, match="cannot be read: no such file"):
        load_config(tmp_path / "absent.yaml")


def test_a_byte_order_mark_is_skipped(load):
    assert load(b"\xef\xbb\xbfmodel: a\r\n").data == {"model": "a"}


def test_numpy_is_not_loaded():
    code = (
        "import sys, camcal.data.config, camcal.data.writing; assert not {'numpy', 'cv2'} & set(sys.modules)"
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
        validate(load(data), SCHEMA)
    except CamcalError as error:
        assert error.message.endswith(".")
