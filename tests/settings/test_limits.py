"""Limits of configurations and lengths, each just below and just above."""

import pytest

from camcal.errors import UsageError
from camcal.settings import config, sizes, yaml_strict
from tests.sides import LESS, MORE


@pytest.mark.parametrize(
    ("value", "good"),
    [
        (MORE * sizes.LEAST_LENGTH, True),
        (LESS * sizes.LEAST_LENGTH, False),
        (LESS * sizes.MOST_LENGTH, True),
        (MORE * sizes.MOST_LENGTH, False),
    ],
)
def test_lengths(value, good):
    if good:
        assert sizes.parse_length(f"{value!r}mm").value == value
        return
    with pytest.raises(UsageError, match="is not a length"):
        sizes.parse_length(f"{value!r}mm")


def test_levels_of_a_configuration():
    deepest = yaml_strict.DEEPEST
    for depth in (deepest, deepest + 1):
        text = "[" * depth + "]" * depth
        if depth == deepest:
            yaml_strict._refuse_features(text, "camcal.yaml")
        else:
            with pytest.raises(UsageError, match=f"more than {deepest} deep"):
                yaml_strict._refuse_features(text, "camcal.yaml")


def test_digits_of_a_whole_number(tmp_path, monkeypatch):
    longest = yaml_strict.LONGEST_INTEGER
    for digits in (longest, longest + 1):
        text = f"a: {'9' * digits}\n"
        if digits == longest:
            assert yaml_strict.parse(text, "camcal.yaml")[0]["a"] == int("9" * digits)
        else:
            with pytest.raises(UsageError, match=f"{digits} digits"):
                yaml_strict.parse(text, "camcal.yaml")


def test_bytes_of_a_configuration(tmp_path):
    path = tmp_path / "camcal.yaml"
    path.write_text("#" * config.LARGEST)
    assert len(config._read(str(path))) == config.LARGEST
    path.write_text("#" * (config.LARGEST + 1))
    with pytest.raises(UsageError, match="more than 1 MB"):
        config._read(str(path))
