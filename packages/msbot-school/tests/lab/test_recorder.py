"""What is recorded of a robot, read by programs of others."""

import asyncio
import json
import re
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from random import Random

import mcap.decoder
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msbot.cli.record.log import command as log_command
from msbot.config import load_library, read_description
from msbot.operations.dispatch import InProcessOperations
from msbot.part.join.pnp_messages import Beat
from msbot.part.join.seal import SHORT_SAYINGS, Seal
from msbot.part.messages.standard import Level
from msbot.recording.recorder import recorder_process
from msbot.recording.recorder.batch import MEASURED, Kind, RecordedChannel, Unpacker, encode_object
from msbot.recording.recorder.recorder import Recorder
from msbot.recording.recorder.recorder_process import RecorderProcess, run_recorder
from msbot.recording.recorder.recording_file import RingLimits
from msbot.recording.recorder.schemas import ENCODING, FRAME, ros_definition
from msbot.recording.recordings.excerpts import differences
from msbot.recording.recordings.mcap_reader import Decoder, RecordedMessage, RecordingReader
from msbot.recording.recordings.summary import frame_of, line_of
from msbot_agent.link import LinkInfo
from msbot_agent.link.can import CanBusInfo, CanMasterLink, FrameTap
from msbot_agent.link.can.protocol import Frame
from msbot_agent.space import MemorySpace, Qos, Topic
from msbot_school.demo import DemoRobot
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, messages, record_demo, store


@pytest.mark.parametrize("rounds", range(3))
async def test_who_ends_before_the_recorder_has_started_has_a_recording_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rounds: int
) -> None:
    may_start, start = threading.Event(), RecorderProcess.start

    def start_late(self: RecorderProcess) -> None:
        may_start.wait()
        start(self)

    monkeypatch.setattr(RecorderProcess, "start", start_late)
    recorder = Recorder(lambda: 1.0, lambda: BEGAN_NS)
    process = RecorderProcess(recorder, None, RingLimits(60.0, 1 << 20))
    process.record(tmp_path / "a.mcap")
    running = asyncio.create_task(run_recorder(process))
    await asyncio.sleep(0)
    recorder.note({"why": "heard at once"})
    for _ in range(rounds):
        await asyncio.sleep(0)
    running.cancel()
    await asyncio.sleep(0)
    may_start.set()
    await asyncio.gather(running, return_exceptions=True)
    reader = RecordingReader(tmp_path / "a.mcap")
    assert [json.loads(one.data) for one in reader.messages()] == [{"why": "heard at once"}]
    assert reader.damage == ""


async def test_a_recorder_that_needs_long_for_its_end_is_told_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(recorder_process, "END_S", 0.01)
    process = RecorderProcess(Recorder(lambda: 1.0, lambda: BEGAN_NS), None, RingLimits(60.0, 1 << 20))
    process._command = [sys.executable, "-c", "import time; time.sleep(600)"]
    process.record(tmp_path / "a.mcap")
    await asyncio.to_thread(process.start)
    await asyncio.to_thread(process.close)
    assert process._process is not None
    assert process._process.poll() is None
    process._process.kill()
    process._process.wait()
    assert f"recording: this computer is busy: {tmp_path / 'a.mcap'} will be complete in a moment" in caplog.text


class Told(Recorder):
    """Has heard what it is told."""

    def __init__(self) -> None:
        super().__init__(lambda: 1.0, lambda: BEGAN_NS)
        self.told = b""

    def drain(self) -> bytes:
        told, self.told = self.told, b""
        return told


async def test_what_the_recorder_takes_at_once_needs_no_thread_and_what_it_does_not_take_comes_in_order(
    tmp_path: Path,
) -> None:
    told, may_read, kept = Told(), tmp_path / "may-read", tmp_path / "kept"
    process = RecorderProcess(told, None, RingLimits(60.0, 1 << 20))
    reader = """
import pathlib, sys, time
while not pathlib.Path(sys.argv[1]).exists():
    time.sleep(0.01)
pathlib.Path(sys.argv[2]).write_bytes(sys.stdin.buffer.read())
"""
    process._command = [sys.executable, "-c", reader, str(may_read), str(kept)]
    await asyncio.to_thread(process.start)
    said = [b"little", b"more", Random(1).randbytes(300_000), b"little again", b"the end"]
    waiting = []
    for octets in said:
        told.told = octets
        process.hand_over()
        with process._lock:
            waiting.append(process._waiting_octets > 0 or process._is_feeding)
    assert waiting[:2] == [False, False]
    assert all(waiting[2:])
    may_read.touch()
    await asyncio.to_thread(process.close)
    assert kept.read_bytes() == b"".join(said)


async def a_part_comes_and_goes(robot: DemoRobot, operations: InProcessOperations) -> None:
    await asyncio.sleep(3)
    robot.unplug("BB")
    await asyncio.sleep(8)
    await operations.do("stop", who="Ada", reason="a finger")
    await asyncio.sleep(1)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    record_demo(folder, folder / "a.mcap", a_part_comes_and_goes)
    return folder / "a.mcap"


def test_other_programs_decode_every_sample_to_what_the_parts_said(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [
            (channel.metadata.get("slot"), channel.metadata.get("port"), decoded)
            for _, channel, _, decoded in reader.iter_decoded_messages(topics=["/HelloWorldTopic_1_to_2"])
        ]
    assert found
    assert {slot for slot, _, _ in found} == {"AA"}
    assert [one.index for _, _, one in found] == list(range(1, len(found) + 1))
    assert all("turn-" in one.message for _, _, one in found)


class JsonDecoders(mcap.decoder.DecoderFactory):
    """What a foreign program does with JSON: its schema says that it is an object."""

    def decoder_for(self, encoding: str, schema: Schema | None) -> Callable[[bytes], object] | None:
        assert schema is not None
        return json.loads if (encoding, schema.encoding) == ("json", "jsonschema") else None


@pytest.mark.promise("Programs of others read every channel of a recording: mcap and rosbags, without MsBOT")
def test_programs_of_others_decode_every_channel(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory(), JsonDecoders()])
        found = [(channel.topic, decoded) for _, channel, _, decoded in reader.iter_decoded_messages()]
    assert len(found) == len(messages(recording))
    topics = {topic for topic, _ in found}
    request, reply = "/msbot_inventory_Request", "/msbot_inventory_Reply"
    assert {f"{request}/{name}" for name in ("Claim", "Beat", "ConfigurationRequest", "StoppedBeat")} <= topics
    assert {f"{reply}/{name}" for name in ("Verdict", "BeatReply", "Configuration", "Notice")} <= topics
    slots = {one.slot for topic, one in found if topic == f"{reply}/Configuration"}
    assert slots == {"AA", "BB", "CC"}
    types = get_typestore(Stores.EMPTY)
    for one in messages(recording):
        if one.is_ros and one.schema is not None:
            types.register(get_types_from_msg(one.schema.data.decode(), one.schema.name))
            assert types.deserialize_cdr(one.data, one.schema.name) is not None


def test_of_sealed_messages_of_the_inventory_the_content_is_recorded() -> None:
    recorder = Recorder(lambda: 0.0, lambda: BEGAN_NS)
    writer = recorder.space(MemorySpace()).writer(
        Topic("msbot_inventory_Request", "msbot_inventory_request"), Qos(service=True), bytes(16)
    )
    seal = Seal(bytes(32), is_part=True)
    writer.write(seal.seal(SHORT_SAYINGS, Beat(lease=7).encode()))
    writer.write(b"\1")
    items = list(Unpacker().feed(recorder.drain()))
    assert [octets for kind, *_, octets in items if kind == Kind.SAMPLE] == [Beat(lease=7).encode(), b"\1"]
    told = [RecordedChannel.decode(octets) for kind, *_, octets in items if kind == Kind.CHANNEL]
    assert [(one.topic, one.schema_name) for one in told] == [
        ("/msbot_inventory_Request/Beat", "msbot_msgs/msg/Beat"),
        ("/msbot_inventory_Request", ""),
    ]


def test_states_acts_and_stop_are_in_it_with_their_reasons(recording: Path) -> None:
    decoder = Decoder()
    lines = [f"{one.topic} {line_of(one, decoder)}" for one in messages(recording) if one.topic.startswith("/msbot/")]
    told = "\n".join(lines)
    assert "/msbot/events EFGH-local: active -> late in slot BB" in told
    assert "/msbot/events EFGH-local: late -> lost in slot BB" in told
    assert "/msbot/acts Ada: stop(reason=a finger)" in told
    assert "/msbot/stop STOP by Ada" in told
    assert "/msbot/slots AA: ABCD, " in told
    assert "out -> HelloWorldTopic_1_to_2" in told
    slots = [json.loads(one.data) for one in messages(recording) if one.topic == "/msbot/slots"]
    assert {slot["slot"] for slot in slots} == {"AA", "BB", "CC"}
    assert all(slot["ports"] for slot in slots)


def test_measurements_are_told_in_words() -> None:
    said = {"late_ms": 14.8, "latency_ms": None, "beats": {"AA": 0.99}, "ages": {"AA": 0.2}, "lives": {"BB": 1}}
    message = RecordedMessage(1, 1, Channel(1, MEASURED, "json", {}, 0), None, json.dumps(said).encode())
    assert line_of(message, Decoder()) == "late 14.8 ms, beats after: AA 0.99 s, life: BB 1"


def test_what_is_named_and_not_there_is_told(recording: Path, tmp_path: Path) -> None:
    def log(*words: str) -> tuple[int, str]:
        done = CliRunner().invoke(log_command, [words[0], str(recording), *words[1:]], catch_exceptions=False)
        return done.exit_code, done.stderr

    code, told = log("show", "--topic", "msbot/nosuch", "--slot", "XX")
    assert code == 1
    assert f"{recording} has no topic 'msbot/nosuch'; it has HelloWorldTopic_1_to_2, " in told
    assert "was said in a slot 'XX'; slots that said something: AA, BB, CC\n" in told
    assert log("show", "--topic", "msbot", "--slot", "AA") == (0, "")
    for words in (("show",), ("filter", str(tmp_path / "x.mcap")), ("export", str(tmp_path / "x.csv"))):
        with pytest.raises(ConfigError, match="nothing lies from 3 s to 2 s"):
            log(*words, "--from", "3", "--to", "2")
    assert list(tmp_path.iterdir()) == []


def test_a_piece_for_ros_2_is_read_by_its_own_programs_readers(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        await asyncio.sleep(6)
        await operations.do("stop", who="Ada", reason="a finger")

    whole, piece = tmp_path / "a.mcap", tmp_path / "ros.mcap"
    record_demo(tmp_path, whole, scene, ("knob", "fan"), "rover")
    words = ("filter", str(whole), str(piece), "--ros2")
    done = CliRunner().invoke(log_command, words, catch_exceptions=False)
    assert done.exit_code == 0
    (told,) = re.findall("left out, for they are no ROS 2 messages: (.*)", done.stdout)
    assert "/msbot/blueprint (1)" in told.split(", ")
    assert "/msbot/acts (1)" in told.split(", ")
    types = get_typestore(Stores.EMPTY)
    with Reader(piece) as reader:
        for connection in reader.connections:
            assert re.fullmatch("(/[A-Za-z_][A-Za-z0-9_]*)+", connection.topic)
            types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        read = [(one.topic, at, types.deserialize_cdr(data, one.msgtype)) for one, at, data in reader.messages()]
    ours = [one for one in messages(whole) if one.is_ros]
    assert [at for _, at, _ in read] == sorted(one.logged_ns for one in ours)
    decoder = Decoder()
    said = [one for one in ours if one.topic == "/fan_power"]
    assert len(said) > 10
    assert [{"percent": one.percent} for topic, _, one in read if topic == "/fan_power"] == [  # type: ignore[attr-defined]
        decoder.fields(one) for one in said
    ]
    frames = [one for topic, _, one in read if topic == "/msbot/frames/sim_500000"]
    assert len(frames) == sum(frame_of(one) is not None for one in ours)


def test_a_topic_that_ros_2_shares_is_recorded_as_ros_2_has_it(tmp_path: Path) -> None:
    async def scene(_robot: DemoRobot, _operations: InProcessOperations) -> None:
        await asyncio.sleep(6)

    whole, piece = tmp_path / "a.mcap", tmp_path / "ros.mcap"
    shared = {
        "fan_power": "ros = true",
        "loudness": 'ros = true\nros_topic = "/loud"\nros_type = "sensor_msgs/msg/Temperature"\n'
        'ros_fields = { percent = "temperature * 2" }',
    }
    record_demo(tmp_path, whole, scene, ("knob", "fan", "ear", "hand"), "rover", shared=shared)
    done = CliRunner().invoke(log_command, ["filter", str(whole), str(piece), "--ros2"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    types, robot = get_typestore(Stores.ROS2_JAZZY), "/ROVER"
    with Reader(piece) as reader:
        found = {one.topic: one.msgtype for one in reader.connections}
        assert len(found) == len(reader.connections), "a topic is one channel"
        assert found[f"{robot}/fan_power"] == "std_msgs/msg/Float32"
        assert found["/loud"] == "sensor_msgs/msg/Temperature"
        assert not {"/fan_power", "/loudness"} & set(found)
        # With the definitions that ROS 2 itself has, as a program with its messages installed reads it.
        known = [one for one in reader.connections if one.msgtype in types.types]
        read = [(one.topic, at, types.deserialize_cdr(data, one.msgtype)) for one, at, data in reader.messages(known)]
    decoder = Decoder()
    said = [
        (one.logged_ns, (decoder.fields(one) or {})["percent"]) for one in messages(whole) if one.topic == "/fan_power"
    ]
    assert len(said) > 10
    theirs = [(at, one.data) for topic, at, one in read if topic == f"{robot}/fan_power"]  # type: ignore[attr-defined]
    assert theirs == said
    loud = [one for topic, _, one in read if topic == "/loud"]
    assert {type(one).__name__ for one in loud} == {"sensor_msgs__msg__Temperature"}
    heard = [one for one in messages(whole) if one.topic == "/loudness"]
    assert [(one.header.stamp.sec, one.header.stamp.nanosec, one.temperature) for one in loud] == [  # type: ignore[attr-defined]
        (*divmod(one.at_ns, NS), 2.0 * (decoder.fields(one) or {})["percent"])  # type: ignore[operator]
        for one in heard
    ]


def test_topics_of_one_name_in_ros_2_stay_apart_and_what_was_asked_for_and_left_out_is_told(tmp_path: Path) -> None:
    schema = ("msbot_msgs/msg/Level", ENCODING, ros_definition(Level))
    items = []
    for number, topic in enumerate(("/a-b", "/a b", "/2nd/a-b"), 1):
        items += [
            (int(Kind.CHANNEL), number, 0, RecordedChannel(topic, "cdr", *schema).encode()),
            (int(Kind.SAMPLE), number, BEGAN_NS + number, Level(percent=number).encode()),
        ]
    items += [
        (int(Kind.CHANNEL), 9, 0, RecordedChannel("/t", "json").encode()),
        (int(Kind.OBJECT), 9, BEGAN_NS, encode_object({})),
    ]
    store(items, tmp_path / "a.mcap")
    words = ("filter", str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap"), "--ros2")
    assert "2 messages\n" in CliRunner().invoke(log_command, [*words, "--topic", "a-b", "--topic", "a b"]).stdout
    assert {one.topic for one in messages(tmp_path / "b.mcap")} == {"/a_b", "/a_b_2"}
    (tmp_path / "b.mcap").unlink()
    done = CliRunner().invoke(log_command, [*words, "--topic", "t", "--topic", "2nd"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "1 message\nleft out, for they are no ROS 2 messages: /t (1)\n" in done.stdout
    assert [one.topic for one in messages(tmp_path / "b.mcap")] == ["/_2nd/a_b"]


def test_times_are_those_of_the_robot(recording: Path) -> None:
    found = messages(recording)
    assert all(BEGAN_NS <= one.at_ns <= BEGAN_NS + 15 * NS for one in found)
    lost = next(one for one in found if one.topic == "/msbot/events" and json.loads(one.data)["to"] == "lost")
    assert 3 + 4 <= (lost.at_ns - BEGAN_NS) / NS <= 3 + 6.1


def test_can_frames_are_the_ones_that_were_on_the_bus(tmp_path: Path) -> None:
    seen = []

    async def scene(robot: DemoRobot, _: InProcessOperations) -> None:
        robot.on_frame(lambda _at, _sender, frame: seen.append((frame.can_id, frame.data)))
        await asyncio.sleep(2)

    record_demo(tmp_path, tmp_path / "a.mcap", scene)
    frames = [frame_of(one) for one in messages(tmp_path / "a.mcap") if one.topic.startswith("/msbot/frames/")]
    recorded = [(frame.can_id, frame.data) for frame in frames if frame is not None]
    assert len(recorded) == len(frames) > 100
    assert sorted(recorded)[:50] != []
    assert len(set(seen) - set(recorded)) == 0


class TappedLink(CanMasterLink):
    """A CAN link without a bus."""

    def __init__(self) -> None:
        self.info = LinkInfo("bus", 512, bits_per_second=500_000)

    @property
    def bus_info(self) -> CanBusInfo:
        return CanBusInfo("bus", 500_000)

    def on_frame(self, tap: FrameTap) -> None:
        self.heard_by = tap


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    """Frames of any kind, also such that no controller would send."""
    flag = st.booleans()
    fd, remote = draw(flag), draw(flag)
    return Frame(
        draw(st.integers(0, 0x1FFFFFFF)),
        draw(st.binary(max_size=64 if fd else 8)),
        extended=draw(flag),
        fd=fd,
        brs=fd and draw(flag),
        remote=remote,
        error=draw(flag),
        esi=fd and draw(flag),
        remote_length=draw(st.integers(0, 8)) if remote else 0,
        long_dlc=draw(st.sampled_from([0, 0, 9, 15])),
    )


@given(frames(), st.sampled_from(["here", "node 3"]))
def test_any_frame_is_recorded_with_all_that_it_says(frame: Frame, sender: str) -> None:
    recorder, link = Recorder(lambda: 0.0, lambda: BEGAN_NS), TappedLink()
    recorder.watch_links([link])
    link.heard_by(1.5, sender, frame)
    (content,) = [octets for kind, _, at, octets in Unpacker().feed(recorder.drain()) if kind == Kind.SAMPLE]
    *fixed, size = FRAME.unpack(content[: FRAME.size])
    said = [frame.can_id, frame.extended, frame.fd, frame.brs, frame.esi, frame.remote, frame.error, sender == "here"]
    assert fixed == [*said, frame.remote_length or frame.long_dlc]
    assert content[FRAME.size :] == frame.data
    assert size == len(frame.data)


def test_what_was_drained_does_not_come_again_and_much_of_it_is_forgotten() -> None:
    recorder = Recorder(lambda: 2.0, lambda: BEGAN_NS)
    writer = recorder.space(MemorySpace()).writer(Topic("strange", "Unheard"), Qos(), bytes(16))
    unpacker = Unpacker()

    def heard() -> list[bytes]:
        return [octets for kind, _, _, octets in unpacker.feed(recorder.drain()) if kind == Kind.SAMPLE]

    for payload in (b"1", b"", bytes(1 << 20), b"after"):
        writer.write(payload)
    assert heard() == [b"1", b"", bytes(1 << 20), b"after"]
    for _ in range(8):
        writer.write(bytes(1 << 20))
    assert len(heard()) == 8
    writer.write(b"new")
    assert heard() == [b"new"]
    assert recorder.drain() == b""


def test_the_same_run_gives_the_same_recording(tmp_path: Path, recording: Path) -> None:
    (tmp_path / "again").mkdir()
    record_demo(tmp_path / "again", tmp_path / "b.mcap", a_part_comes_and_goes)
    first, second = messages(recording), messages(tmp_path / "b.mcap")
    assert [(one.topic, one.at_ns, one.data) for one in first] == [(one.topic, one.at_ns, one.data) for one in second]


def test_differences_name_what_happened_in_one_run_only(tmp_path: Path, recording: Path) -> None:
    async def nothing(_: DemoRobot, __: InProcessOperations) -> None:
        await asyncio.sleep(12)

    record_demo(tmp_path, tmp_path / "b.mcap", nothing)
    reader = RecordingReader(tmp_path / "b.mcap")
    lines = differences(RecordingReader(recording).messages(), reader.messages())
    assert any(line.startswith("- EFGH-local: active -> late") for line in lines)
    assert any(line.startswith("- Ada: stop") for line in lines)
    assert not any(line.startswith("+ ") and "lost" in line for line in lines)
    assert differences(RecordingReader(recording).messages(), RecordingReader(recording).messages()) == []


def test_an_unknown_type_is_recorded_without_a_schema_and_ros_types_with_theirs() -> None:
    recorder = Recorder(lambda: 1.0, lambda: BEGAN_NS)
    space = recorder.space(MemorySpace(clock=lambda: 1.0))
    space.writer(Topic("strange", "Unheard"), Qos(), bytes(16)).write(b"\x01")
    space.writer(Topic("rt/range", "sensor_msgs::msg::dds_::Range_"), Qos(), bytes(16)).write(bytes(40))
    octets = recorder.drain()
    assert b'"/strange", "cdr", "", ""' in octets
    assert b'"/range", "cdr", "sensor_msgs/msg/Range", "ros2msg"' in octets
    assert recorder.drain() == b""


def test_a_channel_survives_its_octets() -> None:
    one = RecordedChannel("/a", "cdr", "p/msg/B", "ros2msg", "uint8 x", (("slot", "ä"),))
    assert RecordedChannel.decode(one.encode()) == one


def test_a_type_that_the_library_learns_while_it_records_has_its_schema() -> None:
    library = load_library()
    recorder = Recorder(lambda: 0.0, lambda: BEGAN_NS, library)
    space = recorder.space(MemorySpace())
    described = """
number = "VANE-1"
name = "Vane"
[[port]]
name = "wind"
direction = "publish"
type = "Wind"
[[type]]
name = "Wind"
fields = { speed = "float32" }
"""
    found = read_description(described, "VANE-1", library)
    library.become(library.with_type(found.part_type, found.messages))
    writer = space.writer(Topic("wind", "Wind"), Qos(), bytes(16))
    writer.write(bytes(4))
    assert b"float32 speed" in recorder.drain()
