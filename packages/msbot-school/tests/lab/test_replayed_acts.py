"""What people did, done again: record, replay, record again; STOP and GO; robots that it does not fit."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from random import Random

import pytest

from msbot.operations.dispatch import InProcessOperations, perform
from msbot.recording.recordings.excerpts import write_cut
from msbot.recording.recordings.mcap_reader import RecordedMessage
from msbot.recording.replay.recorded_operations import (
    OperationPlayer,
    RecordedOperation,
    RecordedOperations,
    read_operations,
)
from msbot.recording.replay.replay_excerpt import read_excerpt
from msbot.recording.replay.replay_player import ReplayPlayer
from msbot_agent.link import InprocHub
from msbot_school.demo import DemoRobot
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, messages, record_demo

Scene = Callable[[DemoRobot, InProcessOperations], Awaitable[None]]


async def a_lesson(robot: DemoRobot, operations: InProcessOperations) -> None:
    """People set, rewire, drive by hand, stop and go on."""
    await asyncio.sleep(3)
    await operations.do("set", who="Ada", slot="ear", name="threshold", value="33")
    await asyncio.sleep(1.25)
    await operations.do("unbind", who="Ben", topic="loudness", port="hand.grip")
    await operations.do("publish", who="Ben", port="fan.power", values=["percent=70"], seconds=2)
    await asyncio.sleep(0.5)
    await operations.do("stop", who="Ada", reason="a finger")
    await asyncio.sleep(2)
    await operations.do("go", who="Cy")
    await operations.do("reset", who="Ada", slot="ear", name="threshold")
    await operations.do("bind", who="Ben", topic="loudness", type="Level", to=["hand.grip"])
    await operations.do("undo", who="Ada")
    await asyncio.sleep(1)


@pytest.fixture(scope="module")
def lesson(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lesson")
    record_demo(folder, folder / "a.mcap", a_lesson, sample="rover")
    return folder / "a.mcap"


def replay(
    acts: RecordedOperations, said: list[str], meanwhile: Scene | None = None, rest_s: float = 1.0
) -> tuple[Scene, list[OperationPlayer]]:
    """A scene in which acts are done again, and the player once it is there."""
    players: list[OperationPlayer] = []

    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        async def ask(request: Mapping[str, object]) -> Mapping[str, object]:
            return await perform(operations, request)

        players.append(OperationPlayer(acts, ask, say=said.append))
        async with asyncio.TaskGroup() as tasks:
            if meanwhile is not None:
                tasks.create_task(_as_coroutine(meanwhile(robot, operations)))
            try:
                await players[0].run()
            except ConfigError as error:
                said.append(str(error))
        await asyncio.sleep(rest_s)

    return scene, players


async def _as_coroutine(work: Awaitable[None]) -> None:
    await work


def told(path: Path, *topics: str) -> list[tuple[int, dict[str, object]]]:
    """What was recorded there: nanoseconds since the first act, content."""
    found: list[RecordedMessage] = [one for one in messages(path) if not one.is_repeated]
    first = next(one.at_ns for one in found if one.topic == "/msbot/acts")
    return [(one.at_ns - first, json.loads(one.data)) for one in found if one.topic in topics and one.at_ns >= first]


def deeds(path: Path) -> list[tuple[int, object, object]]:
    return [(at_ns, act["operation"], act["arguments"]) for at_ns, act in told(path, "/msbot/acts")]


def test_record_replay_record_gives_the_same_acts_and_the_same_robot(tmp_path: Path, lesson: Path) -> None:
    acts = read_operations(lesson, from_s=0)
    assert acts.left_out == {"undo": 1}
    said: list[str] = []
    scene, players = replay(acts, said)
    record_demo(tmp_path, tmp_path / "b.mcap", scene, sample="rover")
    before = [deed for deed in deeds(lesson) if deed[1] != "undo"]
    after = deeds(tmp_path / "b.mcap")
    assert [deed[1:] for deed in after] == [deed[1:] for deed in before]
    assert max(abs(a[0] - b[0]) for a, b in zip(after, before, strict=True)) <= 2  # ns: the clock is a float
    assert said == []
    assert players[0].ended
    assert players[0].done == 7
    who = [act["who"] for _, act in told(tmp_path / "b.mcap", "/msbot/acts")]
    assert who == [
        "Ada, replayed",
        "Ben, replayed",
        "Ben, replayed",
        "Ada, replayed",
        "Cy, replayed",
        "Ada, replayed",
        "Ben, replayed",
    ]
    for topic, name in (("/msbot/slots", "settings"), ("/msbot/blueprint", "wires"), ("/msbot/shown", "by_hand")):
        then, again = ([value.get(name) for _, value in told(path, topic)] for path in (lesson, tmp_path / "b.mcap"))
        assert again == then[: len(again)], f"{topic} went the same way, up to the undo"
        assert len(again) >= 1

    # And once more: what was replayed is replayed to the same.
    (tmp_path / "c").mkdir()
    scene, _ = replay(read_operations(tmp_path / "b.mcap", from_s=0), said)
    record_demo(tmp_path / "c", tmp_path / "c.mcap", scene, sample="rover")
    assert [act for _, act in told(tmp_path / "c.mcap", "/msbot/acts")] == [
        act for _, act in told(tmp_path / "b.mcap", "/msbot/acts")
    ]


def test_parts_and_acts_of_one_recording_keep_time_with_each_other(tmp_path: Path, lesson: Path) -> None:
    piece, acts = read_excerpt(lesson, ["ear"]), read_operations(lesson)
    said: list[str] = []

    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        async def ask(request: Mapping[str, object]) -> Mapping[str, object]:
            return await perform(operations, request)

        hub = InprocHub()
        robot.master.add_link(hub.server)
        player = ReplayPlayer(
            piece, say=said.append, warn=said.append, random=Random(7), is_own_stop=lambda: actor.holds_stop
        )
        actor = OperationPlayer(
            acts, ask, say=said.append, begin_ns=piece.begin_ns, may_go=lambda: player.is_going or player.ended
        )
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(player.run(lambda _: hub.connect(), epoch_ns=lambda: BEGAN_NS))
            tasks.create_task(actor.run())

    others = ("knob", "fan", "button", "headlight", "eye", "beacon", "hand", "bumper", "horn")
    record_demo(tmp_path, tmp_path / "b.mcap", scene, others, sample="rover")
    assert said == ["The replay begins"]

    def ear(path: Path) -> list[tuple[int, bytes]]:
        found = [one for one in messages(path) if not one.is_repeated]
        first = next(one.at_ns for one in found if one.topic == "/msbot/acts")
        return [(one.at_ns - first, one.data) for one in found if one.slot == "ear"]

    before, after = ear(lesson), ear(tmp_path / "b.mcap")
    assert [data for _, data in after] == [data for _, data in before], "also what it said while STOP held"
    # The acts are looked at ten times a second until the part is in the robot; they keep that distance.
    late = [a - b for (a, _), (b, _) in zip(after, before, strict=True)]
    assert max(late) - min(late) <= 2
    assert abs(late[0]) <= NS // 10


def test_a_stop_of_somebody_else_holds_the_replay_and_is_never_ended_by_it(tmp_path: Path, lesson: Path) -> None:
    said: list[str] = []
    held: list[bool] = []

    async def beside(robot: DemoRobot, operations: InProcessOperations) -> None:
        while not robot.master.stop.stopped:  # noqa: ASYNC110 - virtual time; STOP is the recording's
            await asyncio.sleep(0.1)
        await asyncio.sleep(0.5)
        await operations.do("stop", who="Dee", reason="me too")
        await asyncio.sleep(20)
        held.append(robot.master.stop.stopped)
        await operations.do("go", who="Dee")

    scene, players = replay(read_operations(lesson), said, beside)
    record_demo(tmp_path, tmp_path / "b.mcap", scene, sample="rover")
    assert held == [True]
    assert said == [
        "The replay waits: STOP by Ada, replayed and Dee holds",
        "The replay goes on",
        "A recorded GO is left out: no STOP of this replay holds",
    ]
    assert (players[0].ended, players[0].done) == (True, 6)


@pytest.mark.parametrize(
    ("operation", "arguments", "sentence"),
    [
        ("set", {"slot": "eye", "name": "threshold", "value": "3"}, "what Ada did (set eye threshold 3) does not fit"),
        ("bind", {"topic": "t", "type": "Level", "from": "nose.level", "to": ["fan.power"]}, "nose"),
        ("publish", {"port": "fan.power", "values": ["percent=7000"], "seconds": 3}, "does not fit this robot"),
        ("go", {}, "A recorded GO is left out"),
    ],
)
def test_what_does_not_fit_the_robot_is_refused_in_a_sentence(
    tmp_path: Path, operation: str, arguments: dict[str, object], sentence: str
) -> None:
    said: list[str] = []
    acts = RecordedOperations((RecordedOperation(NS, "Ada", operation, arguments),), NS, {}, "")
    scene, players = replay(acts, said, rest_s=0.1)
    record_demo(tmp_path, tmp_path / "b.mcap", scene, sample="rover")
    (words,) = said
    assert sentence in words
    assert players[0].done == 0


def test_a_piece_without_acts_is_refused(lesson: Path) -> None:
    with pytest.raises(ConfigError, match="nobody did anything in that time"):
        read_operations(lesson, from_s=0.0, to_s=1.0)
    assert read_operations(lesson, from_s=4.0).acts[0].operation == "unbind"


def test_a_stop_that_was_not_said_by_the_operation_is_an_act_too(tmp_path: Path) -> None:
    """`msbot stop` has a socket of its own to the master."""

    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(1)
        robot.master.say_stop("Ada", "a finger")
        await asyncio.sleep(1)
        robot.master.say_go("Cy")
        await asyncio.sleep(1)

    record_demo(tmp_path, tmp_path / "a.mcap", scene, sample="rover")
    acts = read_operations(tmp_path / "a.mcap").acts
    assert [(act.who, act.operation, act.arguments) for act in acts] == [
        ("Ada", "stop", {"reason": "a finger"}),
        ("Cy", "go", {}),
    ]
    assert acts[1].at_ns - acts[0].at_ns == pytest.approx(NS, abs=2)


def test_a_piece_begins_with_what_was_so_and_not_with_what_was_done(tmp_path: Path, lesson: Path) -> None:
    last_ns = max(one.at_ns for one in messages(lesson) if one.topic == "/msbot/acts")
    write_cut([lesson], tmp_path / "end.mcap", from_ns=last_ns + 1)
    early = [one.topic for one in messages(tmp_path / "end.mcap") if one.is_repeated]
    assert {"/msbot/slots", "/msbot/events", "/msbot/blueprint"} <= set(early)
    assert "/msbot/acts" not in early
    assert "/msbot/measured" not in early
