"""Pictures that other processes search: copies of this one, or new interpreters."""

import os
import subprocess
import sys

import numpy as np
import pytest

from camcal.detect import workers
from camcal.detect.images import detect_images
from camcal.detect.workers import ALONE, ALONE_BEFORE_COPIES, WORTH_COPIES, WORTH_IT, Workers
from camcal.errors import DataError
from camcal.system import processes
from tests.detect.test_refine_images import pictures  # noqa: F401
from tests.sides import LESS, MORE


@pytest.fixture
def at_once(monkeypatch):
    """Other processes are started whatever the work."""
    monkeypatch.setattr(Workers, "_worth_others", lambda self, left: self._open and self.jobs > 1)


def die(item):
    if item == 2:
        os._exit(1)
    return item


def nothing(item):
    return -item


def test_a_process_that_dies_costs_one_picture(at_once):
    with Workers(2) as two:
        assert dict(two.map_unordered(die, [1, 2, 3], nothing)) == {0: 1, 1: -2, 2: 3}


def test_processes_serve_several_searches_and_are_ended(at_once):
    import multiprocessing

    before = set(multiprocessing.active_children())
    with Workers(2) as two:
        assert dict(two.map_unordered(abs, [-1, -2], nothing)) == {0: 1, 1: 2}
        during = set(multiprocessing.active_children()) - before
        assert dict(two.map_unordered(abs, [-3, -4], nothing)) == {0: 3, 1: 4}
        assert during and set(multiprocessing.active_children()) - before == during
    assert set(multiprocessing.active_children()) <= before


def test_interruption_ends_the_processes(at_once):
    import multiprocessing

    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt), Workers(2) as two:
        next(two.map_unordered(abs, list(range(50)), abs))
        raise KeyboardInterrupt
    assert set(multiprocessing.active_children()) <= before
    with Workers(2) as two:
        running = two.map_unordered(abs, list(range(50)), abs)
        next(running)
        with pytest.raises(KeyboardInterrupt):
            running.throw(KeyboardInterrupt())
        assert set(multiprocessing.active_children()) <= before
    assert set(multiprocessing.active_children()) <= before


def test_the_first_wait_is_used_once(at_once):
    waited = []
    with Workers(2, lambda: waited.append(1)) as two:
        list(two.map_unordered(abs, [-1, -2], nothing))
        list(two.map_unordered(abs, [-1, -2], nothing))
    assert waited == [1]


@pytest.mark.parametrize(
    ("copies", "alone", "least"), [(False, ALONE, WORTH_IT), (True, ALONE_BEFORE_COPIES, WORTH_COPIES)]
)
def test_others_are_started_for_enough_work(monkeypatch, copies, alone, least):
    monkeypatch.setattr(workers, "copies_itself", lambda: copies)
    few, many, one = Workers(2), Workers(2), Workers(1)
    for each in (few, many, one):
        monkeypatch.setattr(each, "_open", True)
    few.items = many.items = 1
    few.seconds, many.seconds = LESS * alone, MORE * alone
    assert not few._worth_others(10**6) and many._worth_others(10**6)
    assert not many._worth_others(1)
    many.seconds, many.items = 1.0, 100  # .01 s an item
    assert not many._worth_others(int(LESS * least / 0.01)) and many._worth_others(
        int(MORE * least / 0.01) + 1
    )
    one.seconds, one.items = 1.0, 1
    assert not one._worth_others(10**6)


def test_outside_their_context_no_processes_are_started(monkeypatch):
    monkeypatch.setattr(Workers, "_started", lambda _: pytest.fail("started"))
    outside = Workers(2)
    outside.seconds, outside.items = 100.0, 1
    assert dict(outside.map_unordered(abs, [-1, -2, -3], nothing)) == {0: 1, 1: 2, 2: 3}
    with Workers(2) as two:
        pass
    two.seconds, two.items = 100.0, 1
    assert dict(two.map_unordered(abs, [-1, -2, -3], nothing)) == {0: 1, 1: 2, 2: 3}


def test_a_search_ends_its_processes_also_where_it_looks_again(pictures, monkeypatch):  # noqa: F811
    """What is found instead of the wanted target is looked for at the end."""
    import multiprocessing

    monkeypatch.setattr(workers, "ALONE", -1.0)
    monkeypatch.setattr(workers, "WORTH_IT", -1.0)
    before, folder = set(multiprocessing.active_children()), pictures[0]
    for name in ("2.png", "3.png", "4.png"):
        (folder / name).write_bytes((folder / "0.png").read_bytes())
    with pytest.raises(DataError, match="no 9x8 checkerboard"):
        detect_images([folder], board="9x8", jobs=2, cache=False)
    assert set(multiprocessing.active_children()) <= before


def test_a_process_with_one_thread_is_copied(monkeypatch, tmp_path):
    for number, expected in ((1, sys.platform == "linux"), (2, False)):
        folder = tmp_path / str(number)
        for thread in range(number):
            (folder / str(thread)).mkdir(parents=True)
        monkeypatch.setattr(processes, "Path", lambda _, folder=folder: folder)
        assert processes.copies_itself() == expected
    monkeypatch.setattr(processes, "Path", lambda _: tmp_path / "absent")
    assert not processes.copies_itself()


SCRIPT = """
import os, signal, sys
from camcal.detect.workers import Workers
from camcal.system.processes import copies_itself, end_on_signals

end_on_signals()
assert copies_itself()
Workers._worth_others = lambda *_: True

def handled(name):
    return signal.getsignal(getattr(signal, name)) is signal.SIG_DFL

with Workers(2) as two:
    done = two.map_unordered(handled, ["SIGTERM", "SIGHUP"], str)
    print(sorted(done), two._pool._mp_context.get_start_method())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="copies of a process are used on Linux")
def test_copies_end_on_signals_as_any_process():
    """They would else take the parent's `Terminated` for the result of an item, and stay."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=60, env=environment
    )
    assert done.stdout == "[(0, True), (1, True)] fork\n", done.stderr


def test_a_script_that_calls_it_on_its_top_level_runs_once(tmp_path):
    """Processes that are started afresh import the script that started them, unless they are kept from it."""
    script = tmp_path / "script.py"
    script.write_text(
        "from camcal.detect import workers\n"
        "workers.copies_itself = lambda: False\n"
        "workers.Workers._worth_others = lambda *_: True\n"
        "print('began', flush=True)\n"
        "with workers.Workers(2) as two:\n"
        "    print(sorted(two.map_unordered(abs, [-1, -2, -3, -4], abs)), flush=True)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.stdout.split("\n")[:2] == ["began", "[(0, 1), (1, 2), (2, 3), (3, 4)]"], done.stderr
    assert done.stdout.count("began") == 1


def test_a_class_of_the_script_reaches_the_processes(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from camcal.detect import workers\n"
        "class Own(int):\n    def __abs__(self):\n        return 7\n"
        "if __name__ == '__main__':\n"
        "    workers.copies_itself = lambda: False\n"
        "    workers.Workers._worth_others = lambda *_: True\n"
        "    with workers.Workers(2) as two:\n"
        "        print(sorted(two.map_unordered(abs, [Own(-1), Own(-2)], abs)))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.stdout == "[(0, 7), (1, 7)]\n", done.stderr


def test_processes_find_the_same(pictures, at_once):  # noqa: F811
    folder, *_ = pictures
    many = detect_images([folder], jobs=2, cache=False)
    alone = detect_images([folder], jobs=1, cache=False)
    for a, b in zip(alone.views, many.views, strict=True):
        assert a.id == b.id
        np.testing.assert_array_equal(a.uv, b.uv)


def test_an_error_after_the_work_waits_for_the_processes(at_once, monkeypatch):
    """Else the interpreter's end meets a pool that is about to close, now and then with a traceback."""
    ended = []
    end = Workers._end
    monkeypatch.setattr(Workers, "_end", lambda self, finished: ended.append(finished) or end(self, finished))
    with pytest.raises(ValueError, match="wrong"), Workers(2) as two:
        list(two.map_unordered(abs, [-1, -2], nothing))
        raise ValueError("wrong")
    with pytest.raises(KeyboardInterrupt), Workers(2) as two:
        kept = two.map_unordered(abs, list(range(50)), nothing)
        next(kept)
        raise KeyboardInterrupt
    assert ended[:2] == [True, False]
