"""The small part of XML that clients use to describe objects: elements, attributes, text.

Bounded in size, depth and number of elements; document types, and with them custom entities, are refused. Namespaces
are stripped. A missing blank between attributes is added, because eProsima's own request/reply examples send them so
(seen on the wire).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import field
from xml.parsers import expat

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

MAX_OCTETS = 0x10000
MAX_DEPTH = 16
MAX_ELEMENTS = 2048

_TAG = re.compile(r"<[A-Za-z_][^<>]*>")
_JOINED = re.compile(r"(=\s*(?:\"[^\"]*\"|'[^']*'))(?=[A-Za-z_])")


@dataclass(slots=True)
class Element:
    """One element and its contents."""

    tag: str
    attributes: dict[str, str]
    line: int
    """Where it begins, from 1."""
    text: str = ""
    """The text directly in it, without blanks around it."""
    children: list[Element] = field(default_factory=list)

    def child(self, *tags: str) -> Element | None:
        """The first child with one of these tags, or None."""
        return next((child for child in self.children if child.tag in tags), None)

    def find(self, path: str) -> str | None:
        """The text of the element at the end of a path of first children (`qos/reliability/kind`), or None."""
        element: Element | None = self
        for tag in path.split("/"):
            element = element.child(tag) if element is not None else None
        return None if element is None else element.text

    def leaves(self, prefix: str = "") -> Iterator[tuple[str, str]]:
        """Path and text of every element below that has no children."""
        for child in self.children:
            path = f"{prefix}{child.tag}"
            if child.children:
                yield from child.leaves(f"{path}/")
            else:
                yield path, child.text


def parse_xml(text: str, *, max_octets: int = MAX_OCTETS, max_elements: int = MAX_ELEMENTS) -> Element:
    """The root element of a document.

    Raises:
        RemoteProtocolError: it is not well-formed, too large, too deep, or has a document type.
    """
    octets = text.encode("utf-8", "replace")
    if len(octets) > max_octets:
        raise RemoteProtocolError(f"XML of {len(octets)} bytes: {max_octets} at most")
    try:
        return _Builder(max_elements).parse(octets)
    except expat.ExpatError as error:
        mended = _TAG.sub(_mend, text)
        if mended == text:
            raise _not_well_formed(error) from None
    try:
        return _Builder(max_elements).parse(mended.encode("utf-8", "replace"))
    except expat.ExpatError as error:
        raise _not_well_formed(error) from None


def _mend(tag: re.Match[str]) -> str:
    return _JOINED.sub(r"\1 ", tag.group())


def _not_well_formed(error: expat.ExpatError) -> RemoteProtocolError:
    return RemoteProtocolError(f"XML, line {error.lineno}: {expat.ErrorString(error.code)}")


class _Builder:
    """Makes elements from what expat reports."""

    def __init__(self, max_elements: int) -> None:
        self._left = max_elements
        self._parser = expat.ParserCreate("UTF-8")
        self._parser.buffer_text = True
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        # The document itself, as the parent of the root.
        self._stack = [Element("", {}, 1)]

    def parse(self, octets: bytes) -> Element:
        """Read the whole document."""
        self._parser.Parse(octets, True)
        return self._stack[0].children[0]

    def _doctype(self, name: str, system: str | None, public: str | None, internal: bool) -> None:  # noqa: ARG002
        raise RemoteProtocolError("XML with a document type: not allowed")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._left -= 1
        if self._left < 0:
            raise RemoteProtocolError("XML with too many elements")
        if len(self._stack) > MAX_DEPTH:
            raise RemoteProtocolError(f"XML more than {MAX_DEPTH} elements deep")
        plain = {_local(key): value for key, value in attributes.items()}
        element = Element(_local(name), plain, self._parser.CurrentLineNumber)
        self._stack[-1].children.append(element)
        self._stack.append(element)

    def _end(self, name: str) -> None:  # noqa: ARG002 - expat has checked that it fits
        element = self._stack.pop()
        element.text = element.text.strip()

    def _characters(self, text: str) -> None:
        self._stack[-1].text += text


def _local(name: str) -> str:
    return name.rpartition(":")[2]
