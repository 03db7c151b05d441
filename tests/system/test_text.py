"""Text that leaves the program: nothing a terminal or a spreadsheet would obey, and nothing lost in documents."""

import json
import os

import yaml
from hypothesis import given
from hypothesis import strategies as st

from camcal.report.yaml import dump_json, dump_yaml
from camcal.system.text import cell, escaped, from_cell, has_unsafe, listed, message, printable, readable

BAD = ["\x1b[31m", "\x9b31m", "a\u202eb", "\u2066x", "\x07", "\x7f", "\u2028"]
TEXT = st.text(st.characters(codec="utf-8")) | st.sampled_from(BAD)


@given(TEXT)
def test_nothing_is_left_for_a_terminal(text):
    shown = printable(text)
    assert not has_unsafe(shown)
    assert len(shown) == len(text)
    assert "\n" not in message(text)


def test_names_that_are_not_utf_8():
    name = os.fsdecode(b"h\xf6he")
    assert readable(name) == r"h\xf6he"
    assert printable("ü±█ \t\n") == "ü±█ \t\n"


def test_long_words_and_long_messages_are_cut():
    assert len(message("x" * 900_000)) < 350
    assert len(message("word " * 100_000)) < 2100
    assert message("x" * 299 + " " + "y" * 299) == "x" * 299 + " " + "y" * 299
    assert message("x" * 301) == "x" * 150 + "..." + "x" * 75


@given(TEXT)
def test_documents_hold_every_text_and_no_control_character(text):
    for dump, read in ((dump_json, json.loads), (dump_yaml, yaml.safe_load)):
        written = dump({"a": text, "b": [text], text or "k": 1})
        assert not has_unsafe(written)
        assert read(written) == {"a": text, "b": [text], text or "k": 1}


@given(TEXT | st.text("'=+-@\t1.e", max_size=6))
def test_cells(name):
    assert from_cell(cell(name)) == name
    assert not cell(name).startswith(("=", "@"))


def test_cells_of_numbers_are_numbers():
    assert cell("-1.5e-3") == "-1.5e-3"
    assert cell("-cmd|' /C calc'!A0") == "'-cmd|' /C calc'!A0"
    assert escaped("a\u202eb") == "a\\u202eb"


def test_a_long_list_is_cut_and_the_rest_counted():
    assert listed(["a", "b"], 2) == "a, b"
    assert listed(["a", "b", "c"], 2) == "a, b and 1 more"
    assert listed([]) == ""
