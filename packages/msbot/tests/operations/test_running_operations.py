"""Settings, wires, blocks, blueprints and undo, on a robot that runs."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Awaitable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from msbot.config import (
    Library,
    PartType,
    Slot,
    blueprint_toml,
    differences,
    load_blueprint,
    load_library,
    write_sample,
)
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations, perform
from msbot.operations.operation import Outcome
from msbot.pnp import Claim, MemoryStore
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError
from tests.operations.stage import AA_IS_A_DIAL, Deeds, Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")


def test_a_setting_reaches_its_part_at_once_and_its_origin_is_shown(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        (value,) = [value for value in await stage.operations.settings.read("AA") if value.name == "period_s"]
        before = value.origin
        done = await stage.do.set("aa", "period_s", "0.5", who="ann")
        await asyncio.sleep(0.1)
        assert stage.parts["AA"].settings["period_s"] == "0.5"
        (value,) = [value for value in await stage.operations.settings.read("AA") if value.name == "period_s"]
        assert (value.value, value.origin, value.who) == (0.5, "hand", "ann")
        await stage.do.reset("AA", "period_s", who="ann")
        await asyncio.sleep(0.1)
        (value,) = [value for value in await stage.operations.settings.read("AA") if value.name == "period_s"]
        assert value.origin == before
        assert "is not set by hand" in await stage.refusal(stage.do.reset("AA", "period_s", who="ann"))
        assert "has been changed since" in await stage.refusal(stage.do.undo(done.edit_id, who="bob"))
        await stage.do.undo(who="bob")
        await asyncio.sleep(0.1)
        assert stage.parts["AA"].settings["period_s"] == "0.5"

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH", "CC=WXYZ"))


@pytest.mark.parametrize(
    ("slot", "name", "value", "words"),
    [
        ("AA", "perod_s", "1", "slot AA has no parameter 'perod_s'; did you mean period_s?"),
        ("AA", "period_s", "soon", "period_s: must be a number"),
        ("AA", "period_s", "-1", "it must be"),
        ("XX", "period_s", "1", "the robot has no slot 'XX'"),
    ],
)
def test_a_setting_that_makes_no_sense_changes_nothing(
    slot: str, name: str, value: str, words: str, tmp_path: Path
) -> None:
    async def scene(stage: Stage) -> None:
        assert words in await stage.refusal(stage.do.set(slot, name, value, who="ann"))
        assert await stage.operations.undoing.read(50) == []

    play(tmp_path, scene, AA_IS_A_DIAL)


WITH_A_BOARD = ('[[slot]]\nname = "AA"', '[[slot]]\nname = "board"\npart = "BOARD-8"\n\n[[slot]]\nname = "AA"')


def test_what_is_wired_to_a_board_reaches_it_at_once_and_mistakes_do_not(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.set("board", "part_2", "HC-SR04 eye: trigger=5, echo=18", who="ann")
        await asyncio.sleep(0.1)
        settings = stage.parts["board"].settings
        document = json.loads(settings[".part.1"])
        assert (document["number"], document["name"]) == ("HC-SR04", "eye")
        assert document["pins"] == {"trigger": 5, "echo": 18}
        assert [name for name in settings if "part" in name] == [".part.1"]
        taken = stage.do.set("board", "part_1", "LED lamp: s=18", who="ann")
        assert await stage.refusal(taken) == "part_1: pin 18 is taken by part_2; wire one of them elsewhere"
        unknown = stage.do.set("board", "part_1", "LED lamp: x=18", who="ann")
        assert 'part LED has no wire or option "x"' in await stage.refusal(unknown)
        await stage.do.undo(who="ann")
        await asyncio.sleep(0.1)
        assert ".part.1" not in stage.parts["board"].settings

    play(tmp_path, scene, WITH_A_BOARD, parts=("board=BOARD-8", "AA=ABCD", "BB=EFGH", "CC=WXYZ"))


def test_a_blocked_part_is_put_out_at_once_and_comes_back_by_itself(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.do.block("BB", "smells of smoke", who="ann")
        assert done.words == "BB (UID 42422e2e2e2e2e2e) is blocked: smells of smoke"
        assert stage.state("BB") == "refused"
        await asyncio.sleep(0.2)
        assert stage.parts["BB"].state.value != "active"
        assert "cannot be let in: blocked: smells of smoke: `msbot unblock" in await stage.refusal(
            stage.do.adopt("BB", "BB", who="ann")
        )
        await stage.do.unblock("BB", who="ann")
        await asyncio.sleep(3.0)
        assert stage.slot("BB") == "BB"
        assert await stage.refusal(stage.do.unblock("BB", who="ann")) == ("BB (UID 42422e2e2e2e2e2e) is not blocked")

    play(tmp_path, scene, parts=RING)


def test_a_blocked_number_and_its_undo(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert (await stage.do.block("EFGH", "recalled", who="ann")).words == "part number EFGH is blocked: recalled"
        assert (stage.state("BB"), stage.state("AA")) == ("refused", "active")
        await stage.do.undo(who="ann")
        await asyncio.sleep(3.0)
        assert stage.slot("BB") == "BB"
        assert "no part is known as 'XX'" in await stage.refusal(stage.do.block("XX", "", who="ann"))
        await stage.do.block("0102030405060708", "", who="ann")  # one that was never here
        stage.plug("EE", "EFGH", uid=0x0102030405060708)
        await asyncio.sleep(1.0)
        assert stage.info("EE").reason == "blocked: no reason given"

    play(tmp_path, scene, parts=RING)


def test_a_part_can_be_ignored(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        info = stage.info("XX")
        assert not stage.operations.showing.is_ignored(info)
        assert (await stage.do.ignore("XX", who="ann")).words == "XX is no longer shown among the arrivals"
        assert stage.operations.showing.is_ignored(stage.info("XX"))

    play(tmp_path, scene, parts=("XX=NOPE",))


def test_a_wire_is_taken_away_and_made_again_while_the_parts_run(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        topic = "HelloWorldTopic_1_to_2"
        done = await stage.do.unbind(topic, "BB.in", who="ann")
        assert done.words == f"BB.in is taken off topic {topic}"
        await asyncio.sleep(0.2)
        assert not stage.parts["BB"].bound("in")
        assert stage.parts["AA"].bound("out")
        await stage.do.bind(topic, "HelloWorld", None, ["BB.in"], who="ann")
        await asyncio.sleep(0.2)
        assert stage.parts["BB"].bound("in")
        await stage.do.undo(who="ann")
        await stage.do.undo(done.edit_id, who="ann")
        await asyncio.sleep(0.2)
        assert stage.parts["BB"].bound("in")
        assert "no port is bound to topic 'nothing'" in await stage.refusal(stage.do.unbind("nothing", who="ann"))
        assert "'BB' is not a port" in await stage.refusal(stage.do.unbind(topic, "BB", who="ann"))

    play(tmp_path, scene, parts=RING)


def test_moving_a_wire_is_one_change(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        first, second, third = (f"HelloWorldTopic_{way}" for way in ("1_to_2", "2_to_3", "3_to_1"))
        (robot,) = stage.registry.robots.all()

        def ends() -> dict[str, list[str]]:
            return {
                one.topic: [str(end) for end in one.ends] for one in stage.registry.robots.blueprint(robot).bindings
            }

        before = ends()
        assert '"CC.in" is bound to' in await stage.refusal(stage.do.bind(first, "HelloWorld", to=["CC.in"], who="ann"))
        done = await stage.do.bind(first, "HelloWorld", to=["CC.in"], move=True, who="ann")
        assert done.words == f"topic {first} joins CC.in"
        assert ends() == {first: ["AA.out", "BB.in", "CC.in"], second: ["BB.out"], third: ["CC.out", "AA.in"]}
        await asyncio.sleep(1.0)
        heard = len(stage.heard["CC"])
        stage.parts["AA"].publish("out", stage.message("for both"))
        await asyncio.sleep(0.5)
        assert stage.heard["CC"][heard:] == ["for both"]
        await stage.do.undo(who="bob")
        assert ends() == before
        # A wire of its own is moved by its name, too; what does not fit changes nothing.
        assert "carries" in await stage.refusal(stage.do.bind(first, "Level", to=["AA.in"], move=True, who="ann"))
        assert ends()[third] == ["CC.out", "AA.in"]

    play(tmp_path, scene, parts=RING)


def test_a_slot_is_made_and_taken_out_and_both_are_undone(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        registry = stage.registry
        (robot,) = registry.robots.all()

        def topics() -> dict[str, list[str]]:
            blueprint = registry.robots.blueprint(robot)
            return {one.topic: [str(end) for end in one.ends] for one in blueprint.bindings}

        before = topics()
        done = await stage.do.add_slot("EE", "EFGH", "One more", who="ann")
        assert done.words == "slot EE is made, for EFGH"
        assert registry.robots.slot_names(robot) == ["AA", "BB", "CC", "EE"]
        assert "there is a slot EE already" in await stage.refusal(stage.do.add_slot("EE", "EFGH", who="ann"))
        assert "NOPE" in await stage.refusal(stage.do.add_slot("FF", "NOPE", who="ann"))
        done = await stage.do.remove_slot("BB", who="ann")
        assert done.words == "slot BB is taken out"
        assert registry.robots.slot_names(robot) == ["AA", "CC", "EE"]
        assert not [end for ends in topics().values() for end in ends if end.startswith("BB.")]
        assert "no slot 'BB'" in await stage.refusal(stage.do.remove_slot("BB", who="ann"))
        assert [edit.who for edit in registry.edits.latest(robot, 2)] == ["ann", "ann"]
        await stage.do.undo(who="bob")
        assert topics() == before
        await stage.do.undo(who="bob")
        assert registry.robots.slot_names(robot) == ["AA", "BB", "CC"]

    play(tmp_path, scene, parts=RING)


def test_a_changed_blueprint_is_put_into_force_and_undone(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        path = tmp_path / "robot.toml"
        library = load_library(tmp_path / "library")
        assert (
            await stage.operations.applying.put_in_force(load_blueprint(path, library), who="ann")
        ).words == "the blueprint changes nothing"
        text = path.read_text()
        path.write_text(
            text.replace('preset = "thesis"', 'preset = "fast"')
            .replace('part = "WXYZ"', 'part = "EFGH"')
            .replace('local_name = "WXYZ-local"', "")
        )
        done = await stage.operations.applying.put_in_force(load_blueprint(path, library), who="ann")
        assert "the blueprint of MSBOT_MASTER is applied" in done.words
        assert done.words.endswith("timing and options hold from the master's next start on")
        await asyncio.sleep(3.0)
        assert stage.slot("DD") == "CC"
        await stage.do.undo(who="bob")
        await asyncio.sleep(0.5)
        path.write_text(text.replace("X100Y100Z100", "OTHER"))
        other = load_blueprint(path, library)
        assert "this is the blueprint of MSBOT_MASTER OTHER, and the robot that runs is MSBOT_MASTER X100" in (
            await stage.refusal(stage.operations.applying.put_in_force(other, who="ann"))
        )

    play(tmp_path, scene, parts=("AA=ABCD", "BB=EFGH", "DD=EFGH"))


def test_a_slot_made_by_hand_stays_when_the_blueprint_is_applied_again(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        registry = stage.registry
        (robot,) = registry.robots.all()
        library = load_library(tmp_path / "library")
        file = load_blueprint(tmp_path / "robot.toml", library)
        await stage.do.add_slot("EE", "EFGH", "One more", who="ann")
        await stage.do.bind("more", "HelloWorld", "EE.out", who="ann")
        again = await stage.operations.applying.put_in_force(file, who="ann")
        assert again.words == "the blueprint changes nothing"
        assert registry.robots.slot_names(robot) == ["AA", "BB", "CC", "EE"]
        exported = registry.robots.blueprint(robot)
        assert str(exported.bindings[-1].source) == "EE.out"
        assert '[[slot]]  # made by hand\nname = "EE"' in blueprint_toml(exported, registry.robots.made_by_hand(robot))
        assert [str(one) for one in differences(registry.robots.blueprint(robot, by_hand=False), exported)] == [
            "+ slot EE: part EFGH",
            "+ topic more: EE.out -> nobody [HelloWorld]",
        ]
        await stage.do.remove_slot("EE", who="ann")
        await stage.operations.applying.put_in_force(file, who="ann")
        assert registry.robots.slot_names(robot) == ["AA", "BB", "CC"]
        # One that the file has by now is the file's.
        await stage.do.undo(who="ann")
        with_slot = replace(file, slots=(*file.slots, Slot("EE", "EFGH")))
        await stage.operations.applying.put_in_force(with_slot, who="ann")
        await stage.operations.applying.put_in_force(file, who="ann")
        assert registry.robots.slot_names(robot) == ["AA", "BB", "CC"]

    play(tmp_path, scene, parts=RING)


def test_a_part_type_written_while_the_robot_runs_holds_once_the_blueprint_is_applied(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        told: list[Library] = []
        stage.operations.on_library(told.append)
        assert stage.state("GLOW") == "refused"
        (tmp_path / "library" / "glow.toml").write_text('number = "GLOW-7"\nname = "Glow lamp"\n')
        path, folder = str(tmp_path / "robot.toml"), str(tmp_path / "library")
        done = await stage.do.apply(path, [folder], who="ann")
        assert done.words == "part types that hold from now on: GLOW-7"
        assert [library.get("GLOW-7") is not None for library in told] == [True]
        await asyncio.sleep(3.0)
        await stage.do.add_slot("EE", "GLOW-7", "", who="ann")
        await asyncio.sleep(3.0)
        assert stage.slot("GLOW") == "EE"
        assert (await stage.do.apply(path, [folder], who="ann")).words == "the blueprint changes nothing"

    play(tmp_path, scene, parts=("GLOW=GLOW-7",))


def test_a_slot_that_the_blueprint_drops_puts_its_part_out(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        path = tmp_path / "robot.toml"
        path.write_text(path.read_text().partition("[[slot]]")[0] + '[[slot]]\nname = "AA"\npart = "ABCD"\n')
        await stage.operations.applying.put_in_force(load_blueprint(path, load_library()), who="ann")
        await asyncio.sleep(0.5)
        assert (stage.slot("AA"), stage.slot("BB"), stage.slot("CC")) == ("AA", None, None)
        await stage.do.undo(who="ann")
        await asyncio.sleep(3.0)
        assert [stage.slot(name) for name in ("AA", "BB", "CC")] == ["AA", "BB", "CC"]

    play(tmp_path, scene, parts=RING)


def test_undo_says_what_is_in_the_way(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        assert await stage.refusal(stage.do.undo(who="ann")) == "there is nothing to undo"
        assert "there is no change 99 of this robot" in await stage.refusal(stage.do.undo(99, who="ann"))
        done = await stage.do.block("BB", "", who="ann")
        await stage.do.undo(done.edit_id, who="ann")
        assert "is undone already" in await stage.refusal(stage.do.undo(done.edit_id, who="ann"))
        await asyncio.sleep(0)

    play(tmp_path, scene, parts=RING)


def _lines(outcome: Outcome) -> list[str]:
    lines = outcome.answer["lines"]
    assert isinstance(lines, list)
    return lines


def test_without_a_database_parts_can_be_moved_and_what_is_to_last_cannot_be_changed(tmp_path: Path) -> None:
    write_sample(tmp_path / "robot.toml")
    library = load_library()
    blueprint = load_blueprint(tmp_path / "robot.toml", library)

    async def main() -> None:
        store = MemoryStore(
            types=tuple(PartType(part.number, part.name) for part in library),
            slots=tuple(Slot(slot.name, slot.part_number) for slot in blueprint.slots),
        )
        master = Master(blueprint, store, random=Random(1))
        operations = InProcessOperations(master)
        do = Deeds(operations)
        for key, uid in ((1, b"EFGH-one"), (2, b"EFGH-two")):
            master.inventory.client_joined(key, f"peer {key}", 0.0)
            master.inventory.claim(Claim("EFGH", f"part {key}", uid), key, 0.0)
        words = "part 2 takes slot BB in place of part 1, which stands by"
        assert await do.swap("BB", "part 2", who="ann") == Outcome(words)
        assert (await do.release("BB", who="ann")).edit_id is None
        deeds: tuple[Awaitable[object], ...] = (
            do.set("AA", "x", "1", who="ann"),
            do.block("EFGH", "", who="ann"),
            do.undo(who="ann"),
            operations.applying.put_in_force(blueprint, who="ann"),
            operations.undoing.read(50),
        )
        for deed in deeds:
            with pytest.raises(ConfigError, match="this robot runs without a database"):
                await deed
        assert _lines(await do.why("part 2", who="ann"))[0].startswith("part 2 (EFGH) is standby")
        assert _lines(await do.why("nobody", who="ann")) == []

    run_virtual(main())


def test_a_database_that_cannot_be_written_changes_nothing_and_says_so(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await asyncio.to_thread(stage.registry.storage.flush)
        with closing(sqlite3.connect(tmp_path / "robot.db", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            for deed in (
                stage.do.swap("BB", "DD", who="ann"),
                stage.do.release("BB", who="ann"),
                stage.do.block("BB", "", who="ann"),
            ):
                assert "locked by another program" in await stage.refusal(deed)
            asked = await perform(stage.operations, {"do": "block", "args": {"part": "BB", "reason": ""}, "who": "ann"})
            assert "locked by another program" in str(asked["error"])
            assert asked["again"] is True, "another process may try it again"
            assert (stage.slot("BB"), stage.state("DD")) == ("BB", "standby")
        await stage.do.swap("BB", "DD", who="ann")
        assert stage.slot("DD") == "BB"

    play(tmp_path, scene, parts=("BB=EFGH", "DD=EFGH"), busy_timeout_s=0.05)


def test_a_spare_takes_over_while_the_database_cannot_be_written(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await asyncio.to_thread(stage.registry.storage.flush)
        with closing(sqlite3.connect(tmp_path / "robot.db", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            stage.pull("BB")
            await asyncio.sleep(1.0)
            assert stage.slot("DD") == "BB"
            assert stage.parts["DD"].slot == "BB"

    play(tmp_path, scene, parts=("BB=EFGH", "DD=EFGH"), busy_timeout_s=0.05)
