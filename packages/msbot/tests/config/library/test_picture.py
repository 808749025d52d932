"""The picture of a part."""

from xml.etree import ElementTree

import pytest

from msbot.config import Category, PartType, Pin, PinKind, load_library
from msbot.config.library.picture import picture_fault, picture_svg

LIBRARY = load_library()


@pytest.mark.parametrize("number", LIBRARY.numbers())
def test_every_part_has_a_picture_with_its_pins(number: str) -> None:
    part_type = LIBRARY.get(number)
    assert part_type is not None
    root = ElementTree.fromstring(picture_svg(part_type))
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts == [number, *(pin.name for pin in part_type.pins[:18])]


@pytest.mark.parametrize("category", Category)
def test_odd_names_are_written_as_they_must_be(category: Category) -> None:
    part_type = PartType("<A&B>", 'say "hi" & go', category=category, pins=(Pin("<1>", PinKind.BUS),))
    root = ElementTree.fromstring(picture_svg(part_type))
    title = root.find("{http://www.w3.org/2000/svg}title")
    assert title is not None
    assert title.text == '<A&B>: say "hi" & go'


NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
OWN = [
    ("<svg/>", f"<svg {NAMESPACE} />"),
    (f"<svg {NAMESPACE}><g><text>a &lt; b</text></g></svg>", f"<svg {NAMESPACE}><g><text>a &lt; b</text></g></svg>"),
    ("<s:svg xmlns:s='http://www.w3.org/2000/svg'><s:g/></s:svg>", f"<svg {NAMESPACE}><g /></svg>"),
    ("<svg><!--><img src='x' onerror='alert(1)'/>--></svg>", f"<svg {NAMESPACE} />"),
    ("<?x ><img src='x' onerror='alert(1)'/>?><svg><g/><?y ><b>?></svg>", f"<svg {NAMESPACE}><g /></svg>"),
    ("<svg><path fill='url(#a)' d='M0 0'/></svg>", f'<svg {NAMESPACE}><path fill="url(#a)" d="M0 0" /></svg>'),
]


@pytest.mark.parametrize(("text", "shown"), OWN)
def test_a_picture_of_ones_own_is_written_anew_from_its_shapes_and_words(text: str, shown: str) -> None:
    assert picture_fault(text) is None
    assert picture_svg(PartType("A", "a", picture=text)) == shown


FAULTS = [
    ("<svg>", "is no SVG (no element found"),
    ("<html/>", "must be an SVG that begins with <svg; it begins with <html"),
    ("<svg><script>alert(1)</script></svg>", "must not have <script>"),
    ("<svg><a href='x'/></svg>", "must not have <a>"),
    ("<svg onload='alert(1)'/>", 'must not have onload="..."'),
    ("<svg><rect style='background:url(x)'/></svg>", 'must not have style="..."'),
    ("<!DOCTYPE svg [<!ENTITY a 'b'>]><svg/>", "must not declare anything"),
    ("<svg xmlns:x='http://www.w3.org/1999/xlink'><path x:href='x'/></svg>", 'must not have href="..."'),
    ("<svg xmlns:x='y'><path x:d='x'/></svg>", 'must not have d="..."'),
    ("<svg><rect fill='url(http://evil.example/a#b)'/></svg>", 'must not have fill="url(http://evil.example/a#b)"'),
    ("<svg><rect fill='URL ( //evil.example/a)'/></svg>", 'must not have fill="URL ( //evil.example/a)"'),
    ("<svg><rect fill='u\\72l(//evil.example/a)'/></svg>", "must not have fill="),
]


@pytest.mark.parametrize(("text", "sentence"), FAULTS)
def test_a_picture_that_could_do_something_is_refused(text: str, sentence: str) -> None:
    assert (picture_fault(text) or "").startswith(sentence)


@pytest.mark.parametrize("number", LIBRARY.numbers())
def test_what_is_drawn_is_such_a_picture(number: str) -> None:
    part_type = LIBRARY.get(number)
    assert part_type is not None
    assert picture_fault(picture_svg(part_type)) is None


def test_remarks_do_no_harm() -> None:
    assert picture_fault("<!-- drawn by hand --><svg><g><circle r='4'/></g></svg>") is None


HOSTILE = [
    "<script>alert(1)</script>", "</title><script>alert(1)</script>", "]]><script>x</script>", "<!--", "-->",
    "<![CDATA[", "\"'><svg onload='alert(1)'>", "&lt;script&gt;", "&#60;script&#62;", "&nbsp;", "&", "{{ 7 * 7 }}",
    "a\x00b\x07\x1bc", "\ufffe\uffff", "\ud800", "a\r\nb\tc", "\u202egnp.exe",
]  # fmt: skip
"""Names that a part could send to have them run, or to break the picture."""
SAFE = PartType("A", "a", pins=(Pin("A", PinKind.POWER),))


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_a_hostile_name_gives_a_picture_with_that_name_as_text(name: str) -> None:
    part_type = PartType(name, name, pins=(Pin(name, PinKind.POWER),))
    drawn = picture_svg(part_type)
    root = ElementTree.fromstring(drawn.encode())
    assert picture_fault(drawn) is None
    plain = ElementTree.fromstring(picture_svg(SAFE))
    elements = [(element.tag, sorted(element.attrib)) for element in root.iter()]
    assert elements == [(element.tag, sorted(element.attrib)) for element in plain.iter()], "it adds no element"
    title = root.find("{http://www.w3.org/2000/svg}title")
    assert title is not None
    if name.isprintable():
        assert title.text == f"{name}: {name}"
