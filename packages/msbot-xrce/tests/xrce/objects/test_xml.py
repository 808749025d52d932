"""The XML subset: bounded, without entities, mended where eProsima's examples are not well-formed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.objects.xml import MAX_DEPTH, MAX_ELEMENTS, MAX_OCTETS, parse_xml
from tests.damage import read_or_refused


def test_elements_attributes_and_text() -> None:
    root = parse_xml('<dds>\n  <topic profile_name="t">\n <name> T </name><name>second</name></topic></dds>')
    assert root.tag == "dds"
    topic = root.child("topic")
    assert topic is not None
    assert (topic.line, topic.attributes) == (2, {"profile_name": "t"})
    assert root.find("topic/name") == "T"
    assert root.find("topic/nothing") is None
    assert root.find("nothing/name") is None
    assert list(root.leaves()) == [("topic/name", "T"), ("topic/name", "second")]


def test_namespaces_are_cut_off() -> None:
    root = parse_xml('<dds xmlns:e="http://example"><e:topic e:profile_name="t"/></dds>')
    topic = root.child("topic")
    assert topic is not None
    assert topic.attributes == {"profile_name": "t"}


def test_predefined_entities_and_characters_are_understood() -> None:
    assert parse_xml("<a>&lt;&amp;&#65;<![CDATA[<]]></a>").text == "<&A<"


def test_attributes_without_a_blank_between_them_are_mended() -> None:
    # Sent by eProsima's own RequestAdder example.
    root = parse_xml(
        '<dds><requester profile_name="my_requester"service_name="s"request_type=\'r\'reply_type="p"/></dds>'
    )
    requester = root.child("requester")
    assert requester is not None
    assert requester.attributes == {
        "profile_name": "my_requester",
        "service_name": "s",
        "request_type": "r",
        "reply_type": "p",
    }


def test_well_formed_text_is_never_mended() -> None:
    assert parse_xml('<a b="1">x="1"y</a>').text == 'x="1"y'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "line 1: no element found"),
        ("<dds><nope", "line 1: unclosed token"),
        ("<dds>\n</nope>", "line 2: mismatched tag"),
        ('<a b="1"c="2"><b></a>', "line 1: mismatched tag"),
        ("<a>&unknown;</a>", "undefined entity"),
        ("<a/><b/>", "junk after document element"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type"),
        ('<!DOCTYPE a SYSTEM "http://example/a.dtd"><a/>', "document type"),
        ("<a>" * (MAX_DEPTH + 1) + "</a>" * (MAX_DEPTH + 1), "elements deep"),
        ("<a>" + "<b/>" * MAX_ELEMENTS + "</a>", "too many elements"),
        ("<a>" + " " * MAX_OCTETS + "</a>", "65543 bytes: 65536 at most"),
        ("<a>\0</a>", "not well-formed"),
        ("<a>\ud800</a", "XML"),
    ],
)
def test_refused(text: str, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        parse_xml(text)


def test_deepest_and_largest_that_is_taken() -> None:
    assert parse_xml("<a>" * MAX_DEPTH + "</a>" * MAX_DEPTH).tag == "a"
    assert len(parse_xml("<a>" + "<b/>" * (MAX_ELEMENTS - 1) + "</a>").children) == MAX_ELEMENTS - 1


@pytest.mark.parametrize("text", ["<a " + '="' * 20_000, "<a" * 30_000, '<a b="' + "=" * 60_000])
def test_mending_takes_no_longer_than_reading(text: str) -> None:
    with pytest.raises(RemoteProtocolError):
        parse_xml(text)


PIECES = [
    "<a>",
    "</a>",
    "<b ",
    'c="d"',
    "/>",
    "&amp;",
    "&x;",
    "<!--",
    "-->",
    "<![CDATA[",
    "]]>",
    "<?x",
    "?>",
    "<!DOCTYPE",
]


@given(st.lists(st.sampled_from(PIECES) | st.text(max_size=3), max_size=12).map("".join))
def test_any_text_is_read_or_refused(text: str) -> None:
    root = read_or_refused(lambda _: parse_xml(text), b"")
    if root is not None:
        assert f"<{root.tag}" in text
