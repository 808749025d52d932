"""A robot in the past is what it was: cards, wires and values out of a recording are those that were shown then."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path

import pytest

from msbot.config import load_library
from msbot.operations.dispatch import InProcessOperations
from msbot.part import Message
from msbot.recording.recordings.bounded_copy import BoundedCopy
from msbot.sim import message_class
from msbot_school.demo import DemoRobot
from msbot_web.frame_ring import FrameRing
from msbot_web.live_values import LiveValues
from msbot_web.model_builder import ModelBuilder
from msbot_web.models.robot_models import SlotCard, TopicLine, WirePort
from msbot_web.recorded_past import copy_of_ring, read_moment, read_moment_of_copy
from msbot_web.recorded_snapshot import RecordedSnapshot, SnapshotBuilder
from msbot_web.simulated.controls import NoSimulatedControls
from msbot_web.slot_cards import stop_state
from msbot_web.timeline import Timeline
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, messages, record_demo

LIBRARY = load_library()


@dataclass
class Seen:
    """What pages showed at a time."""

    at: float
    cards: list[SlotCard]
    topics: list[TopicLine]
    ports: list[WirePort]


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Seen]]:
    """A rover to which a lot happens, and what was shown at several moments."""
    folder = tmp_path_factory.mktemp("story")
    seen: list[Seen] = []

    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        loop = asyncio.get_running_loop()
        views = ModelBuilder(
            robot.master,
            blueprint=lambda: operations.blueprint,
            library=LIBRARY,
            live=LiveValues(robot.master.space, class_of, loop.time),
            frames=FrameRing(),
            timeline=Timeline(),
            bench=NoSimulatedControls(),
            clock=loop.time,
            ignored=lambda _: False,
            by_hand=operations.by_hand.sent_values,
            planted=operations.faults.visible_faults,
            stop=lambda: stop_state(robot.master.stop),
        )

        async def look(seconds: float) -> None:
            for _ in range(round(seconds * 4)):
                views.poll()
                await asyncio.sleep(0.25)
            seen.append(Seen(loop.time(), views.slots(), views.topics(), views.ports()))
            await asyncio.sleep(0.01)

        await look(8.1)
        robot.unplug("knob")
        await look(3.6)
        await look(8.1)
        await operations.do("unbind", who="Ada", topic="loudness", port="hand.grip")
        await operations.do("publish", who="Ada", port="fan.power", values=["percent=7"], seconds=30)
        await look(3.1)
        await operations.do("stop", who="Ada", reason="a finger")
        await look(3.1)

    record_demo(folder, folder / "story.mcap", scene, sample="rover")
    return folder / "story.mcap", seen


def class_of(type_name: str) -> type[Message] | None:
    message = LIBRARY.messages.get(type_name)
    return None if message is None else message_class(message)


def moment_of(recording: Path, at: float) -> RecordedSnapshot:
    return SnapshotBuilder(BEGAN_NS + round(at * NS), messages(recording), (), LIBRARY).snapshot()


def told(card: SlotCard) -> object:
    """What a card shows and a recording tells."""
    part = card.part
    return (
        card.name,
        card.part_number,
        card.type_name,
        card.state,
        card.reason,
        card.description,
        card.spares,
        card.faults,
        None
        if part is None
        else (part.part, part.part_number, part.local_name, part.uid, part.slot, part.nature, part.life),
        [
            (
                one.port,
                one.topic,
                one.type_name,
                one.publishes,
                one.reliable,
                one.fields,
                one.held,
                one.safe,
                one.stale,
                None if one.age_s is None else round(one.age_s, 3),
            )
            for one in card.ports
        ],
    )


def beats(cards: list[SlotCard]) -> dict[str, float]:
    return {card.name: card.part.beat_age_s for card in cards if card.part and card.part.beat_age_s is not None}


def test_cards_and_wires_are_those_that_were_shown(story: tuple[Path, list[Seen]]) -> None:
    recording, seen = story
    for shown in seen:
        moment = moment_of(recording, shown.at)
        assert [told(card) for card in moment.robot.slots] == [told(card) for card in shown.cards]
        # Where two beats came between two notes of the recorder, their mean interval is all that is known.
        assert beats(moment.robot.slots) == pytest.approx(beats(shown.cards), abs=0.2)
        assert moment.ports == shown.ports
        assert [(one.topic, one.subscribers, one.fields) for one in moment.topics] == [
            (one.topic, one.subscribers, one.fields) for one in shown.topics
        ]
        assert [one.rate_hz for one in moment.topics] == pytest.approx([one.rate_hz for one in shown.topics], abs=0.6)
    states = [next(card.state for card in shown.cards if card.name == "knob") for shown in seen]
    assert states == ["active", "late", "lost", "lost", "lost"], "the story has what it is for"


def test_stop_hands_curves_and_the_bus_are_there_too(story: tuple[Path, list[Seen]]) -> None:
    recording, seen = story
    before, held = moment_of(recording, seen[0].at), moment_of(recording, seen[-1].at)
    assert (before.robot.stopped, held.robot.stopped, held.robot.stop.by) == (False, True, "Ada")
    assert len(held.robot.stop.confirmed) == 9
    by_hand = moment_of(recording, seen[3].at)
    (fan,) = [card for card in by_hand.robot.slots if card.name == "fan"]
    assert (fan.ports[0].held, fan.ports[0].fields) == ("by hand", {"percent": 7.0})
    assert len(before.sparks["loudness"]) > 3
    assert before.bus.watched
    assert before.bus.bitrate == 500_000
    assert 10 < before.bus.frames_per_second < 1000
    assert 0 < before.bus.load_percent < 50
    assert any("ear says level" in words for row in before.frames for words in row.plain)
    assert before.candump.count("\n") == len(before.frames) == before.csv.count("\n") - 1
    assert all(card.next_beat_s is None for card in before.robot.slots), "nothing on it moves"


def test_a_time_of_which_nothing_is_known_is_refused(story: tuple[Path, list[Seen]], tmp_path: Path) -> None:
    recording, seen = story
    (tmp_path / "ring-20231114T221320-000000.mcap").write_bytes(recording.read_bytes())
    moment = read_moment(str(tmp_path), BEGAN_NS / NS + seen[0].at, LIBRARY, ())
    assert len(moment.robot.slots) == 10
    for at_s in (BEGAN_NS / NS + 1000, BEGAN_NS / NS - 1000):
        with pytest.raises(ConfigError, match="nothing was recorded at that time"):
            read_moment(str(tmp_path), at_s, LIBRARY, ())


RING_FILE = "ring-20231114T221320-000000.mcap"
BEGAN_S = BEGAN_NS / NS


def copy_of(ring: Path, seconds: tuple[float, float], most_octets: int = 1 << 21) -> BoundedCopy:
    found = copy_of_ring(str(ring), BEGAN_S + seconds[0], BEGAN_S + seconds[1], most_octets)
    assert found is not None
    assert len(found.octets) <= most_octets
    return found


def test_a_copy_shows_the_robot_as_the_ring_did_after_the_ring_is_gone(
    story: tuple[Path, list[Seen]], tmp_path: Path
) -> None:
    recording, seen = story
    ring = tmp_path / RING_FILE
    ring.write_bytes(recording.read_bytes())
    copy = copy_of(tmp_path, (seen[1].at - 1, seen[2].at + 0.1))
    ring.unlink()
    for shown in seen[1:3]:
        moment = read_moment_of_copy("Ada's", copy.octets, BEGAN_S + shown.at, LIBRARY, ())
        assert [told(card) for card in moment.robot.slots] == [told(card) for card in shown.cards]
        assert moment.ports == shown.ports
    for at in (seen[0].at - 6, seen[2].at + 60):
        with pytest.raises(ConfigError, match="nothing was recorded at that time"):
            read_moment_of_copy("Ada's", copy.octets, BEGAN_S + at, LIBRARY, ())
    other = copy_of(tmp_path_with(tmp_path, recording), (0, seen[0].at))
    moment = read_moment_of_copy("Ben's", other.octets, BEGAN_S + seen[0].at, LIBRARY, ())
    assert [told(card) for card in moment.robot.slots] == [told(card) for card in seen[0].cards], "never another's"


def tmp_path_with(folder: Path, recording: Path) -> Path:
    (folder / RING_FILE).write_bytes(recording.read_bytes())
    return folder


def test_a_copy_that_is_too_large_begins_later(story: tuple[Path, list[Seen]], tmp_path: Path) -> None:
    recording, seen = story
    ring = tmp_path_with(tmp_path, recording)
    whole = copy_of(ring, (0, seen[-1].at))
    assert len(whole.octets) < recording.stat().st_size, "without frames"
    less = copy_of(ring, (0, seen[-1].at), len(whole.octets) - 1)
    assert less.from_ns > whole.from_ns
    assert less.to_ns == whole.to_ns
    moment = read_moment_of_copy("less", less.octets, BEGAN_S + seen[-1].at, LIBRARY, ())
    assert [told(card) for card in moment.robot.slots] == [told(card) for card in seen[-1].cards]
    assert copy_of_ring(str(ring), BEGAN_S, BEGAN_S + seen[-1].at, 100) is None
    assert copy_of_ring(str(ring), BEGAN_S + 5000, BEGAN_S + 6000, 1 << 20) is None
    assert copy_of_ring(str(tmp_path / "nowhere"), BEGAN_S, BEGAN_S + 10, 1 << 20) is None
