"""Where a batch reads and writes: a local folder, or any file system that fsspec knows (s3, gs, ssh, ...)."""

from __future__ import annotations

import posixpath
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from camcal.errors import DataError, UsageError
from camcal.system.documents import LARGEST
from camcal.system.reading import read_text
from camcal.system.writing import atomic_write


def is_remote(path: str) -> bool:
    """Whether a path names a file system: `s3://bucket/folder`."""
    return "://" in path


class Storage:
    """A folder.

    Parameters
    ----------
    root : str
        A local path, or an address such as `s3://bucket/folder`.

    Raises
    ------
    UsageError
        Where fsspec, or what it needs for this address, is not installed.
    """

    def __init__(self, root: str):
        self.root = root if is_remote(root) else str(Path(root).absolute())
        self.remote: Any
        self.remote, self._folder = _connect(root) if is_remote(root) else (None, self.root)

    def _path(self, name: str) -> str:
        return posixpath.join(self._folder, name) if name else self._folder

    def make(self, name: str = "") -> None:
        """Make a folder, and those above it."""
        if self.remote is not None:
            self.remote.makedirs(self._path(name), exist_ok=True)
            return
        root = Path(self._folder)
        if root.exists() and not root.is_dir():
            raise UsageError(f"cannot write to '{root}': it is a file.", "Give the name of a folder.")
        Path(self._path(name)).mkdir(parents=True, exist_ok=True)

    def write(self, name: str, text: str) -> None:
        """Write a file in full or not at all; one of that name is replaced."""
        if self.remote is None:
            atomic_write(self._path(name), text, force=True)
        else:  # an object store shows a file when it is complete
            self.remote.pipe_file(self._path(name), text.encode("utf-8"))

    def read(self, name: str) -> str | None:
        """The text of a file; None where there is none."""
        try:
            if self.remote is None:
                if not Path(self._path(name)).exists():
                    return None
                return read_text(self._path(name), LARGEST)
            return self.remote.cat_file(self._path(name)).decode("utf-8")
        except FileNotFoundError:
            return None

    def names(self, folder: str = "") -> set[str]:
        """The names in a folder; none where it does not exist."""
        try:
            if self.remote is None:
                return {path.name for path in Path(self._path(folder)).iterdir()}
            return {
                posixpath.basename(p.rstrip("/")) for p in self.remote.ls(self._path(folder), detail=False)
            }
        except (FileNotFoundError, NotADirectoryError):
            return set()

    def remove(self, name: str) -> None:
        """Remove a file."""
        if self.remote is None:
            Path(self._path(name)).unlink(missing_ok=True)
        else:
            self.remote.rm_file(self._path(name))


def _connect(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError:
        raise UsageError(
            f"'{address}' needs fsspec, which is not installed.", "Try: pip install 'camcal[cluster]'"
        ) from None
    try:
        return fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise UsageError(f"cannot open '{address}': {error}.", "Check the address.") from None


@contextmanager
def local_copies(sources: Sequence[str]) -> Iterator[list[str]]:
    """Local paths of inputs; remote files and folders are copied for as long as they are needed.

    Raises
    ------
    DataError
        Where a remote input cannot be read.
    """
    if not any(map(is_remote, sources)):
        yield list(sources)
        return
    with tempfile.TemporaryDirectory(prefix="camcal-") as folder:
        paths = []
        for number, source in enumerate(sources):
            if not is_remote(source):
                paths.append(source)
                continue
            remote, path = _connect(source)
            target = Path(folder) / str(number) / posixpath.basename(path.rstrip("/"))
            target.parent.mkdir()
            try:
                remote.get(path, str(target), recursive=remote.isdir(path))
            except Exception as error:  # noqa: BLE001 - each file system raises errors of its own
                raise DataError(f"{source}: cannot be read: {error}.", "Check the address.") from None
            paths.append(str(target))
        yield paths
