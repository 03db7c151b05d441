"""flag > environment > file > default, and what is said of a bad value in each of them."""

from pathlib import Path

import pytest

CONFIG = """\
model: opencv8
max-rms: 1
fix: [p1, k3=0.1]
image_size: [640, 480]
toy:
  max_rms: 0.5
  crosscheck: false
"""


@pytest.fixture
def config():
    path = Path("camcal.yaml")
    path.write_text(CONFIG)
    return path


def test_defaults(resolved):
    found = resolved()
    assert {entry["from"] for entry in found.values()} == {"default"}
    assert found["model"]["value"] == "auto"
    assert found["crosscheck"]["value"] is True
    assert found["fix"]["value"] == {}
    assert "config" not in found


def test_file(resolved, config):
    found = resolved()
    assert found["model"] == {"value": "opencv8", "from": "file"}
    assert found["max_rms"] == {"value": 0.5, "from": "file"}  # the command's own key wins over the top
    assert found["crosscheck"] == {"value": False, "from": "file"}
    assert found["fix"] == {"value": {"p1": None, "k3": 0.1}, "from": "file"}
    assert found["image_size"] == {"value": [640, 480], "from": "file"}
    assert found["seed"] == {"value": 0, "from": "default"}
    assert found["config"] == {"value": "camcal.yaml", "from": "default"}


def test_environment_wins_over_file(resolved, config, monkeypatch):
    for name, value in {"MODEL": "opencv4", "MAX_RMS": "2", "CROSSCHECK": "1", "FIX": "p2,k1=0"}.items():
        monkeypatch.setenv(f"CAMCAL_{name}", value)
    found = resolved()
    assert found["model"] == {"value": "opencv4", "from": "env"}
    assert found["max_rms"] == {"value": 2.0, "from": "env"}
    assert found["crosscheck"] == {"value": True, "from": "env"}
    assert found["fix"] == {"value": {"p2": None, "k1": 0.0}, "from": "env"}


def test_flag_wins_over_all(resolved, config, monkeypatch):
    monkeypatch.setenv("CAMCAL_MODEL", "opencv4")
    monkeypatch.setenv("CAMCAL_CROSSCHECK", "0")
    found = resolved(
        "--model", "pinhole", "--crosscheck", "--fix", "k1", "--fix", "k2=1,p1", "--max-rms", "3"
    )
    assert found["model"] == {"value": "pinhole", "from": "flag"}
    assert found["crosscheck"] == {"value": True, "from": "flag"}
    assert found["fix"] == {"value": {"k1": None, "k2": 1.0, "p1": None}, "from": "flag"}
    assert found["max_rms"] == {"value": 3.0, "from": "flag"}


def test_a_named_file_replaces_the_one_of_the_folder(resolved, config, monkeypatch):
    Path("other.yaml").write_text("seed: 7\n")
    assert resolved("--config", "other.yaml")["seed"] == {"value": 7, "from": "file"}
    assert resolved("--config", "other.yaml")["model"] == {"value": "auto", "from": "default"}
    monkeypatch.setenv("CAMCAL_CONFIG", "other.yaml")
    assert resolved()["seed"] == {"value": 7, "from": "file"}
    assert resolved()["config"] == {"value": "other.yaml", "from": "env"}


def test_keys_of_other_commands_are_known(resolved):
    Path("camcal.yaml").write_text("points3d: a.csv\nestimate:\n  seed: 3\n")
    assert resolved()["seed"]["value"] == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("modle: pinhole\n", "Error: camcal.yaml:1: unknown key 'modle'.\n  Did you mean 'model'?\n"),
        ("model: pinhole\ntoy:\n  seeed: 1\n", "Error: camcal.yaml:3: unknown key 'seeed'."),
        ("seed: 1\nmodel: pinhole\nseed: 2\n", "Error: camcal.yaml:3: 'seed' is given a second time"),
        ("seed: 1\nmodel: opencv6\n", "Error: camcal.yaml:2: model: unknown model 'opencv6'."),
        ("\n\ntoy:\n  image-size: 640\n", "Error: camcal.yaml:4: image-size: 640 is not an image size"),
        ("max_rms: much\n", "Error: camcal.yaml:1: max_rms: 'much' is not a number above 0."),
        ("max_rms: -1\n", "Error: camcal.yaml:1: max_rms: -1 is not a number above 0."),
        ("seed: 1.5\n", "Error: camcal.yaml:1: seed: 1.5 is not a whole number from 0 up."),
        ("skew: no\n", "Error: camcal.yaml:1: skew: 'no' is not true or false."),
        (
            "robust: nome\n",
            "Error: camcal.yaml:1: robust: unknown robust method 'nome'.\n  Did you mean 'none'?",
        ),
        ("- a\n", "Error: camcal.yaml:1: "),
        ("model: [\n", "Error: camcal.yaml:2: not valid YAML"),
        ("config: other.yaml\n", "Error: camcal.yaml:1: unknown key 'config'."),
    ],
)
def test_bad_file(toy, text, message):
    Path("camcal.yaml").write_text(text)
    code, out, err = toy("show")
    assert (code, out) == (2, "")
    assert err.startswith(message)


def test_missing_file(toy):
    code, _, err = toy("show", "--config", "absent.yaml")
    assert code == 2
    assert "absent.yaml" in err


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--image-size", "640"], "--image-size: '640' is not an image size; width x height in pixels"),
        (["--image-size", "0x4"], "--image-size: a picture of 0x4 has no pixels."),
        (["--board", "9by6"], "--board: '9by6' is not the size of a board."),
        (["--board", "1x6"], "--board: a board of 1x6 cannot be used."),
        (["--square", "25 parsec"], "--square: '25 parsec' is not a length.\n  Write a positive number"),
        (["--square", "wide"], "--square: 'wide' is not a length."),
        (["--square", "-2mm"], "--square: '-2mm' is not a length."),
        (["--square", "1e999"], "--square: '1e999' is not a length."),
        (["--fix", "k1=x"], "--fix: k1=x: 'x' is not a number."),
        (["--fix", "k1=nan"], "--fix: k1=nan: 'nan' is not a number."),
        (["--fix", "k1="], "--fix: 'k1=' is not NAME or NAME=VALUE."),
        (["--fix", "k1=1", "--fix", "k1=2"], "--fix: 'k1' is given twice, with different values."),
        (["--max-rms", "x"], "--max-rms: 'x' is not a number above 0."),
        (["--seed", "-1"], "--seed: '-1' is not a whole number from 0 up."),
    ],
)  # fmt: skip
def test_bad_flag(toy, args, message):
    code, out, err = toy("show", *args)
    assert (code, out) == (2, "")
    assert err.startswith(f"Error: {message}")


def test_bad_environment(toy, monkeypatch):
    monkeypatch.setenv("CAMCAL_BOARD", "nine")
    code, _, err = toy("show")
    assert code == 2
    assert err.startswith("Error: CAMCAL_BOARD: 'nine' is not the size of a board.")


@pytest.mark.parametrize(
    ("text", "value"),
    [("25mm", "25mm"), ("0.025 m", "0.025m"), ("25", "25"), ("1e1um", "10um")],
)
def test_lengths(resolved, text, value):
    assert resolved("--square", text)["square"]["value"] == value


def test_quoted_yaml_values_and_numbers(resolved):
    Path("camcal.yaml").write_text('square: 25\nimage_size: "640x480"\nfix: p1,p2\n')
    found = resolved()
    assert found["square"]["value"] == "25"
    assert found["image_size"]["value"] == [640, 480]
    assert found["fix"]["value"] == {"p1": None, "p2": None}


@pytest.mark.parametrize(
    "args, option",
    [
        (["undistort", "a.png", "-o", "out"], "--camera"),
        (["batch", "."], "--output"),
        (["hand-eye", "r.yaml"], "--poses"),
        (["detect", "a.png"], "--output"),
    ],
)
def test_a_required_option_is_asked_for(camcal, args, option):
    code, _, err = camcal(*args)
    assert code == 2 and option in err


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (("--crosscheck", "full"), "full"),
        (("--crosscheck=full",), "full"),
        (("--crosscheck=full", "--seed=3"), "full"),
        (("--crosscheck",), True),
        (("--no-crosscheck",), False),
        (("--no-crosscheck", "--crosscheck", "full"), "full"),
        (("--crosscheck", "full", "--no-crosscheck"), False),
        (("--crosscheck", "--seed", "3"), True),
    ],
)
def test_a_switch_with_a_word(resolved, words, value):
    assert resolved(*words)["crosscheck"] == {"value": value, "from": "flag"}


def test_the_word_of_a_switch_from_elsewhere(resolved, monkeypatch):
    monkeypatch.setenv("CAMCAL_CROSSCHECK", "full")
    assert resolved()["crosscheck"] == {"value": "full", "from": "env"}
    monkeypatch.setenv("CAMCAL_CROSSCHECK", "fully")
    with pytest.raises(Exception, match="fully"):
        resolved()
