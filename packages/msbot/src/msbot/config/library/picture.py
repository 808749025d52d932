"""A picture of a part, drawn from its category and its pins: a board with a symbol on it and its connector below."""

from __future__ import annotations

import re
from html import escape
from xml.etree import ElementTree

from msbot.config.library.part_types import Category, PartType, Pin, PinKind

WIDTH, HEIGHT = 200, 150
_PIN_WIDTH = 8
_MOST_PINS = 18
"""Most pins that fit on the edge of the board; further ones are not drawn."""
_ELEMENTS = frozenset(
    [
        "svg",
        "g",
        "defs",
        "title",
        "desc",
        "path",
        "rect",
        "circle",
        "ellipse",
        "line",
        "polyline",
        "polygon",
        "text",
        "tspan",
        "linearGradient",
        "radialGradient",
        "stop",
        "clipPath",
    ]
)
"""The elements allowed in a picture."""
_NOT_IN_XML = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")
"""Characters that no XML text may hold, not even escaped (XML 1.0, 2.2): one would break the whole picture."""
_ELSEWHERE = re.compile(r"url\s*\((?!\s*[\"']?\s*#)|\\", re.IGNORECASE)
"""A value that names something outside the picture, or hides that behind a backslash of CSS."""
_SVG = "http://www.w3.org/2000/svg"
_BOARDS = {
    Category.SENSOR: "#1f5fa8",
    Category.INPUT: "#2d6a4f",
    Category.ACTUATOR: "#9c2f2f",
    Category.DISPLAY: "#343a55",
    Category.POWER: "#8a6d1a",
    Category.BOARD: "#1b4332",
    Category.OTHER: "#555555",
}
_PINS = {
    PinKind.POWER: "#d62828",
    PinKind.GROUND: "#111111",
    PinKind.SIGNAL: "#e0a800",
    PinKind.BUS: "#2a9d8f",
    PinKind.UNUSED: "#b0b0b0",
}
_SIGNS = {
    Category.SENSOR: '<path d="M60 62 Q100 26 140 62 Q100 98 60 62Z"/><circle cx="100" cy="62" r="13" fill="#fff"/>',
    Category.INPUT: '<rect x="74" y="36" width="52" height="52" rx="8"/><circle cx="100" cy="62" r="16" fill="#fff"/>',
    Category.ACTUATOR: '<circle cx="100" cy="62" r="19"/><circle cx="100" cy="62" r="5"/>'
    '<path d="M100 35v8 M100 81v8 M73 62h8 M119 62h8 M81 43l6 6 M113 75l6 6 M119 43l-6 6 M87 75l-6 6"/>',
    Category.DISPLAY: '<rect x="52" y="36" width="96" height="52" rx="4"/><path d="M62 52h76 M62 66h54"/>',
    Category.POWER: '<rect x="60" y="44" width="72" height="38" rx="4"/><path d="M136 55v16 M78 63h18 M87 54v18"/>',
    Category.BOARD: '<rect x="72" y="38" width="56" height="48"/><path d="M60 48h12 M60 62h12 M60 76h12 M128 48h12 M128 62h12 M128 76h12"/>',  # noqa: E501 - one path
    Category.OTHER: '<rect x="66" y="40" width="68" height="44" rx="6"/>',
}


def picture_svg(part_type: PartType) -> str:
    """The picture of a part type as an SVG document: its own, or one that is drawn.

    Its own is written anew from what `picture_fault` has looked at: what XML passes over, remarks and processing
    instructions, something else could take for elements (HTML does).
    """
    if not part_type.picture:
        return "\n".join(_drawing(part_type))
    root = ElementTree.fromstring(part_type.picture)
    for element in root.iter():
        element.tag = _plain(element.tag)
    root.set("xmlns", _SVG)
    return ElementTree.tostring(root, "unicode")


def picture_fault(text: str) -> str | None:
    """Why a text cannot be the picture of a part; None when it can.

    A picture is shown on a page to people who are signed in, so it may contain only shapes and words: nothing that runs
    and nothing that is fetched from elsewhere.
    """
    if "<!" in text.replace("<!--", ""):
        return "must not declare anything with <!; leave that line out"
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        return f"is no SVG ({error}); leave it out and one is drawn"
    if _plain(root.tag) != "svg":
        return f"must be an SVG that begins with <svg; it begins with <{_plain(root.tag)}"
    for element in root.iter():
        if _plain(element.tag) not in _ELEMENTS:
            return f"must not have <{_plain(element.tag)}>: a picture is made of shapes and words"
        for name, value in element.attrib.items():
            plain = _plain(name)
            is_foreign = name != plain and not name.startswith("{http://www.w3.org/XML/1998/namespace}")
            if is_foreign or plain.startswith("on") or plain in ("href", "style"):
                return f'must not have {plain}="...": a picture is made of shapes and words'
            if _ELSEWHERE.search(value):
                return f'must not have {plain}="{value[:40]}": it may name a part of the picture only, as in url(#name)'
    return None


def _plain(name: object) -> str:
    """The name of an element or attribute without its namespace."""
    return str(name).rpartition("}")[2]


def _text(words: str) -> str:
    """Words as text of a picture, whatever is in them."""
    return escape(_NOT_IN_XML.sub("\ufffd", words), quote=False)


def _drawing(part_type: PartType) -> list[str]:
    name, number = _text(part_type.name), _text(part_type.number)
    return [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">',
        f"<title>{number}: {name}</title>",
        f'<rect x="8" y="4" width="{WIDTH - 16}" height="112" rx="9" fill="{_BOARDS[part_type.category]}"/>',
        f'<g fill="none" stroke="#fff" stroke-width="4" stroke-linecap="round">{_SIGNS[part_type.category]}</g>',
        f'<text x="{WIDTH // 2}" y="22" fill="#fff" font-family="sans-serif" font-size="13" text-anchor="middle">'
        f"{number}</text>",
        *_pins(part_type.pins[:_MOST_PINS]),
        "</svg>",
    ]


def _pins(pins: tuple[Pin, ...]) -> list[str]:
    """The pins on the lower edge, each with its name beside it."""
    if not pins:
        return []
    pitch = min(24.0, (WIDTH - 24) / len(pins))
    left = (WIDTH - pitch * (len(pins) - 1)) / 2
    size = 7 if pitch >= _PIN_WIDTH * 2 else 5
    drawn = []
    for position, pin in enumerate(pins):
        x = left + position * pitch
        drawn.append(
            f'<rect x="{x - _PIN_WIDTH / 2:.1f}" y="110" width="{_PIN_WIDTH}" height="26" rx="1" '
            f'fill="{_PINS[pin.kind]}" stroke="#888" stroke-width="0.5"/>'
            f'<text x="{x:.1f}" y="146" font-family="sans-serif" font-size="{size}" text-anchor="middle" '
            'fill="currentColor">'
            f"{_text(pin.name)}</text>"
        )
    return drawn
