"""XML elements that know their file and line, so that an error can name them."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from mmw.core.errors import InputError

MAX_DEPTH = 100
"""Elements inside elements; design value, Mitsuba's own scenes have eight."""


@dataclass
class XmlNode:
    """One element."""

    tag: str
    attributes: dict[str, str]
    where: str
    """File and line, such as `scene.xml:12`."""
    folder: Path
    """Folder of its file."""
    children: list["XmlNode"] = field(default_factory=list)
    text: str = ""
    """Text directly in it, that between its children included."""

    def get(self, name: str) -> str:
        """Return an attribute that must be there.

        Raises:
            InputError: If it is missing.
        """
        if name not in self.attributes:
            raise InputError(f"{self.where}: <{self.tag}> has no {name!r}; it is needed; add it")
        return self.attributes[name]

    def find(self, *tags: str) -> Iterator["XmlNode"]:
        """Yield the children with one of some tags, in order."""
        return (child for child in self.children if child.tag in tags)

    def below(self) -> Iterator["XmlNode"]:
        """Yield all elements below, in order."""
        for child in self.children:
            yield child
            yield from child.below()


def read_xml(path: Path) -> XmlNode:
    """Return the root element of a file.

    Raises:
        InputError: If the file is missing, empty, no well-formed XML, or nested too deeply.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give an existing XML file") from None
    parser = expat.ParserCreate()
    parser.buffer_text = True
    top = XmlNode("", {}, str(path), path.parent)
    stack = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        node = XmlNode(tag, attributes, f"{path}:{parser.CurrentLineNumber}", path.parent)
        if len(stack) > MAX_DEPTH:
            raise InputError(f"{node.where}: <{tag[:60]}> is nested more than {MAX_DEPTH} deep; flatten the file")
        stack[-1].children.append(node)
        stack.append(node)

    def add_text(text: str) -> None:
        if not text.isspace():
            stack[-1].text += text

    parser.StartElementHandler = start
    parser.CharacterDataHandler = add_text
    parser.EndElementHandler = lambda tag: stack.pop()
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f"{path}:{error.lineno}: not well-formed XML ({reason}); correct that line") from None
    return top.children[0]


def parse_xml(path: Path, tag: str, cure: str, data: bytes | None = None) -> ElementTree.Element:
    """Return the root element of a file, whose elements have no namespace.

    Args:
        path: The file.
        tag: What its root has to be.
        cure: What to do about a broken file.
        data: Its text, if that is packed in the file; read from it if None.

    Raises:
        InputError: If the file is missing, no well-formed XML, or its root has another tag.
    """
    try:
        data = path.read_bytes() if data is None else data
        root = ElementTree.fromstring(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of an existing file") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter two: encodings
        raise InputError(f"{path}: broken XML ({error}){_last_element(data or b'')}; {cure}") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != tag:
        raise InputError(f"{path}: root element <{root.tag}>; <{tag}> is needed; give such a file, or {cure}")
    return root


def _last_element(data: bytes) -> str:
    """Return which element a broken file began last, to be named in an error; nothing if there is none."""
    found: list[tuple[str, dict[str, str]]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: found.__setitem__(slice(0, 1), [(tag, attributes)])
    with suppress(expat.ExpatError, ValueError, LookupError):
        parser.Parse(data, True)
    if not found:
        return ""
    tag, attributes = found[0]
    name = next((f" {key}={attributes[key][:40]!r}" for key in ("id", "ref", "name", "k") if key in attributes), "")
    return f" in or after <{tag[:60]}{name}>"
