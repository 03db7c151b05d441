"""The storage of a batch: a local folder, or any file system supported by fsspec (s3, gs, ssh, ...)."""

from __future__ import annotations

import posixpath
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from camcal.errors import CamcalError, DataError, UsageError
from camcal.system.documents import LARGEST
from camcal.system.reading import read_text
from camcal.system.writing import atomic_write

_MEMORY = "memory:"


def is_remote(path: str) -> bool:
    """Return whether a path names a remote file system: `s3://bucket/folder`."""
    return "://" in path


def shown(address: str) -> str:
    """An address without its password, for display and storage."""
    return re.sub(r"(://[^/@:]*):[^/@]*@", r"\1:***@", address)


@contextmanager
def _answers(address: str, what: str) -> Iterator[None]:
    """Convert any error of a remote file system, each of which has its own exceptions, into a message.

    Raises
    ------
    DataError
        FileNotFoundError passes: what is not there is an answer.
    """
    try:
        yield
    except (FileNotFoundError, CamcalError):
        raise
    except ImportError as error:  # each file system needs a package of its own
        raise DataError(
            f"{shown(address)}: {' '.join(str(error).split()).rstrip('.')}.",
            "Install that package along with camcal, and on the workers of a cluster.",
        ) from None
    except Exception as error:  # noqa: BLE001
        why = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise DataError(
            f"{shown(address)}: cannot be {what}: {shown(why)}.",
            "Check the address and your access rights.",
        ) from None


class Storage:
    """A folder.

    Parameters
    ----------
    root : str
        A local path, or an address such as `s3://bucket/folder`.

    Raises
    ------
    UsageError
        If fsspec, or what it needs for this address, is not installed; for `-`.
    """

    def __init__(self, root: str):
        if root == "-":
            raise UsageError(
                "'-' is not a folder name.", "A batch writes several files: give a folder for them."
            )
        self.root = root if is_remote(root) else str(Path(root).absolute())
        self.remote: Any
        self.remote, self._folder = _connect(root) if is_remote(root) else (None, self.root)

    def _path(self, name: str) -> str:
        return posixpath.join(self._folder, name) if name else self._folder

    def make(self, name: str = "") -> None:
        """Make a folder and its parents."""
        if self.remote is not None:
            with _answers(self.root, "written"):
                self.remote.makedirs(self._path(name), exist_ok=True)
            return
        root = Path(self._folder)
        if root.exists() and not root.is_dir():
            raise UsageError(f"cannot write to '{root}': it is a file.", "Give the name of a folder.")
        Path(self._path(name)).mkdir(parents=True, exist_ok=True)

    def write(self, name: str, content: str | bytes) -> None:
        """Write a file in full or not at all; one of that name is replaced. Text is written as UTF-8."""
        if self.remote is None:
            atomic_write(self._path(name), content, force=True)
        else:  # an object store shows a file when it is complete
            data = content.encode("utf-8") if isinstance(content, str) else content
            with _answers(self.root, "written"):
                self.remote.pipe_file(self._path(name), data)

    def read(self, name: str) -> str | None:
        """The text of a file; None if it does not exist."""
        try:
            if self.remote is None:
                if not Path(self._path(name)).exists():
                    return None
                return read_text(self._path(name), LARGEST)
            with _answers(self.root, "read"):
                return str(self.remote.cat_file(self._path(name)).decode("utf-8"))
        except FileNotFoundError:
            return None

    def names(self, folder: str = "") -> set[str]:
        """The names in a folder; empty if it does not exist."""
        try:
            if self.remote is None:
                return {path.name for path in Path(self._path(folder)).iterdir()}
            with _answers(self.root, "listed"):
                found = self.remote.ls(self._path(folder), detail=False)
            return {posixpath.basename(path.rstrip("/")) for path in found}
        except (FileNotFoundError, NotADirectoryError):
            return set()


def _connect(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError:
        raise UsageError(
            f"'{shown(address)}' needs fsspec, which is not installed.", "Try: pip install 'camcal[cluster]'"
        ) from None
    if address.startswith(_MEMORY):
        raise UsageError(
            f"'{shown(address)}' is the memory of one process, which the workers do not share.",
            "Give a folder, or the address of a file system.",
        )
    try:
        with _answers(address, "reached"):  # some connect at once
            return fsspec.core.url_to_fs(address)
    except DataError as error:
        raise UsageError(error.message, error.hint) from None


@contextmanager
def local_copies(sources: Sequence[str]) -> Iterator[list[str]]:
    """Local paths of inputs; remote files and folders are copied while they are needed.

    Raises
    ------
    DataError
        If a remote input cannot be read.
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
                with _answers(source, "read"):
                    remote.get(path, str(target), recursive=remote.isdir(path))
            except FileNotFoundError:
                raise DataError(
                    f"{shown(source)}: there is no such file or folder.", "Check the address."
                ) from None
            paths.append(str(target))
        yield paths


def address_of(path: str, sources: Sequence[str], paths: Sequence[str]) -> str:
    """The origin of an input: the remote address if it was copied for the job, otherwise its path."""
    for source, local in zip(sources, paths, strict=True):
        if is_remote(source) and (path == local or path.startswith(f"{local}/")):
            return shown(source).rstrip("/") + path[len(local) :]
    return path
