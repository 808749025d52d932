"""What tests of drawings share: names that would do harm as HTML, and a strict reader."""

from __future__ import annotations

from xml.etree import ElementTree

from hypothesis import strategies as st

HARMFUL = "<img src=x onerror=alert(1)>\"'&amp;</svg>"

names = st.one_of(
    st.just(HARMFUL), st.text(st.characters(exclude_categories=["Cc", "Cs"], exclude_characters="￾￿"), max_size=30)
)
"""Any printable text; XML has no control characters, and neither have names from the bus."""
scalars = st.one_of(
    st.booleans(), st.integers(-(10**12), 10**12), st.floats(allow_nan=False, allow_infinity=False), names
)


def read(drawing: str) -> ElementTree.Element:
    """The drawing as a tree; fails unless it is well-formed, and when a name has become an element."""
    root = ElementTree.fromstring(f"<div>{drawing}</div>")
    found = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert not found & {"img", "script", "iframe"}
    for element in root.iter():
        assert not any(name.startswith("on") for name in element.attrib)
    return root


def words(root: ElementTree.Element) -> str:
    """All text of a drawing."""
    return "".join(root.itertext())
