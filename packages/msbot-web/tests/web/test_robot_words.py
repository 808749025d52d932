"""What blocks are made from: another robot has other parts, ports and messages; a part that is gone is told of."""

from __future__ import annotations

import pytest

from msbot.config import Library, load_library
from msbot.registry import ProgramSource
from msbot_agent.text.sentence import said
from msbot_web.models.robot_models import SlotCard, WirePort
from msbot_web.programs.programs import MAX_BLOCKS, check_program
from msbot_web.programs.robot_words import PartWords, RobotWords, robot_words
from msbot_xrce.errors import ConfigError


@pytest.fixture(scope="module")
def library() -> Library:
    return load_library()


def card(name: str, number: str, *, state: str = "empty", simulated: bool = False) -> SlotCard:
    return SlotCard(
        name=name,
        part_number=number,
        type_name="",
        description="",
        state=state,
        reason=said("nothing is plugged in"),
        part=None,
        ports=[],
        next_beat_s=None,
        simulated=simulated,
        plugged=None,
    )


def wire(slot: str, port: str, kind: str, *, publishes: bool, topic: str = "") -> WirePort:
    return WirePort(slot=slot, port=port, type_name=kind, publishes=publishes, topic=topic)


BUGGY = (
    wire("line", "line", "Line", publishes=True, topic="t"),
    wire("pilot", "line", "Line", publishes=False, topic="t"),
    wire("pilot", "left", "Level", publishes=True, topic="l"),
)


def words(library: Library, *cards: SlotCard) -> RobotWords:
    return robot_words(cards, BUGGY, library, str)


def port(part: PartWords, name: str) -> tuple[bool, bool, list[str]]:
    found = next(one for one in part["ports"] if one["name"] == name)
    return found["sends"], found["wired"], found["silent"]


def test_a_robot_has_its_parts_with_free_slots_first(library: Library) -> None:
    line = card("line", "QTR-8A", state="active", simulated=True)
    found = words(library, line, card("pilot", "PILOT"), card("strange", "NOT-KNOWN"))
    assert [one["number"] for one in found["parts"]] == ["PILOT", "QTR-8A"]
    pilot = found["parts"][0]
    assert pilot["free"]
    assert [one["name"] for one in pilot["ports"]][:2] == ["line", "left"], "those that are wired come first"
    assert port(pilot, "line") == (False, True, [])
    assert port(pilot, "left") == (True, True, [])
    assert port(pilot, "distance") == (False, False, [])


@pytest.mark.parametrize("state", ["empty", "lost", "left"])
def test_a_part_that_is_gone_is_told_of_at_the_port_it_sends_to(library: Library, state: str) -> None:
    found = words(library, card("line", "QTR-8A", state=state), card("pilot", "PILOT", state="active"))
    pilot = next(one for one in found["parts"] if one["number"] == "PILOT")
    assert port(pilot, "line") == (False, True, ["line"])


def test_messages_have_their_fields_and_units(library: Library) -> None:
    types = words(library)["types"]
    assert types["Line"]["standard"]
    assert [(one["name"], one["kind"]) for one in types["Line"]["fields"]] == [
        ("position", "float32"),
        ("seen", "bool"),
    ]
    assert types["Level"]["fields"] == [{"name": "percent", "kind": "float32", "unit": "%"}]


@pytest.mark.parametrize(
    ("blocks", "words"),
    [
        ("[]", "are a JSON object"),
        ("{", "are a JSON object"),
        ("[" * 100_000, "are a JSON object"),
        ('{"a": "' + "\ud800" + '"}', "are a JSON object"),
        ('{"a": "' + "x" * MAX_BLOCKS + '"}', "have at most 256 kB; these have 257 kB: make two programs of them"),
    ],
    ids=["a list", "cut off", "deep", "half a letter", "too large"],
)
def test_blocks_that_are_none_are_not_kept(blocks: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        check_program("x.py", ProgramSource("print(1)", blocks))


def test_a_program_without_blocks_and_one_with_them_are_kept() -> None:
    check_program("x.py", ProgramSource("print(1)"))
    check_program("x.py", ProgramSource("print(1)", '{"msbot": 1}'))
