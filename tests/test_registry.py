"""Names that are looked up, and their modules imported."""

from __future__ import annotations

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from camcal.registry import load


def test_a_thread_waits_for_another_ones_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "slowly_imported.py").write_text("import time\ntime.sleep(0.3)\nvalue = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(load, "slowly_imported:value")
        while "slowly_imported" not in sys.modules and not first.done():
            time.sleep(0.001)
        second = pool.submit(load, "slowly_imported:value")
        assert (first.result(), second.result()) == (1, 1)
