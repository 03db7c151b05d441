"""Limits of processes, memory and drawn sheets, each just below and just above."""

import time
from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

from camcal.detect import part, workers
from camcal.detect.targets.printing import png
from camcal.errors import UsageError


def test_items_that_are_ahead(monkeypatch):
    """Three for each process are queued or in progress."""
    taken, queued = [], []

    def items():
        for item in range(100):
            taken.append(item)
            yield item

    def submit(function, item):
        future = Future()
        queued.append((future, function, item))
        return future

    made = workers.Workers(4)
    monkeypatch.setattr(made, "_started", lambda: SimpleNamespace(submit=submit))
    monkeypatch.setattr(made, "_end", lambda _: None)

    def wait():
        if queued:
            future, function, item = queued.pop(0)
            future.set_result(function(item))

    monkeypatch.setattr(made, "_wait", wait)
    results = made._in_pool(int, enumerate(items()))
    assert next(results) == (0, 0) and len(taken) == 12
    assert next(results) == (1, 1) and len(taken) == 13
    results.close()


@pytest.mark.parametrize(("share", "waits"), [(0.7, True), (1.1, False)])
def test_time_for_a_process_to_end(monkeypatch, share, waits):
    """It is looked at again until it has ended, and for so long at most."""
    now, alive = [0.0], [True]
    child = SimpleNamespace(terminate=lambda: None)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def sleep(_):
        now[0] += workers.ENDED / 4
        alive[0] = now[0] < share * workers.ENDED

    monkeypatch.setattr(time, "sleep", sleep)
    monkeypatch.setattr("multiprocessing.active_children", lambda: [child] if alive[0] else [])
    monkeypatch.setattr(workers, "set", lambda some: _Children(some), raising=False)
    workers._end_children(_Children([]))
    assert alive[0] != waits and now[0] <= workers.ENDED


class _Children(list):
    """A set of objects that have no hash."""

    def __sub__(self, other):
        return _Children(c for c in self if c not in other)


def test_bytes_of_parts_that_are_kept():
    def piece(size):
        return part.Part(np.zeros((1, size), np.uint8), 0, 0, (1, size), 255.0, 200.0)

    for more, both in ((0, True), (1, False)):
        kept = part.Kept()
        kept.keep("first", piece(1000))
        assert not kept.full
        kept.keep("second", piece(part.KEPT - 1000 + more))
        assert (kept.get("second") is not None) == both and kept.full
        kept.clear()
        assert not kept.full


def test_pixels_of_a_sheet(monkeypatch):
    """Of 100 x 50 mm at a pixel a millimetre."""
    sheet = SimpleNamespace(width=100.0, height=50.0, polygons=[], lines=[], circles=[], texts=[])

    class DrawnError(Exception):
        pass

    def zeros(*_):
        raise DrawnError

    monkeypatch.setattr(png.np, "zeros", zeros)
    for most, error in ((5000, DrawnError), (4999, UsageError)):
        monkeypatch.setattr(png, "MOST_PIXELS", most)
        with pytest.raises(error):
            png.draw(sheet, 25.4)


def test_the_largest_sheet():
    """A0 at 300 dpi is drawn, and at 400 dpi it is not."""
    area = 841 * 1189 / 25.4**2
    assert 300**2 * area < png.MOST_PIXELS < 400**2 * area
