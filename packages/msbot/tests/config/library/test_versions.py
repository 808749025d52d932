"""Versions behind part numbers, and the ranges a library entry is for."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import Library, PartType
from msbot.config.library.versions import ANY_VERSION, VersionRange, parse_version, parse_versions, split_number
from msbot_xrce.errors import ConfigError

IN_RANGE = [
    (">=1.0, <2", "1", True),
    (">=1.0, <2", "1.9.9", True),
    (">=1.0, <2", "2.0", False),
    (">=1.0, <2", "0.9", False),
    ("==1.2", "1.2.0", True),
    ("!=1.2", "1.2", False),
    (">1.2", "1.2.1", True),
    ("<=1.2", "1.2.1", False),
    (">=10", "9", False),
    (">=1", "one", False),
    ("", "anything", True),
]


@pytest.mark.parametrize(("text", "version", "inside"), IN_RANGE)
def test_a_version_is_in_a_range_or_not(text: str, version: str, inside: bool) -> None:
    versions = parse_versions(text)
    assert versions is not None
    assert (version in versions) is inside


@pytest.mark.parametrize("text", ["1.0", ">=", "=> 1", ">=1.a", "~1", ">=1 <2"])
def test_what_is_no_range(text: str) -> None:
    assert parse_versions(text) is None


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from([">=", "<=", "==", "!=", "<", ">"]), st.tuples(st.integers(0, 999999)))))
def test_a_range_reads_back_as_it_is_written(rules: list[tuple[str, tuple[int, ...]]]) -> None:
    versions = VersionRange(tuple(rules))
    assert parse_versions(str(versions)) == versions


def test_numbers_and_versions_are_told_apart() -> None:
    assert split_number("SG90@2.1") == ("SG90", "2.1")
    assert split_number("SG90") == ("SG90", "")
    assert parse_version("1.20.3") == (1, 20, 3)
    assert parse_version("1.") is None
    assert 5 not in VersionRange(((">=", (1,)),))


def test_the_library_finds_the_entry_for_a_version() -> None:
    library = Library(
        [
            PartType("A", "any", versions=ANY_VERSION),
            PartType("B", "new ones", versions=VersionRange(((">=", (2,)),))),
            PartType("B@9", "exactly this one"),
        ]
    )
    assert [entry and entry.name for entry in map(library.find, ("A", "A@1", "B@2.5", "B@9", "B"))] == [
        "any",
        "any",
        "new ones",
        "exactly this one",
        "new ones",
    ]
    assert library.find("B@1") is None
    assert library.find("A@") is None
    with pytest.raises(ConfigError, match=r"part B is known, but not in version '1'; known: >=2"):
        library.require("B@1")
    with pytest.raises(ConfigError, match='known: "A", "B", "B@9"'):
        library.require("Zebra")
