"""docs/troubleshooting.md lists every warning that camcal gives."""

import ast
from pathlib import Path

import camcal
from camcal.report.troubleshooting import DOCS, REMEDIES, found_by_code, page

PACKAGE = Path(camcal.__file__).parent
#: rooms and files whose calls CalibrationWarning(code, ...) and warning(code, ...) are warnings of a report
MAKERS = ("CalibrationWarning", "warning")


def codes():
    """The codes that stand in the source as the first argument of a call that makes a warning."""
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in MAKERS and node.args:
                first = node.args[0]
                if isinstance(first, ast.Constant) and isinstance(first.value, str):
                    yield first.value


def test_the_page_is_current():
    """Renew it with `python -m camcal.report.troubleshooting > docs/troubleshooting.md`."""
    assert (DOCS / "troubleshooting.md").read_text(encoding="utf-8") == page()


def test_every_code_is_listed():
    given, listed = set(codes()), set(found_by_code())
    assert len(given) > 40 and given <= listed, given - listed
    assert listed == set(REMEDIES)
