"""A file to be read, parsed at most once, by parsers that execute and expand nothing.

YAML by the safe loader without nested aliases, XML without entities of its own, JSON, TOML, MATLAB files by
scipy; all with limits on size and depth.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from camcal.errors import DataError
from camcal.system.documents import DEEPEST, LARGEST, broken, parse_json, parse_toml, parse_yaml
from camcal.system.reading import read_file

if TYPE_CHECKING:  # most runs read no XML
    from xml.etree import ElementTree

KINDS = {
    **dict.fromkeys((".yaml", ".yml"), "yaml"),
    **dict.fromkeys((".json", ".sfm"), "json"),
    **dict.fromkeys((".xml", ".lcp", ".xmp", ".xcp", ".qca"), "xml"),
    ".toml": "toml",
}

#: bytes by whose controls a text is told from binary data: any binary header has a zero among them
HEAD = 4096


class Source:
    """A file by its path, and its contents.

    Attributes
    ----------
    path : Path
    data : bytes
    suffix : str
        Of the file's name, in lower case.
    image_size : (width, height) or None
        What the command line says, for formats whose lengths are parts of the image.
    """

    def __init__(self, path: Path, data: bytes | None = None, image_size: tuple[int, int] | None = None):
        self.path, self.suffix, self.image_size = path, path.suffix.lower(), image_size
        self.data = read_file(path, LARGEST, "a camera file") if data is None else data
        #: content that belongs beside the file, by name, where it is not on the disk yet
        self.beside: Mapping[str, str | bytes] = {}

    def neighbour(self, name: str) -> Source | None:
        """The file of that name in the same folder, or None."""
        path = self.path.with_name(name)
        if name in self.beside:
            content = self.beside[name]
            return Source(path, content.encode() if isinstance(content, str) else content)
        return Source(path) if path.is_file() else None

    @cached_property
    def text(self) -> str | None:
        """The text, or None for a binary file."""
        if b"\0" in self.data[:HEAD]:
            return None
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            # files of old Windows programs; Latin-1 reads any byte, so control characters decide
            return self.data.decode("latin-1") if not _has_controls(self.data[:HEAD]) else None

    @cached_property
    def kind(self) -> str:
        """yaml, json, xml, toml, mat, hdf5, text or binary, from the content and the suffix."""
        if self.data[:8] == b"\x89HDF\r\n\x1a\n" or self.data[512:520] == b"\x89HDF\r\n\x1a\n":
            return "hdf5"
        if self.data[:6] == b"MATLAB" or (self.suffix == ".mat" and self.text is None):
            return "mat"
        if self.text is None:
            return "binary"
        start = self.text.lstrip()[:6]
        if start[:1] == "<":
            return "xml"
        if start[:5] == "%YAML":
            return "yaml"
        if start[:1] == "{" and self.suffix not in (".cameramodel", ".toml"):
            return "json"
        return KINDS.get(self.suffix, "text")

    @cached_property
    def tree(self) -> Any:
        """The parsed content of YAML, JSON and TOML; None for any other kind.

        Raises
        ------
        DataError
            If the content is not what its kind says.
        """
        parser = {"yaml": parse_yaml, "json": parse_json, "toml": parse_toml}.get(self.kind)
        return None if parser is None else parser(self.text or "", self.path)

    @property
    def mapping(self) -> dict[str, Any]:
        """The content if it is a mapping, otherwise an empty one."""
        return self.tree if isinstance(self.tree, dict) else {}

    @cached_property
    def xml(self) -> ElementTree.Element | None:
        """The root element of XML; None for any other kind."""
        return _xml(self.data, self.path) if self.kind == "xml" else None

    @property
    def root(self) -> ElementTree.Element:
        """The root element; DataError if the file is not XML."""
        if self.xml is None:
            raise DataError(f"'{self.path}' is not an XML file.", "Is it the right file?")
        return self.xml

    @cached_property
    def mat(self) -> dict[str, Any]:
        """The variables of a MATLAB file; empty for any other kind.

        MATLAB's objects are `None` here: they hold the program's own classes.
        """
        if self.kind not in ("mat", "hdf5"):
            return {}
        from camcal.data.formats.matfile import variables

        return variables(self.data, self.path, self.kind)


def _has_controls(data: bytes) -> bool:
    return any(b < 32 and b not in b"\t\n\r\f" for b in data)


def _xml(data: bytes, path: Path) -> ElementTree.Element:
    """Parse XML with expat; internal entities are rejected, external ones are never fetched."""
    from xml.etree import ElementTree
    from xml.parsers import expat

    builder, depth = ElementTree.TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise broken(path, "XML", f"nested more than {DEEPEST} deep")
        builder.start(tag.rpartition("}")[2], {k.rpartition("}")[2]: v for k, v in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag.rpartition("}")[2])

    def entity(*_: Any) -> None:
        raise broken(path, "XML", "it defines entities")

    parser = expat.ParserCreate(namespace_separator="}")
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
    parser.buffer_text = True
    try:
        parser.Parse(data.lstrip(), True)
        return builder.close()
    except expat.ExpatError as error:
        raise broken(path, "XML", f"{expat.errors.messages[error.code]} at line {error.lineno}") from None
    except (AssertionError, ValueError, LookupError) as error:
        raise broken(path, "XML", error or "it has no elements") from None
