"""Memory that the C library keeps for the next array."""

import ctypes
import subprocess
import sys

import pytest

#: megabytes that are free in the heap after four arrays were, and that lie outside the heap while they are there
AFTER = """
import ctypes, sys
import numpy as np
from camcal.system.processes import keep_freed_memory
names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
class Info(ctypes.Structure):
    _fields_ = [(n, ctypes.c_size_t) for n in names]
info = ctypes.CDLL(None).mallinfo2
info.restype = Info
if sys.argv[1] == "kept":
    keep_freed_memory()
for megabytes in (8, 48):
    arrays = [np.ones(megabytes << 17) for _ in range(4)]
    outside = info().hblkhd
    del arrays
    print(info().fordblks >> 20, outside >> 20)
"""


def after(how: str) -> list[list[int]]:
    out = subprocess.run([sys.executable, "-c", AFTER, how], capture_output=True, text=True, check=True)
    return [[int(n) for n in line.split()] for line in out.stdout.splitlines()]


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="needs glibc 2.33"
)
def test_freed_arrays_are_kept_up_to_a_limit():
    """Four arrays of 8 MB, from the heap, and of 48 MB, which are the system's own again once they are freed."""
    (small, outside), (large, own) = after("kept")
    assert small >= 31 and outside < 8
    assert large < 48 and own >= 4 * 48
    (small, _), _ = after("default")
    assert small < 31
