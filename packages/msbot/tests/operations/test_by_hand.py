"""Driving a port by hand: its wire is cut meanwhile, its safe value comes afterwards, STOP goes before it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.config import FieldKind, load_library
from msbot.operations.manual_control import _value
from msbot_xrce.errors import ConfigError
from tests.operations.stage import AA_IS_A_DIAL, DIAL, Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


def test_a_person_drives_a_port_in_place_of_its_wire_and_lets_go(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert stage.parts["AA"].state.value == "active"
        done = await stage.do.publish("BB.in", ["7", "turn-on", "3"][:2], who="ann")
        assert done.words == "BB.in: index 7, message turn-on, for 5 s"
        await asyncio.sleep(1.0)
        assert stage.heard["BB"][-1] == "turn-on"
        assert stage.operations.by_hand.held_ports() == {("BB", "in"): "ann"}
        await stage.do.publish("BB.in", ["index=8", "message=again"], who="ann")
        await asyncio.sleep(0.2)
        assert stage.heard["BB"][-1] == "again"
        await stage.do.let_go("BB.in", who="ann")
        await asyncio.sleep(1.0)
        assert stage.operations.by_hand.held_ports() == {}
        stage.parts["AA"].publish("out", stage.message("from the wire"))
        await asyncio.sleep(0.3)
        assert stage.heard["BB"][-1] == "from the wire"

    play(tmp_path, scene, parts=RING)


def test_what_the_wire_says_is_not_heard_while_a_port_is_held(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.publish("BB.in", ["1", "by hand"], who="ann")
        await asyncio.sleep(1.0)
        stage.heard["BB"].clear()
        stage.parts["AA"].publish("out", stage.message("from the wire"))
        await asyncio.sleep(0.3)
        assert set(stage.heard["BB"]) <= {"by hand"}

    play(tmp_path, scene, parts=RING)


def test_when_nobody_renews_it_the_port_follows_its_wire_again(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.publish("BB.in", ["1", "by hand"], seconds=2.0, who="ann")
        await asyncio.sleep(1.5)
        assert stage.operations.by_hand.held_ports()
        await asyncio.sleep(2.0)
        assert not stage.operations.by_hand.held_ports()
        stage.parts["AA"].publish("out", stage.message("from the wire"))
        await asyncio.sleep(0.3)
        assert stage.heard["BB"][-1] == "from the wire"

    play(tmp_path, scene, parts=RING)


def test_stop_ends_it_and_nothing_is_driven_until_go(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.publish("BB.in", ["1", "by hand"], who="ann")
        await asyncio.sleep(0.7)  # between two repetitions
        await stage.do.stop(who="bob")
        assert stage.operations.by_hand.held_ports() == {}
        stage.heard["BB"].clear()
        await asyncio.sleep(2.0)
        assert "by hand" not in stage.heard["BB"]
        said = await stage.refusal(stage.do.publish("BB.in", ["1", "by hand"], who="ann"))
        assert said == "STOP is in force: BB.in stays in its safe state until GO"

    play(tmp_path, scene, parts=RING)


def test_a_part_that_takes_over_the_slot_is_driven_as_well(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.plug("DD", "EFGH")
        await asyncio.sleep(1.0)
        await stage.do.publish("BB.in", ["1", "by hand"], seconds=60.0, who="ann")
        await asyncio.sleep(0.5)
        stage.pull("BB")
        await asyncio.sleep(8.0)
        assert stage.slot("DD") == "BB"
        assert stage.heard["DD"][-1:] == ["by hand"]

    play(tmp_path, scene, parts=RING)


MISTAKES = {
    ("BB.in", ("1",)): "BB.in needs a value for message; it takes index (uint32), message (text)",
    ("BB.in", ("x", "y")): "BB.in: index must be a whole number, not 'x'",
    ("BB.in", ("-1", "y")): "BB.in: index must be a whole number from 0 to 4294967295",
    ("BB.in", ("1", "2", "3")): "BB.in takes 2 values, not 3: index (uint32), message (text)",
    ("BB.out", ("1", "y")): "BB.out is not a port that can be driven; those of EFGH: BB.in",
    ("BB", ("1", "y")): "'BB' is not a port: write SLOT.port, for example AA.out",
}


@pytest.mark.parametrize(("wish", "words"), MISTAKES.items())
def test_mistakes_are_told_with_what_would_be_right(
    wish: tuple[str, tuple[str, ...]], words: str, tmp_path: Path
) -> None:
    async def scene(stage: Stage) -> None:
        port, values = wish
        said = await stage.refusal(stage.do.publish(port, list(values), who="ann"))
        assert said.startswith(words)
        assert stage.operations.by_hand.held_ports() == {}

    play(tmp_path, scene, parts=RING)


@pytest.mark.parametrize("text", ["nan", "inf", "-Infinity"])
def test_what_is_no_number_drives_nothing(text: str) -> None:
    with pytest.raises(ConfigError, match=f"fan.power: percent must be a number, not '{text}'"):
        _value("fan.power", "percent", FieldKind.FLOAT32, text)


def test_an_empty_slot_cannot_be_driven(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        said = await stage.refusal(stage.do.publish("CC.in", ["1", "y"], who="ann"))
        assert said == "slot CC has no part now: there is nothing to drive"
        assert await stage.refusal(stage.do.let_go("BB.in", who="ann")) == "nobody drives BB.in by hand"

    play(tmp_path, scene, parts=RING[:2])


def test_it_is_journalled_once_for_each_time_somebody_takes_a_port(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        for number in range(5):
            await stage.do.publish("BB.in", [str(number), "y"], who="ann")
            await asyncio.sleep(0.1)
        await stage.do.let_go("BB.in", who="ann")
        await asyncio.sleep(1.0)
        edits = (await stage.do.edits(20, who="ann")).answer["edits"]
        assert isinstance(edits, list)
        assert [edit["words"] for edit in edits if edit["kind"] == "hand"] == [
            "BB.in is no longer driven by hand",
            "ann drives BB.in by hand",
        ]

    play(tmp_path, scene, parts=RING)


@pytest.mark.promise("A value outside the range that a port declares is refused, whoever sends it by hand")
def test_a_value_outside_the_declared_range_is_refused_in_one_sentence(tmp_path: Path) -> None:
    port = 'direction = "subscribe"\ntype = "HelloWorld"\n'

    async def scene(stage: Stage) -> None:
        for value in ("1", "10"):
            with pytest.raises(ConfigError, match=rf"^AA.in: index must be from 2 to 9; it is {value}$"):
                await stage.do.publish("AA.in", [value, "x"], who="ann")
        assert stage.operations.by_hand.held_ports() == {}
        for value in ("2", "9"):
            await stage.do.publish("AA.in", [value, "x"], who="ann")

    assert DIAL.count(port) == 1
    dial = DIAL.replace(port, f"{port}ranges = {{ index = [2, 9] }}\n")
    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",), dial=dial)


def test_the_ports_that_msbot_brings_have_ranges() -> None:
    found = load_library()
    assert found.get("FAN-5V").port("power").ranges == {"percent": (0.0, 100.0)}  # type: ignore[union-attr]
    assert found.get("L298N").port("left").ranges == {"percent": (-100.0, 100.0)}  # type: ignore[union-attr]
