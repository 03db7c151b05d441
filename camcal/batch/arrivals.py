"""Pictures arriving in a folder: each is reported once when it is complete, and again when it changes."""

from __future__ import annotations

import time
from pathlib import Path

from camcal.detect.listing import PICTURES, natural_order
from camcal.records import dataclass

#: s; a file without the mark of a complete picture is taken when it has not changed for so long: writers that stop for
#: longer (a camera over a slow link) are noticed by the change that follows
SETTLED = 2.0
#: endings of complete files, and the names that have them
_ENDS = {(".jpg", ".jpeg", ".jpe"): b"\xff\xd9", (".png",): b"IEND\xaeB`\x82"}
#: bytes at the end of a file in which the mark is looked for; some cameras add zeros
_TAIL = 64


@dataclass
class _Seen:
    signature: tuple[int, int]
    since: float
    taken: bool = False


class Arrivals:
    """The pictures of a folder that are new or have changed since the last look.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._seen: dict[Path, _Seen] = {}

    def look(self) -> tuple[list[Path], list[Path]]:
        """Pictures to process now, in natural order, and processed ones that were removed."""
        now = time.monotonic()
        there = {}
        for path in sorted(self.folder.iterdir(), key=natural_order):
            if path.name.startswith(".") or path.suffix.lower() not in PICTURES:
                continue
            try:
                found = path.stat()
            except FileNotFoundError:  # renamed or removed meanwhile
                continue
            there[path] = (found.st_size, found.st_mtime_ns)
        gone = [path for path, seen in self._seen.items() if path not in there and seen.taken]
        self._seen = {path: seen for path, seen in self._seen.items() if path in there}
        ready = []
        for path, signature in there.items():
            seen = self._seen.get(path)
            if seen is None or seen.signature != signature:
                self._seen[path] = seen = _Seen(signature, now)
            if not seen.taken and (is_complete(path) or now - seen.since >= SETTLED):
                seen.taken = True
                ready.append(path)
        return ready, gone

    @property
    def waiting(self) -> int:
        """Pictures that exist but are not complete."""
        return sum(not seen.taken for seen in self._seen.values())


def is_complete(path: Path) -> bool:
    """Return whether a file ends as a complete picture of its format does; False if the format has no such mark."""
    mark = next((end for names, end in _ENDS.items() if path.suffix.lower() in names), None)
    if mark is None:
        return False
    try:
        with path.open("rb") as stream:
            stream.seek(0, 2)
            stream.seek(max(0, stream.tell() - _TAIL))
            tail = stream.read().rstrip(b"\0")
    except OSError:
        return False
    return tail.endswith(mark)
