"""Replayed parts in a robot: record, replay, record again; STOP; what cannot be replayed."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import click
import pytest
from mcap.writer import Writer

from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartInfo
from msbot.recording.recorder.batch import Item, Kind, RecordedChannel, encode_object, encode_state
from msbot.recording.recordings.excerpts import write_cut
from msbot.recording.replay.replay_excerpt import RecordedSample, RecordedSlot, ReplayExcerpt, read_excerpt
from msbot.recording.replay.replay_player import ReplayPlayer
from msbot_agent.cli import msbot
from msbot_agent.link import InprocHub
from msbot_school.demo import DemoRobot
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, messages, record_demo, store

OTHERS = ("BB", "CC")


async def some_seconds(robot: DemoRobot, operations: InProcessOperations) -> None:
    await asyncio.sleep(5)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    record_demo(folder, folder / "a.mcap", some_seconds)
    return folder / "a.mcap"


class Stage:
    """A player in a robot, and what it said."""

    def __init__(self, piece: ReplayExcerpt, speed: float = 1.0, after_s: float = 0.0) -> None:
        self.said: list[str] = []
        self.player = ReplayPlayer(piece, speed=speed, say=self.said.append, warn=self.said.append, random=Random(7))
        self.after_s = after_s
        self.fault = ""

    async def play(self, robot: DemoRobot) -> None:
        await asyncio.sleep(self.after_s)
        hub = InprocHub()
        robot.master.add_link(hub.server)
        try:
            await self.player.run(lambda _: hub.connect(), epoch_ns=lambda: BEGAN_NS)
        except ConfigError as error:
            self.fault = str(error)

    def scene(
        self, meanwhile: Callable[[DemoRobot, InProcessOperations], Awaitable[None]] | None = None
    ) -> Callable[[DemoRobot, InProcessOperations], Awaitable[None]]:
        async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
            async with asyncio.TaskGroup() as tasks:
                playing = tasks.create_task(self.play(robot))
                if meanwhile is not None:
                    await meanwhile(robot, operations)
                await playing
            await asyncio.sleep(1)

        return scene


def info_of(robot: DemoRobot, slot: str) -> PartInfo:
    now = asyncio.get_running_loop().time()
    return next(info for info in robot.master.inventory.view(now) if info.slot == slot)


def said_in(path: Path, slot: str) -> list[tuple[int, bytes]]:
    """What a slot's part published: nanoseconds since its first sample, content."""
    found = [(one.at_ns, one.data) for one in messages(path) if one.slot == slot and not one.is_repeated]
    return [(at_ns - found[0][0], data) for at_ns, data in found]


def states_of(path: Path, slots: tuple[str, ...]) -> dict[str, list[tuple[str | None, str]]]:
    events = [json.loads(one.data) for one in messages(path) if one.topic == "/msbot/events"]
    names = {event["part"] for event in events if event["slot"] in slots}
    return {name: [(one["from"], one["to"]) for one in events if one["part"] == name] for name in names}


def test_record_replay_record_gives_the_same_samples_at_the_same_times(tmp_path: Path, recording: Path) -> None:
    stage = Stage(read_excerpt(recording, ["AA"]))
    natures = []

    async def look(robot: DemoRobot, _: InProcessOperations) -> None:
        await asyncio.sleep(2)
        natures.append(info_of(robot, "AA").nature.label)

    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(look), OTHERS)
    before, after = said_in(recording, "AA"), said_in(tmp_path / "b.mcap", "AA")
    assert len(before) == 5
    assert [data for _, data in after] == [data for _, data in before]
    assert max(abs(a - b) for (a, _), (b, _) in zip(after, before, strict=True)) <= 1  # ns: the clock is a float
    assert states_of(tmp_path / "b.mcap", OTHERS) == states_of(recording, OTHERS)
    assert len(states_of(recording, OTHERS)) == 2
    assert natures == ["replayed"]
    assert stage.said == ["The replay begins"]
    assert (stage.player.published, stage.player.late_s, stage.player.ended) == (len(before), 0.0, True)
    ends = [json.loads(one.data) for one in messages(tmp_path / "b.mcap") if one.topic == "/msbot/events"]
    assert [one["to"] for one in ends if one["part"] == "ABCD-local"][-1] == "left", "it says goodbye"


def test_a_piece_at_another_speed(tmp_path: Path, recording: Path) -> None:
    whole = said_in(recording, "AA")
    piece = read_excerpt(recording, ["AA"], from_s=1.5, to_s=4.5)
    assert piece.begin_ns == messages(recording)[0].logged_ns + 3 * NS // 2
    stage = Stage(piece, speed=4.0)
    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(), OTHERS)
    after = said_in(tmp_path / "b.mcap", "AA")
    assert len(after) == len(piece.samples) == 3
    assert [data for _, data in after] == [data for _, data in whole if data[4:] in {s.octets for s in piece.samples}]
    assert abs(after[-1][0] - (piece.samples[-1].at_ns - piece.samples[0].at_ns) / 4) <= 2


def test_several_slots_keep_their_distances(tmp_path: Path, recording: Path) -> None:
    stage = Stage(read_excerpt(recording, ["AA", "CC", "AA"]))
    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(), ("BB",))

    def both(path: Path) -> list[tuple[str, int]]:
        found = [(one.slot, one.at_ns) for one in messages(path) if one.slot in {"AA", "CC"}]
        return [(slot, at_ns - found[0][1]) for slot, at_ns in found]

    before, after = both(recording), both(tmp_path / "b.mcap")
    assert [slot for slot, _ in after] == [slot for slot, _ in before]
    assert max(abs(a - b) for (_, a), (_, b) in zip(after, before, strict=True)) <= 2


def test_while_stop_holds_nothing_is_said_and_afterwards_all_of_it(tmp_path: Path, recording: Path) -> None:
    stage = Stage(read_excerpt(recording, ["AA"]))

    async def stop_and_go(robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(2.3)
        await operations.do("stop", who="Ada", reason="a finger")
        await asyncio.sleep(4)
        await operations.do("go", who="Ada")

    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(stop_and_go), OTHERS)
    acts = [one.at_ns for one in messages(tmp_path / "b.mcap") if one.topic == "/msbot/acts"]
    said_at = [one.at_ns for one in messages(tmp_path / "b.mcap") if one.slot == "AA"]
    assert len(acts) == 2
    assert [at for at in said_at if acts[0] < at < acts[1]] == []
    assert said_at[0] < acts[0] < acts[1] < said_at[-1]
    assert [data for _, data in said_in(tmp_path / "b.mcap", "AA")] == [data for _, data in said_in(recording, "AA")]
    assert stage.said == ["The replay begins", "The replay waits: STOP holds", "The replay goes on"]


def test_a_part_that_comes_back_after_an_outage_goes_on_where_it_was(tmp_path: Path, recording: Path) -> None:
    stage = Stage(read_excerpt(recording, ["AA"]))

    async def release(robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(2.3)
        key = info_of(robot, "AA").client_key
        assert robot.master.agent.disconnect(key, "the cable was out")

    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(release), OTHERS)
    before, after = ([data for _, data in said_in(path, "AA")] for path in (recording, tmp_path / "b.mcap"))
    # As with any part, what it sends before it notices does not arrive; nothing is lost from then on.
    assert after == before[:3] + before[4:]
    assert stage.player.ended
    lost = [change for change in states_of(tmp_path / "b.mcap", ("AA",))["ABCD-local"] if change[1] != "active"]
    assert len(lost) >= 2, "it was gone in between, and at the end"


@pytest.mark.parametrize(
    ("slot", "number", "sentence"),
    [
        ("AA", "LED", "slot AA: the robot refuses part number LED: this robot has no slot for this part number"),
        ("AA", "QQQQ", "slot AA: the robot refuses part number QQQQ: this part number is not in the library"),
        ("XX", "ABCD", "the robot has put the replayed part into slot AA, not into XX: take the part out of slot XX"),
    ],
)
def test_a_robot_with_other_slots_says_so(tmp_path: Path, slot: str, number: str, sentence: str) -> None:
    stage = Stage(piece_of(slot, number, "out", "HelloWorld"))
    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(), OTHERS)
    assert sentence in stage.fault
    assert stage.player.published == 0


def test_a_slot_that_is_taken_is_waited_for(tmp_path: Path, recording: Path) -> None:
    stage = Stage(read_excerpt(recording, ["AA"], to_s=2), after_s=1.0)

    async def unplug_later(robot: DemoRobot, _: InProcessOperations) -> None:
        await asyncio.sleep(2)
        assert stage.player.published == 0
        robot.unplug("AA")

    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(unplug_later))
    assert "every fitting slot is taken" in stage.said[0]
    found = re.search(r"`msbot (swap AA .*?)`", stage.said[0])
    assert found
    words = found[1].split()
    swap = msbot.get_command(click.Context(msbot), words[0])
    assert swap is not None
    assert swap.make_context(words[0], words[1:]).params["slot"] == "AA"  # the command takes what the sentence says
    assert stage.player.ended
    assert stage.player.published > 0


@pytest.mark.parametrize(
    ("port", "type_name", "sentence"),
    [
        ("outlet", "HelloWorld", "there is no port 'outlet' to publish on"),
        ("in", "HelloWorld", "there is no port 'in' to publish on"),
        ("out", "Level", "port 'out' carries HelloWorld, not Level"),
    ],
)
def test_what_the_robot_has_no_use_for_is_left_out_and_told(
    tmp_path: Path, port: str, type_name: str, sentence: str
) -> None:
    stage = Stage(piece_of("AA", "ABCD", port, type_name))
    record_demo(tmp_path, tmp_path / "b.mcap", stage.scene(), OTHERS)
    assert any(sentence in words and "left out" in words for words in stage.said)
    assert stage.player.left_out == {("AA", port): 1}
    assert stage.player.ended


def test_what_cannot_be_published_again_is_named_with_its_count(tmp_path: Path) -> None:
    def of_slot(topic: str, encoding: str = "cdr", **more: str) -> bytes:
        return RecordedChannel(topic, encoding, metadata=tuple({"slot": "AA", **more}.items())).encode()

    def items(*, with_out: bool) -> list[Item]:
        number = {"slot": "AA", "part_number": "ABCD"}
        return [
            (int(Kind.CHANNEL), 1, 0, RecordedChannel("/msbot/slots", "json").encode()),
            (int(Kind.STATE), 1, BEGAN_NS, encode_state("AA", number)),
            (int(Kind.CHANNEL), 2, 0, of_slot("/of_no_port")),
            (int(Kind.CHANNEL), 3, 0, of_slot("/in_words", "json", port="out")),
            (int(Kind.CHANNEL), 4, 0, of_slot("/out", port="out", type="HelloWorld")),
            *((int(Kind.SAMPLE), 2, BEGAN_NS + one, bytes(4)) for one in range(3)),
            (int(Kind.OBJECT), 3, BEGAN_NS, encode_object({})),
            *([(int(Kind.SAMPLE), 4, BEGAN_NS, bytes(8))] if with_out else []),
        ]

    store(items(with_out=True), tmp_path / "a.mcap")
    piece = read_excerpt(tmp_path / "a.mcap")
    assert len(piece.samples) == 1
    assert piece.left_out == {"/of_no_port": 3, "/in_words": 1}
    store(items(with_out=False), tmp_path / "b.mcap")
    with pytest.raises(ConfigError, match=r"left out is /of_no_port \(3\), /in_words \(1\)"):
        read_excerpt(tmp_path / "b.mcap")


def piece_of(slot: str, number: str, port: str, type_name: str) -> ReplayExcerpt:
    sample = RecordedSample(5, slot, port, type_name, bytes(8))
    return ReplayExcerpt((RecordedSlot(slot, number, f"{number}-local"),), (sample,), 5, "")


def test_what_is_wrong_with_the_choice_is_told(recording: Path) -> None:
    for slots, options, sentence in (
        ((), {}, "has the slots .*: say which one to replay with --slot"),
        (("DD",), {}, "has no slot 'DD'; there are "),
        (("AA",), {"from_s": 100.0}, "the part in slot AA published nothing from 100 s on"),
        (("AA",), {"to_s": 0.0}, "published nothing until 0 s"),
        (("AA",), {"from_s": 8.0, "to_s": 2.0}, "--to must not be before --from"),
        (("AA",), {"most_octets": 1000}, "choose a shorter one with --from and --to"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            read_excerpt(recording, slots, **options)


def test_one_slot_needs_no_name_and_what_was_only_repeated_is_not_said_again(tmp_path: Path, recording: Path) -> None:
    from_ns = messages(recording)[0].logged_ns + 3 * NS
    write_cut(
        [recording],
        tmp_path / "one.mcap",
        from_ns=from_ns,
        wanted=lambda one: one.slot == "AA" or (one.topic == "/msbot/slots" and b'"AA"' in one.data),
    )
    piece = read_excerpt(tmp_path / "one.mcap")
    assert [slot.name for slot in piece.slots] == ["AA"]
    assert piece.samples[0].at_ns >= from_ns
    assert any(one.is_repeated for one in messages(tmp_path / "one.mcap"))


def test_a_truncated_recording_is_replayed_as_far_as_it_goes(tmp_path: Path, recording: Path) -> None:
    with (tmp_path / "short.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=1000)
        writer.start("", "msbot")
        channels: dict[int, int] = {}
        for one in messages(recording):
            if one.channel.id not in channels:
                metadata = one.channel.metadata
                channels[one.channel.id] = writer.register_channel(one.topic, one.channel.message_encoding, 0, metadata)
            writer.add_message(channels[one.channel.id], one.logged_ns, one.data, one.at_ns)
        stream.truncate(stream.tell() * 4 // 5)
    whole = read_excerpt(recording, ["AA"])
    short = read_excerpt(tmp_path / "short.mcap", ["AA"])
    assert short.damage
    assert 0 < len(short.samples) < len(whole.samples)
    assert short.samples == whole.samples[: len(short.samples)]


@pytest.mark.parametrize("slots", [None, b"[1]", b"{", b'{"slot": 7, "part_number": "ABCD"}', b'{"slot": "\\n"}'])
def test_a_recording_of_others_says_what_is_missing(tmp_path: Path, slots: bytes | None) -> None:
    with (tmp_path / "foreign.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "somebody")
        writer.add_message(writer.register_channel("/t", "cdr", 0, {"slot": "AA", "port": "out"}), 1, b"\0\1\0\0x", 1)
        if slots is not None:
            writer.add_message(writer.register_channel("/msbot/slots", "json", 0), 1, slots, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(ConfigError, match="does not say what is in which slot"):
        read_excerpt(tmp_path / "foreign.mcap", ["AA"])
