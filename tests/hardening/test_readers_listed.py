"""Every module that reads files is reached by a reader of tests/hardening/readers.py, so that it is fuzzed."""

import ast
import shutil
import sys
from pathlib import Path

import camcal
from tests.hardening.readers import subjects
from tests.hardening.test_fuzz import BESIDE, check, seeds

ROOT = Path(camcal.__file__).parent
#: the only modules that open files for others or take documents apart (tests/system holds that there are no others)
READING = ("camcal.system.reading", "camcal.system.documents", "camcal.report.yaml")
READERS = ("read_file", "read_text", "read_document", "parse_yaml", "parse_json", "parse_toml")
#: modules that read, but nothing that a stranger made, or nothing by themselves
NOT_READERS = {
    "batch/run.py": "rows and reports of the batch's own folder; one that does not fit is done again",
    "batch/storage.py": "hands on the text of a file",
    "report/triangulation.py": "asks a file that `placed cameras` has read for more",
}


def reading():
    """The modules, by path, that import something that reads."""
    found = set()
    for path in ROOT.rglob("*.py"):
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(("system/", "cli/")):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module in READING:
                found |= {name for alias in node.names if alias.name in READERS}
    return found


def test_every_module_that_reads_is_reached(made, tmp_path):
    for name in BESIDE:
        shutil.copyfile(made / name, tmp_path / name)
    reached = set()

    def note(frame, event, arg):
        if event == "call":
            reached.add(frame.f_code.co_filename)

    for subject in subjects():
        for ending, data in seeds(made, subject):
            sys.setprofile(note)
            try:
                check(subject, tmp_path / f"input{ending}", data)
            finally:
                sys.setprofile(None)
    names = {Path(f).relative_to(ROOT).as_posix() for f in reached if f.startswith(str(ROOT))}
    missing = reading() - names - set(NOT_READERS)
    assert not missing, missing
    assert set(NOT_READERS) <= reading(), "these read no longer"
