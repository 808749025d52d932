"""The recorder's ears in the robot's process: samples, frames, states, acts. Nothing here writes a file.

What is heard is packed at once into one buffer, which is used again and again: nothing has to be kept alive, the
garbage collector has nothing to do, and the memory stays in the processor's cache.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from itertools import count
from typing import Final, Protocol

from msbot.config import Blueprint, InDds, Library
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations, Operations, PerformedOperation
from msbot.operations.message_classes import MessageClasses
from msbot.part import Message
from msbot.part.calls import ReplyStatus, sentence_of
from msbot.part.join.pnp_messages import INVENTORY_REPLY_TOPIC, INVENTORY_REQUEST_TOPIC
from msbot.part.join.seal import SEAL_OCTETS
from msbot.part.messages.ros_names import ros_name
from msbot.part.messages.wire_types import uint8
from msbot.pnp import Configuration, PartEvent, PartInfo, PartState
from msbot.pnp.emergency_stop import StopStatus
from msbot.pnp.session_seals import ObservedSeals
from msbot.recording.recorder.batch import (
    BITRATE,
    BLUEPRINT,
    DATA_BITRATE,
    MEASURED,
    SHOWN,
    SLOTS,
    Kind,
    RecordedChannel,
    encode_began,
    encode_object,
    encode_state,
    head,
)
from msbot.recording.recorder.measurements import Measured
from msbot.recording.recorder.schemas import (
    ENCODING,
    FRAME_DEFINITION,
    FRAME_OCTETS,
    FRAME_TYPE,
    PLAIN_FRAMES,
    SENT,
    blueprint_words,
    event_words,
    frame_octets,
    ros_definition,
    ros_metadata,
    shown_words,
    topics_in_ros,
)
from msbot.service_types import reply_topic, service_type
from msbot_agent.agent import client_key_of
from msbot_agent.link import Link, bound_name
from msbot_agent.link.can import CanBusInfo, CanEnd
from msbot_agent.link.can.protocol import Frame
from msbot_agent.space import THIS_PROGRAM, Deliver, Guid, Owner, Qos, Reader, Space, Topic, Writer
from msbot_xrce.errors import RemoteProtocolError

MOST_CHANNELS: Final = 4_000
SAMPLE: Final = int(Kind.SAMPLE)
LARGEST_BUFFER: Final = 4 << 20
"""Octets that the buffer keeps for the next time."""
STOP: Final = "stop"
"""The operation whose answer waits for nothing that can be done later."""


class Recorder:
    """Listens to one robot; `drain` gives what was heard.

    All of it belongs to the robot's event loop; no other thread may call it.

    Args:
        clock: seconds, the robot's own; asked for every sample.
        epoch_ns: nanoseconds since 1970.
        library: says what the message types mean, also those that it learns later; None: no schemas but for MsBOT's
            own messages.
    """

    def __init__(self, clock: Callable[[], float], epoch_ns: Callable[[], int], library: Library | None = None) -> None:
        self.clock = clock
        self._began_ns = epoch_ns() - round(clock() * 1e9)
        self._class_of = MessageClasses(lambda: library)
        self._heard = BytesIO()
        self.write: Callable[[bytes], int] = self._heard.write
        """Takes records, or the head of one and then its content."""
        self.put(Kind.BEGAN, 0, 0.0, encode_began(self._began_ns))
        self._numbers: dict[RecordedChannel, int] = {}
        self._next = count(1)
        self._master: Master | None = None
        self._operations: InProcessOperations | None = None
        self._blueprint: Blueprint | None = None
        """As it was recorded last."""
        self._shown: Mapping[str, object] = {}
        self._stop = StopStatus()
        self._told: dict[str, tuple[int, str, str]] = {}
        """Slot -> version of the configuration that was recorded last, and the nature of its part."""
        self._tapped: set[Link] = set()
        self._in_ros: dict[str, tuple[str, InDds]] = {}
        """Topic -> its name in ROS 2, and what its binding says about ROS 2."""

    # For the one who hands over to the recorder's process.

    def drain(self) -> bytes:
        """Everything heard since the last call, packed."""
        heard = self._heard
        size = heard.tell()
        if not size:
            return b""
        with heard.getbuffer() as octets:
            drained = bytes(octets[:size])
        heard.seek(0)
        if size > LARGEST_BUFFER:
            heard.truncate()
        return drained

    def put(self, kind: Kind, channel: int, at: float, content: bytes) -> None:
        """A record, at this time of the robot's clock."""
        self.write(head(kind, channel, at, len(content)) + content)

    def say_again(self) -> None:
        """Repeat what a new recorder's process must know; called in the robot's event loop."""
        self.put(Kind.BEGAN, 0, 0.0, encode_began(self._began_ns))
        for channel, number in self._numbers.items():
            self.put(Kind.CHANNEL, number, self.clock(), channel.encode())
        self._told.clear()
        if self._master is not None:
            self._say_all(self._master)

    # What is listened to.

    def space(self, inner: Space) -> Space:
        """The same space, with every sample that is written in it from this process recorded."""
        return _RecordedSpace(inner, self)

    def watch(self, master: Master, operations: Operations) -> None:
        """Record the states of a robot's parts, STOP, what people do, and the frames of its CAN links."""
        self._master = master
        self._in_ros = topics_in_ros(master.blueprint)
        master.inventory.on_event(self._part_changed)
        master.on_stop(self._stopped)
        operations.on_done(self._done)
        if isinstance(operations, InProcessOperations):
            self._operations = operations
            operations.faults.on_change(self._fault_changed)
            operations.missions.on_note(self._mission_noted)
        self._say_all(master)
        self.watch_links(master.links)

    def watch_links(self, links: Iterable[Link]) -> None:
        """Record the frames of those that are CAN links."""
        for link in links:
            if isinstance(link, CanEnd) and link not in self._tapped:
                self._tapped.add(link)
                link.on_frame(self._frame_tap(link.info.name, link.bus_info))

    def note(self, words: Mapping[str, object]) -> None:
        """Something that the recorder itself has to say."""
        self.put(Kind.OBJECT, self._json_channel("/msbot/recorder"), self.clock(), encode_object(words))

    def measured(self, found: Measured, infos: Sequence[PartInfo]) -> None:
        """How the robot is at this moment; to be called about once a second.

        Args:
            found: what was measured since the last time.
            infos: its parts.
        """
        now = self.clock()
        value = {
            "late_ms": round(found.late_ms, 3),
            "latency_ms": None if found.latency_ms is None else round(found.latency_ms, 3),
            "beats": {slot: round(seconds, 4) for slot, _, seconds in found.beats},
            "ages": {slot: round(now - at, 3) for slot, at, _ in found.beats},
            "acks_ms": {slot: round(ms, 3) for slot, ms in found.acks_ms},
            "lives": {info.slot: info.life for info in infos if info.slot and info.state is PartState.LATE},
        }
        self.put(Kind.OBJECT, self._json_channel(MEASURED), now, encode_object(value))
        self._look(infos)

    def start(self, path: str, *, as_bag: bool = False) -> None:
        """Record in one more file from now on.

        Args:
            path: the file.
            as_bag: what ROS 2 can read, as a bag.
        """
        self.put(Kind.START_BAG if as_bag else Kind.START, 0, self.clock(), path.encode())

    def stop(self) -> None:
        """End that file."""
        self.put(Kind.STOP, 0, self.clock(), b"")

    def channel_of(self, topic: Topic, guid: Guid, *, is_service: bool) -> int | None:
        """The channel of a writer; None: there are too many."""
        metadata = {"topic": topic.name, "type": topic.type_name}
        held = None if self._master is None else self._master.inventory.configuration_of(client_key_of(guid))
        if held is not None:
            metadata["slot"] = held.slot
            port = next((one.port for one in held.bindings if one.topic == topic.name and one.publishes), None)
            if port is not None:
                metadata["port"] = port
        cls = self._class_of(topic.type_name)
        if cls is not None and not is_service and topic.name in self._in_ros:
            metadata |= ros_metadata(self._in_ros[topic.name], cls)
        name = "/" + topic.name.removeprefix("rt/").lstrip("/")
        schema = ("", "", "") if cls is None else (ros_name(topic.type_name), ENCODING, ros_definition(cls))
        return self._number(RecordedChannel(name, "cdr", *schema, metadata=tuple(metadata.items())))

    def inventory_channel(self, topic: Topic, message: type[Message] | None) -> int | None:
        """The channel of one of the inventory's messages, of whichever part; None: there are too many.

        Args:
            topic: the half of the service that it travels on.
            message: None: octets that are none of them.
        """
        metadata = (("topic", topic.name), ("type", topic.type_name))
        if message is None:
            return self._number(RecordedChannel(f"/{topic.name}", "cdr", metadata=metadata))
        schema = (ros_name(message.type_name), ENCODING, ros_definition(message))
        return self._number(RecordedChannel(f"/{topic.name}/{message.type_name}", "cdr", *schema, metadata=metadata))

    def reply_channels(self, topic: Topic, guid: Guid) -> tuple[int | None, int | None] | None:
        """The channels of a part's replies, and of what it says in place of one; None: these are no replies of a part.

        A reply begins with its status (`msbot.part.calls`); behind it is the message, or a sentence.
        """
        if self._master is None:
            return None
        blueprint = self._master.blueprint if self._operations is None else self._operations.blueprint
        services = (one.topic for one in blueprint.bindings if service_type(one.type_name) is not None)
        if topic.name not in map(reply_topic, services):
            return None
        held = self._master.inventory.configuration_of(client_key_of(guid))
        metadata = (("topic", topic.name), ("type", topic.type_name), *((("slot", held.slot),) if held else ()))
        cls = self._class_of(topic.type_name)
        schema = ("", "", "") if cls is None else (ros_name(topic.type_name), ENCODING, ros_definition(cls))
        instead = (ros_name(NoReply.type_name), ENCODING, ros_definition(NoReply))
        return (
            self._number(RecordedChannel(f"/{topic.name}", "cdr", *schema, metadata=metadata)),
            self._number(RecordedChannel(f"/{topic.name}/NoReply", "cdr", *instead, metadata=metadata)),
        )

    def new_seals(self) -> ObservedSeals:
        """Who tells a message to or from the inventory from the seal behind it."""
        authentication = None if self._master is None else self._master.blueprint.options.authentication
        return ObservedSeals(sealed=authentication == "key+data")

    def _number(self, channel: RecordedChannel) -> int | None:
        number = self._numbers.get(channel)
        if number is None and len(self._numbers) < MOST_CHANNELS:
            number = self._numbers[channel] = next(self._next)
            self.put(Kind.CHANNEL, number, self.clock(), channel.encode())
        return number

    def _json_channel(self, topic: str) -> int:
        channel = RecordedChannel(topic, "json", topic.removeprefix("/"), "jsonschema", '{"type": "object"}')
        number = self._number(channel)
        assert number is not None, "MsBOT's own channels come first"
        return number

    # What is heard.

    def _say_all(self, master: Master) -> None:
        for topic in (
            "/msbot/robot",
            SLOTS,
            "/msbot/events",
            "/msbot/acts",
            "/msbot/stop",
            "/msbot/recorder",
            "/msbot/faults",
            BLUEPRINT,
            SHOWN,
            "/msbot/mission",
            MEASURED,
        ):
            self._json_channel(topic)
        self._state("/msbot/robot", "robot", dataclasses.asdict(master.profile))
        self._stopped(master.stop)
        self._blueprint, self._shown = None, {}
        self._look(master.inventory.view(self.clock()))

    def _look(self, infos: Sequence[PartInfo]) -> None:
        """Record what has changed and nobody tells: wires and slots, what is in a slot, what people do by hand."""
        if self._master is None:
            return
        if self._master.stop != self._stop:  # somebody has confirmed it
            self._stopped(self._master.stop)
        blueprint = self._master.blueprint if self._operations is None else self._operations.blueprint
        if blueprint is not self._blueprint:
            self._blueprint = blueprint
            links = [bound_name(link) for link in self._master.links]
            self._state(BLUEPRINT, "blueprint", blueprint_words(blueprint, links))
        for info in infos:
            if info.slot is not None and info.state.is_registered:
                held = self._master.inventory.configuration_of(info.client_key)
                self._slot(held, info.part_number, info.local_name, info.nature.label)
        if self._operations is not None:
            shown = shown_words(
                self._operations.by_hand.sent_values(), self._operations.faults.visible_faults, blueprint
            )
            if shown != self._shown:
                self._shown = shown
                self._state(SHOWN, "shown", shown)

    def _state(self, topic: str, key: str, value: object) -> None:
        self.put(Kind.STATE, self._json_channel(topic), self.clock(), encode_state(key, value))

    def _part_changed(self, event: PartEvent) -> None:
        key = event.identity.hex() or f"{event.client_key:08x}"
        self.put(Kind.STATE, self._json_channel("/msbot/events"), event.at, encode_state(key, event_words(event)))
        if event.to_state is PartState.ACTIVE and self._master is not None:
            held = self._master.inventory.configuration_of(event.client_key)
            self._slot(held, event.part_number, event.local_name)

    def _slot(self, held: Configuration | None, number: str, local_name: str, nature: str = "") -> None:
        if held is None or self._told.get(held.slot) == (held.version, local_name, nature):
            return
        self._told[held.slot] = (held.version, local_name, nature)
        ports = [
            {"port": one.port, "topic": one.topic, "type": one.type_name, "publishes": one.publishes}
            for one in held.bindings
        ]
        value = {
            "slot": held.slot,
            "part_number": number,
            "local_name": local_name,
            "ports": ports,
            "settings": dict(held.settings),
            "nature": nature,
        }
        self._state(SLOTS, held.slot, value)

    def _stopped(self, status: StopStatus) -> None:
        self._stop = status
        self._state("/msbot/stop", "stop", dataclasses.asdict(status))

    def _done(self, deed: PerformedOperation) -> None:
        value = {"who": deed.who, "operation": deed.operation, "arguments": dict(deed.arguments), "words": deed.words}
        self.put(Kind.OBJECT, self._json_channel("/msbot/acts"), self.clock(), encode_object(value))
        if self._master is not None and deed.operation != STOP:  # the look of every second comes soon
            self._look(self._master.inventory.view(self.clock()))

    def _fault_changed(self, change: Mapping[str, object]) -> None:
        self.put(Kind.OBJECT, self._json_channel("/msbot/faults"), self.clock(), encode_object(change))

    def _mission_noted(self, note: Mapping[str, object]) -> None:
        self.put(Kind.OBJECT, self._json_channel("/msbot/mission"), self.clock(), encode_object(note))

    def _frame_tap(self, link: str, bus: CanBusInfo) -> Callable[[float, str, Frame], None]:
        rates = {BITRATE: bus.bits_per_second, DATA_BITRATE: bus.data_bits_per_second}
        metadata = tuple((name, str(rate)) for name, rate in rates.items() if rate is not None)
        channel = RecordedChannel(f"/msbot/frames/{link}", "cdr", FRAME_TYPE, ENCODING, FRAME_DEFINITION, metadata)
        number, write = self._number(channel), self.write
        assert number is not None, "MsBOT's own channels come first"

        def tap(at: float, sender: str, frame: Frame) -> None:
            if frame.extended or frame.fd or frame.remote or frame.error or frame.long_dlc:
                octets = frame_octets(frame, is_sent=sender == "here")
                write(head(SAMPLE, number, at, len(octets)) + octets)
                return
            data = frame.data  # nearly every frame is a plain one: one call packs the record with its head
            size = len(data)
            write(
                PLAIN_FRAMES[size](
                    SAMPLE, number, at, FRAME_OCTETS + size, frame.can_id, SENT if sender == "here" else 0, size, data
                )
            )

        return tap


class _Write(Protocol):
    """`Writer.write`."""

    def __call__(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int: ...


class _RecordedSpace:
    """Satisfies `Space`: another space, whose writers are overheard."""

    def __init__(self, inner: Space, recorder: Recorder) -> None:
        self.words = inner.words
        self._inner = inner
        self._recorder = recorder

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> Writer:
        """See `Space.writer`."""
        inner = self._inner.writer(topic, qos, guid, owner)
        if qos.service and topic.name in (INVENTORY_REQUEST_TOPIC, INVENTORY_REPLY_TOPIC):
            return _RecordedWriter(inner, _inventory_write(inner, self._recorder))
        replies = self._recorder.reply_channels(topic, guid) if qos.service else None
        if replies is not None:
            return _RecordedWriter(inner, _reply_write(inner, self._recorder, *replies))
        number = self._recorder.channel_of(topic, guid, is_service=qos.service)
        if number is None:
            return inner
        write = _recorded_write(inner.write, number, self._recorder.write, self._recorder.clock)
        return _RecordedWriter(inner, write)

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver, owner: Owner = THIS_PROGRAM) -> Reader:
        """See `Space.reader`."""
        return self._inner.reader(topic, qos, deliver, owner)


class _RecordedWriter:
    """Satisfies `Writer`; made by `_RecordedSpace.writer`."""

    __slots__ = ("_inner", "close", "guid", "topic", "troubles", "write")

    def __init__(self, inner: Writer, write: _Write) -> None:
        self._inner = inner
        self.guid = inner.guid
        self.topic = inner.topic
        self.close = inner.close
        self.troubles = inner.troubles
        self.write = write

    @property
    def published(self) -> int:
        """See `Writer.published`."""
        return self._inner.published

    @property
    def readers(self) -> int | None:
        """See `Writer.readers`."""
        return self._inner.readers


def _recorded_write(inner: _Write, number: int, record: Callable[[bytes], int], clock: Callable[[], float]) -> _Write:
    """`Writer.write` with a record of each sample; a closure, because this is the path of every sample."""

    def write(payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        record(head(SAMPLE, number, clock(), len(payload)))
        record(payload)
        return inner(payload, related)

    return write


class NoReply(Message):
    """What a part says in place of a reply."""

    status: uint8
    """Why, as `msbot.part.calls.ReplyStatus`."""
    words: str


def _reply_write(inner: Writer, recorder: Recorder, reply: int | None, instead: int | None) -> _Write:
    """`Writer.write` of a part that serves: the message of a reply, or the sentence in place of one."""

    def write(payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        number, content = reply, payload[1:]
        if payload[:1] != bytes((ReplyStatus.DONE,)):
            words = sentence_of(content)
            number, content = instead, NoReply(status=payload[0] if payload else 0, words=words).encode()
        if number is not None:
            recorder.write(head(SAMPLE, number, recorder.clock(), len(content)) + content)
        return inner.write(payload, related)

    return write


def _inventory_write(inner: Writer, recorder: Recorder) -> _Write:
    """`Writer.write` of the inventory's service: its messages have a channel each, so that every reader knows them.

    What is none of them is recorded as octets without a meaning.
    """
    seals: ObservedSeals | None = None
    channels: dict[type[Message] | None, int | None] = {}
    is_request = inner.topic.name == INVENTORY_REQUEST_TOPIC

    def write(payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        nonlocal seals
        seals = recorder.new_seals() if seals is None else seals
        message: Message | None = None
        content = payload
        with contextlib.suppress(RemoteProtocolError):
            message, seal = seals.request(payload) if is_request else seals.reply(payload)
            content = payload if seal is None else payload[:-SEAL_OCTETS]
        kind = None if message is None else type(message)
        if kind not in channels:
            channels[kind] = recorder.inventory_channel(inner.topic, kind)
        if (number := channels[kind]) is not None:
            recorder.write(head(SAMPLE, number, recorder.clock(), len(content)) + content)
        return inner.write(payload, related)

    return write
