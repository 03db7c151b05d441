import importlib
import json

import pytest
import yaml

from camcal.cli.list_ import TABLES, entries


@pytest.mark.parametrize("kind", TABLES)
def test_json_is_the_table(camcal, kind):
    code, out, err = camcal("list", kind, "--format", "json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    module, attribute = TABLES[kind]
    table = getattr(importlib.import_module(module), attribute, {})
    assert [entry["name"] for entry in found] == list(table)
    assert yaml.safe_load(camcal("list", kind, "--format", "yaml")[1]) == found


@pytest.mark.parametrize("kind", TABLES)
def test_each_entry_has_a_summary(kind):
    assert [entry["name"] for entry in entries(kind) if not entry["summary"]] == []


def test_formats_say_what_they_hold(camcal):
    found = {e["name"]: e for e in json.loads(camcal("list", "formats", "--format", "json")[1])}
    assert found["kalibr"]["poses"] and "mei" in found["kalibr"]["models"] and found["ros"]["writes"] == "yes"
    assert found["matlab"]["first_pixel"] == "(1, 1)" and not found["zhang"]["image_size"]
    assert "opencv4 +skew" in camcal("list", "formats")[1]


@pytest.mark.parametrize("kind", TABLES)
def test_table_fits(camcal, kind):
    code, out, _ = camcal("list", kind)
    assert code == 0
    assert all(entry["name"] in out for entry in entries(kind))
    assert max(map(len, out.splitlines())) <= 80
