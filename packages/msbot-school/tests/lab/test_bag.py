"""Bags that the recorder writes at once, read by programs of others."""

import asyncio
import dataclasses
import json
import re
from collections import Counter
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msbot.config import InDds
from msbot.operations.dispatch import InProcessOperations
from msbot.part import Message
from msbot.part.messages.ros_names import ros_name
from msbot.part.messages.standard import Colour, Level
from msbot.recording.recorder.batch import Item, Kind, RecordedChannel, encode_object
from msbot.recording.recorder.ring_storage import Storing
from msbot.recording.recorder.schemas import ENCODING, ros_definition, ros_metadata
from msbot.recording.recordings.excerpts import write_cut
from msbot_school.demo import DemoRobot
from tests.lab.recorded import BEGAN_NS, LIMITS, messages, record_demo, store

PROMISE = "What the recorder writes with --ros2 is a bag that ROS 2's own readers take, and what is not in it is named"


def channel(number: int, topic: str, cls: type[Message], *, ros: bool = False) -> Item:
    """A channel of the recorder with messages of a class."""
    metadata = ros_metadata((f"/ROVER{topic}", InDds(ros=True)), cls) if ros else {}
    one = RecordedChannel(topic, "cdr", ros_name(cls.type_name), ENCODING, ros_definition(cls), (*metadata.items(),))
    return (Kind.CHANNEL, number, 0, one.encode())


def sample(number: int, message: Message | bytes) -> Item:
    """A sample of that channel."""
    payload = message if isinstance(message, bytes) else message.encode()
    return (Kind.SAMPLE, number, BEGAN_NS, payload)


def read(bag: Path) -> list[tuple[str, int, object]]:
    """Topic, time and message of each sample, by rosbags, which takes nothing but bags."""
    types = get_typestore(Stores.EMPTY)
    with Reader(bag) as reader:
        for one in reader.connections:
            assert re.fullmatch("(/[A-Za-z_][A-Za-z0-9_]*)+", one.topic)
            types.register(get_types_from_msg(one.msgdef.data, one.msgtype))
        assert len({one.topic for one in reader.connections}) == len(reader.connections), "a topic is one channel"
        return [(one.topic, at, types.deserialize_cdr(data, one.msgtype)) for one, at, data in reader.messages()]


@pytest.mark.promise(PROMISE)
def test_a_bag_that_is_recorded_at_once_is_the_one_that_a_recording_becomes(tmp_path: Path) -> None:
    async def scene(_robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(6)
        await operations.do("stop", who="Ada", reason="a finger")

    whole, bag, cut = (tmp_path / f"{name}.mcap" for name in ("whole", "bag", "cut"))
    shared = {"fan_power": "ros = true"}
    record_demo(tmp_path, whole, scene, ("knob", "fan", "ear"), "rover", shared=shared, bag=bag)
    left_out = write_cut([whole], cut, ros=True).left_out
    assert left_out == Counter(one.topic for one in messages(whole) if not one.is_ros)
    assert "/msbot/acts" in left_out
    assert not any(topic.startswith("/msbot_inventory_") for topic in left_out)
    at_once, later = messages(bag), messages(cut)
    assert [(one.topic, one.logged_ns, one.at_ns, one.data) for one in at_once] == [
        (one.topic, one.logged_ns, one.at_ns, one.data) for one in later
    ]
    theirs = read(bag)
    assert len(theirs) == len(at_once)
    powers = [one.data for topic, _, one in theirs if topic == "/ROVER/fan_power"]  # type: ignore[attr-defined]
    assert len(powers) > 10
    with bag.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert (reader.get_header().profile, reader.get_header().library) == ("ros2", "msbot")
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        # What rosbag2 asks of a file without metadata.yaml: a summary with statistics and indexes, CDR everywhere, and
        # a schema for each channel.
        assert summary.statistics.message_count == len(at_once)
        assert all(chunk.message_index_length for chunk in summary.chunk_indexes)
        assert all(one.message_encoding == "cdr" for one in summary.channels.values())
        assert all(one.schema_id in summary.schemas for one in summary.channels.values())
        found = [one.data for *_, one in reader.iter_decoded_messages(topics=["/ROVER/fan_power"])]
    assert found == powers


@pytest.mark.promise(PROMISE)
def test_each_topic_that_is_not_in_the_bag_is_named(tmp_path: Path) -> None:
    bright = Colour(red=255, green=0, blue=0)
    items = [
        (Kind.CHANNEL, 1, 0, RecordedChannel("/msbot/acts", "json", "acts", "jsonschema", "{}").encode()),
        (Kind.OBJECT, 1, BEGAN_NS, encode_object({"who": "Ada"})),
        (Kind.CHANNEL, 2, 0, RecordedChannel("/strange", "cdr").encode()),  # of a type that nobody knows
        sample(2, b"1234"),
        sample(2, b"5678"),
        channel(3, "/colour", Colour, ros=True),
        sample(3, bright),
        channel(4, "/power", Level, ros=True),
        sample(4, b"\x01"),  # shorter than its type
        sample(4, Level(percent=12.0)),
        channel(5, "/plain", Level),
        sample(5, Level(percent=3.0)),
    ]
    bag = tmp_path / "bag.mcap"
    assert store(items, bag, as_bag=True) == ["/msbot/acts", "/strange", "/power"]
    assert [(topic, dataclasses.asdict(one)) for topic, _, one in read(bag)] == [  # type: ignore[call-overload]
        ("/ROVER/colour", {"r": 1.0, "g": 0.0, "b": 0.0, "a": 0.0, "__msgtype__": "std_msgs/msg/ColorRGBA"}),
        ("/ROVER/power", {"data": 12.0, "__msgtype__": "std_msgs/msg/Float32"}),
        ("/plain", {"percent": 3.0, "__msgtype__": "msbot_msgs/msg/Level"}),
    ]


class Arm(Message):
    """A type of a library."""

    tip: Level
    isUp: bool


@pytest.mark.parametrize("package", ["msbot_msgs", "arm_msgs"])
def test_a_type_of_a_package_that_msbot_has_written_is_in_the_bag(tmp_path: Path, package: str) -> None:
    shared = ros_metadata(("/ROVER/arm", InDds(ros=True, ros_type=f"{package}/msg/Arm")), Arm)
    one = RecordedChannel("/arm", "cdr", ros_name("Arm"), ENCODING, ros_definition(Arm), (*shared.items(),))
    items = [(Kind.CHANNEL, 1, 0, one.encode()), sample(1, Arm(tip=Level(percent=5), isUp=True))]
    bag = tmp_path / "bag.mcap"
    assert store(items, bag, as_bag=True) == []
    ((topic, _, told),) = read(bag)
    assert (topic, told.__msgtype__, told.tip.__msgtype__) == (  # type: ignore[attr-defined]
        "/ROVER/arm",
        f"{package}/msg/Arm",
        f"{package}/msg/Level",
    )
    assert (told.tip.percent, told.is_up) == (5.0, True)  # type: ignore[attr-defined]


def test_what_is_left_out_is_told_while_it_is_recorded_and_each_topic_once(tmp_path: Path) -> None:
    told: list[tuple[str, list[str]]] = []
    storing = Storing(None, LIMITS, lambda *_: None, on_left_out=lambda file, topics: told.append((file, topics)))
    storing.take((Kind.CHANNEL, 1, 0, RecordedChannel("/before", "json").encode()), 0.0)
    storing.take((Kind.STATE, 1, BEGAN_NS, b"\x01k" + encode_object({})), 0.0)
    bag = str(tmp_path / "bag.mcap")
    storing.take((Kind.START_BAG, 0, BEGAN_NS, bag.encode()), 0.0)
    assert told == [(bag, ["/before"])]
    for number, topic in enumerate(("/a", "/b"), 2):
        storing.take((Kind.CHANNEL, number, 0, RecordedChannel(topic, "cdr").encode()), 0.0)
    for _ in range(3):
        storing.take(sample(2, b"x"), 0.0)
        storing.flush(0.0)
    storing.take(sample(3, b"y"), 0.0)
    storing.take((Kind.STOP, 0, BEGAN_NS, b""), 0.0)
    assert told[1:] == [(bag, ["/a"]), (bag, ["/b"])]
    storing.close()


@pytest.mark.promise(PROMISE)
def test_a_bag_of_a_killed_recorder_is_refused_by_others_and_mended_by_a_filter(tmp_path: Path) -> None:
    whole, bag, mended = (tmp_path / f"{name}.mcap" for name in ("whole", "bag", "mended"))
    storing = Storing(None, LIMITS, lambda *_: None)
    storing.take((Kind.START_BAG, 0, 0, str(bag).encode()), 0.0)
    storing.take(channel(1, "/power", Level, ros=True), 0.0)
    for number in range(100):
        storing.take(sample(1, Level(percent=number)), 0.0)
        if number % 10 == 9:
            storing.flush(0.0)
    octets = bag.read_bytes()  # all that is there when it is killed now
    storing.close()
    bag.rename(whole)
    bag.write_bytes(octets)
    with pytest.raises((ReaderError, McapError)):
        read(bag)
    cut = write_cut([bag], mended, ros=True)
    assert (cut.messages, cut.left_out) == (100, Counter())
    assert "what came before was read" in cut.damages["bag.mcap"]
    assert [one.data for _, _, one in read(mended)] == [float(number) for number in range(100)]  # type: ignore[attr-defined]
    assert json.dumps([str(one) for one in read(mended)]) == json.dumps([str(one) for one in read(whole)])
