"""A part whose message class differs from the library's type: who is told, what, and how often."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner

from msbot.cli.change.robot_access import master_details
from msbot.cli.database_commands import why_command
from msbot.part import Message, Part
from msbot.part.join import pnp_messages
from msbot.part.join.pnp_messages import NoticeKind
from msbot.part.messages.type_hash import fields_text, type_hash
from msbot.part.messages.wire_types import uint16, uint32
from msbot.pnp.type_agreement import MOST_NOTES
from tests.operations.stage import Stage, play
from tests.part.messages.test_type_hash import PROMISE
from tests.pnp.test_requests import KEY, Counter

OURS = [("index", "uint32"), ("message", "text")]
THEIRS = [("index", "uint16"), ("message", "text")]


class Narrow(Message):
    type_name = "HelloWorld"
    index: uint16
    message: str


class Shorter(Message):
    type_name = "HelloWorld"
    index: uint32


def run_part(stage: Stage, kind: type[Message]) -> Part:
    part = Part("EFGH", local_name="odd", uid=b"odd-part", random=Random(5))
    part.on("in", kind)(lambda _: None)

    @part.every(0.5)
    def say() -> None:
        part.publish("out", kind())

    assert stage.tasks is not None
    stage.tasks.create_task(part.run_async(stage.connect(), epoch_ns=lambda: 0))
    return part


@pytest.mark.promise(PROMISE)
def test_everybody_is_told_both_hashes_and_the_first_field_that_differs(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    theirs, ours = type_hash("HelloWorld", THEIRS).hex(), type_hash("HelloWorld", OURS).hex()

    async def scene(stage: Stage) -> None:
        part = run_part(stage, Narrow)
        await asyncio.sleep(3.0)
        told = stage.master.why("odd")
        for port in ("in", "out"):
            (line,) = [one for one in told if one.startswith(f"port {port}: ")]
            assert f"RIHS01_{theirs}" in line
            assert f"RIHS01_{ours}" in line
            assert "field 1 is uint16 index there, and uint32 index in the library" in line
        assert master_details(stage.master, "robot.db")["type_differences"].startswith("BB port ")
        assert not stage.master.troubles("AA")
        part.end()
        await asyncio.sleep(1.0)

    play(tmp_path, scene, parts=("AA=ABCD",))
    asked = ["odd", "--db", str(tmp_path / "robot.db"), "--last", "9", "--json"]
    history = json.loads(CliRunner().invoke(why_command, asked, catch_exceptions=False).stdout)["history"]
    assert len([one for one in history if "is not that of the library" in one["reason"]]) == 2
    lines = [one.getMessage() for one in caplog.records if "is not that of the robot's library" in one.getMessage()]
    assert len(lines) == 2
    assert all("number 1, here uint16 index" in line and "`msbot why BB` shows both" in line for line in lines)


def test_a_field_too_few_is_told_as_missing(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part = run_part(stage, Shorter)
        await asyncio.sleep(3.0)
        told = [one for one in stage.master.troubles("odd") if one.startswith("port in: ")]
        assert len(told) == 1
        assert told[0].endswith("field 2 is missing there, and text message in the library")
        part.end()
        await asyncio.sleep(1.0)

    play(tmp_path, scene)


def counter_with_library() -> tuple[Counter, int]:
    counter = Counter()
    counter.rig.inventory.types.library_fields = {"HelloWorld": OURS}.get
    return counter, counter.register().lease


def say(counter: Counter, message: pnp_messages.Request) -> object:
    return counter.requests.answer(message, KEY, counter.rig.now)


def hash_message(lease: int, octets: bytes, binding: int = 0) -> pnp_messages.TypeMessage:
    return pnp_messages.TypeMessage(lease=lease, binding=binding, hash=octets)


def test_who_agrees_and_whoever_says_nothing_is_left_alone() -> None:
    counter, lease = counter_with_library()
    assert say(counter, hash_message(lease, type_hash("HelloWorld", OURS))) is None
    assert counter.rig.inventory.type_differences(KEY) == []
    assert say(counter, hash_message(lease, bytes(8), binding=119)) is None
    assert say(counter, hash_message(lease ^ 1, bytes(8))) is None
    assert counter.requests.dropped == {"hash of a type with an unknown lease": 1}
    assert counter.rig.inventory.dropped == {"hash of a type for a port that is not bound": 1}


def test_a_part_is_asked_once_for_a_hash_and_its_lines_in_the_journal_are_bounded() -> None:
    counter, lease = counter_with_library()
    inventory, events = counter.rig.inventory, list[str]()
    inventory.on_event(lambda event: events.append(event.reason))
    for number in range(3 * MOST_NOTES):
        octets = (number + 1).to_bytes(8, "big")
        asked = say(counter, hash_message(lease, octets))
        assert isinstance(asked, pnp_messages.Notice)
        assert (asked.kind, asked.binding, asked.detail) == (NoticeKind.TYPE_DIFFERS, 0, 0)
        answer = pnp_messages.DescriptionMessage(text=fields_text({"HelloWorld": THEIRS}))
        assert say(counter, answer) is None
        (told,) = counter.requests.fields_told(answer, KEY, counter.rig.now)
        assert (told.kind, told.detail) == (NoticeKind.TYPE_DIFFERS, 1)
        again = say(counter, hash_message(lease, octets))
        assert isinstance(again, pnp_messages.Notice)
        assert again.detail == 1, "it is known already"
        assert counter.requests.fields_told(answer, KEY, counter.rig.now) == []
    assert len([one for one in events if "is not that of the library" in one]) == MOST_NOTES
    assert len(inventory.type_differences(KEY)) == 1
    say(counter, hash_message(lease, type_hash("HelloWorld", OURS)))
    assert inventory.type_differences(KEY) == []


def test_fields_that_explain_nothing_are_told_as_that() -> None:
    counter, lease = counter_with_library()
    say(counter, hash_message(lease, bytes(range(8))))
    nothing = pnp_messages.DescriptionMessage(text="\n\x1b[2J \nHelloWorld index\n")
    (told,) = counter.requests.fields_told(nothing, KEY, counter.rig.now)
    assert told.detail == 255
    (difference,) = counter.rig.inventory.type_differences(KEY)
    assert (difference.their_field, difference.our_field) == ("", "")
