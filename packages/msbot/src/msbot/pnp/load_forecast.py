"""How busy a robot at work will keep a CAN bus: from its blueprint, without running it. Pure.

Every message that a robot sends periodically is encoded as it will be, many times with different numbers in it, cut
into frames and counted bit by bit. What happens only occasionally is left out: joining, set-up, losses, events. So is
the profile: a part on a bus reads it once, and the BEACON shows when it has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from random import Random
from typing import Final

from msbot.config import Binding, Blueprint, Library, PartType
from msbot.part import HelloWorld
from msbot.part.join.pnp_messages import Beat, BeatReply
from msbot.part.join.seal import Seal
from msbot.part.sample_parts import SAMPLE_PARTS
from msbot.pnp.profile import Profile
from msbot.service_types import service_type
from msbot_agent.link.can.protocol import BEACONS_HZ, Cost, Framing, beacon_cost, message_cost
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import (
    FIRST_REQUEST,
    SESSION_DEFAULT,
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    Acknack,
    Data,
    Header,
    ObjectKind,
    WriteData,
    encode_message,
    make_object_id,
    read_request_id,
    write_request_id,
)

WRITTEN: Final = 32
"""How often each message is encoded; its cost is the mean."""
NUMBERS: Final = 1024
"""How many sequence numbers the messages are spread over: the first quarter of an hour at one message a second."""
UNKNOWN_BYTES: Final = 8
"""Assumed size of a sample whose type is not known."""

BEACON: Final = "BEACON"
BEATS: Final = "beats"

_REQUESTER: Final = make_object_id(1, ObjectKind.REQUESTER)
_FIRST_DATA_READER: Final = 2
_SAYS: Final = {sample.part_number: sample.says for sample in SAMPLE_PARTS.values()}


@dataclass(frozen=True, slots=True)
class Flow:
    """Messages of one kind between one part and the master."""

    group: str
    """The group that it belongs to: `BEACON`, `beats`, or a topic."""
    what: str
    """The kind in words."""
    slot: str
    """The part's slot; empty: for all of them."""
    rate_hz: float
    cost: Cost
    """The cost of one message."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """All flows of a robot, and the assumptions made for them."""

    flows: tuple[Flow, ...]
    assumed: Mapping[str, int]
    """Bytes of a sample by type name, where the type is not known."""
    on_event: tuple[str, ...]
    """Topics whose publishing port has no rate: they are not in the forecast."""

    def load(self, bitrate: float, data_bitrate: float | None = None) -> float:
        """Share of the time that the bus is busy, 1 = always; a larger load does not fit the bus."""
        return sum(flow.rate_hz * flow.cost.seconds(bitrate, data_bitrate) for flow in self.flows)


def forecast(
    blueprint: Blueprint, library: Library, framing: Framing, *, sizes: Mapping[str, int] | None = None
) -> Forecast:
    """What a robot with a part in every slot sends in a second.

    Args:
        blueprint: the robot.
        library: its part types; the rates of their publishing ports say how often they send.
        framing: the bus.
        sizes: bytes of a sample by type name; by default those of the library, which knows all types but texts.
    """
    robot = blueprint.robot
    profile = Profile(robot.name, robot.version, robot.serial_number, robot.released, robot.manufacturer)
    sealed = blueprint.options.authentication == "key+data"
    scribes = {
        slot.name: _MessageEncoder(slot.name, node, framing, sealed=sealed)
        for node, slot in enumerate(blueprint.slots, 1)
    }
    flows = [Flow(BEACON, "the master is here", "", BEACONS_HZ, beacon_cost(profile.profile_hash(), framing))]
    for scribe in scribes.values():
        flows += scribe.beats(1 / blueprint.timing.beat_period_s)
    known = {name: size for name, message in library.messages.items() if (size := message.size_bytes) is not None}
    samples = _Samples(known | dict(sizes or {}))
    on_event = []
    for binding in blueprint.bindings:
        if service_type(binding.type_name) is not None:
            on_event.append(binding.topic)
            continue
        part_type = _part_type(blueprint, library, binding)
        port = None if part_type is None else part_type.port(binding.source.port)
        rate_hz = 0.0 if port is None else port.rate_hz
        # Even a port that is left out has its object ids.
        bound = _bound(binding, scribes, rate_hz, samples.of(binding, part_type))
        if rate_hz:
            flows += bound
        else:
            on_event.append(binding.topic)
    return Forecast(tuple(flows), samples.assumed, tuple(on_event))


class _MessageEncoder:
    """Encodes what one part and the master say to each other, as they would."""

    def __init__(self, slot: str, node: int, framing: Framing, *, sealed: bool) -> None:
        self._slot = slot
        self._node = node
        self._framing = framing
        self._seal = Seal(node.to_bytes(32, "big"), is_part=True) if sealed else None
        self._by_rule = framing.compress is not None
        self._random = Random(node)
        self._writers = 0
        self._readers = _FIRST_DATA_READER - 1

    def beats(self, rate_hz: float) -> list[Flow]:
        """Beats and their answers."""
        lease = self._random.getrandbits(32)
        related = [self._write_id(STREAM_BEST_EFFORT, number).to_bytes(2, "big") for number in _numbers()]
        answers = [ids + _REQUESTER.to_bytes(2, "big") + BeatReply(configuration_version=1).encode() for ids in related]
        beats = self._writes(_REQUESTER, STREAM_BEST_EFFORT, lambda _: Beat(lease=lease).encode())
        return [
            self._flow(BEATS, "beat", rate_hz, beats, up=True),
            self._flow(BEATS, "answer", rate_hz, self._datas(_REQUESTER, STREAM_BEST_EFFORT, answers), up=False),
        ]

    def publishes(self, topic: str, rate_hz: float, *, reliable: bool, payload: Callable[[int], bytes]) -> list[Flow]:
        """Samples of the part's next port that publishes."""
        self._writers += 1
        writer = make_object_id(self._writers, ObjectKind.DATAWRITER)
        stream_id = STREAM_RELIABLE if reliable else STREAM_BEST_EFFORT
        flow = self._flow(topic, "sample", rate_hz, self._writes(writer, stream_id, payload), up=True)
        return [flow, *self._acknowledged(topic, rate_hz, reliable=reliable, up=False)]

    def subscribes(self, topic: str, rate_hz: float, *, reliable: bool, payload: Callable[[int], bytes]) -> list[Flow]:
        """Samples for the part's next port that subscribes."""
        self._readers += 1
        reader = make_object_id(self._readers, ObjectKind.DATAREADER)
        stream_id = STREAM_RELIABLE if reliable else STREAM_BEST_EFFORT
        datas = self._datas(reader, stream_id, [payload(number) for number in _numbers()])
        flow = self._flow(topic, "delivery", rate_hz, datas, up=False)
        return [flow, *self._acknowledged(topic, rate_hz, reliable=reliable, up=True)]

    def _acknowledged(self, topic: str, rate_hz: float, *, reliable: bool, up: bool) -> list[Flow]:
        return [self._flow(topic, "acknowledgement", rate_hz, _acknacks(), up=up)] if reliable else []

    def _flow(self, group: str, what: str, rate_hz: float, packets: list[bytes], *, up: bool) -> Flow:
        return Flow(group, what, self._slot, rate_hz, message_cost(packets, self._node, self._framing, up=up))

    def _writes(self, object_id: int, stream_id: int, payload: Callable[[int], bytes]) -> list[bytes]:
        return [
            encode_message(
                Header(SESSION_DEFAULT, stream_id, number),
                [WriteData(self._write_id(stream_id, number), object_id, self._sealed(object_id, payload(number)))],
                pad_end=True,
            )
            for number in _numbers()
        ]

    def _datas(self, object_id: int, stream_id: int, payloads: list[bytes]) -> list[bytes]:
        request_id = read_request_id(object_id) if self._by_rule else FIRST_REQUEST + object_id
        return [
            encode_message(
                Header(SESSION_DEFAULT, stream_id, number),
                [Data(request_id, object_id, self._sealed(object_id, payload))],
                pad_end=False,
            )
            for number, payload in zip(_numbers(), payloads, strict=True)
        ]

    def _sealed(self, channel: int, payload: bytes) -> bytes:
        return payload if self._seal is None else self._seal.seal(channel, payload)

    def _write_id(self, stream_id: int, number: int) -> int:
        """Request id of a WRITE_DATA; without compression they are counted."""
        return write_request_id(stream_id, number) if self._by_rule else FIRST_REQUEST + number


@dataclass(slots=True)
class _Samples:
    """What samples look like."""

    sizes: Mapping[str, int]
    assumed: dict[str, int] = field(default_factory=dict)

    def of(self, binding: Binding, part_type: PartType | None) -> Callable[[int], bytes]:
        """A sample of a binding by its number."""
        says = _SAYS.get(part_type.number, "") if part_type is not None else ""
        size = self.sizes.get(binding.type_name)
        if binding.type_name == HelloWorld.type_name and size is None:
            text = says or SAMPLE_PARTS["AA"].says
            return lambda number: HelloWorld(index=number, message=text).encode()
        if size is None:
            size = self.assumed[binding.type_name] = UNKNOWN_BYTES
        dice = Random(size)
        return lambda _: dice.randbytes(size)


def _bound(
    binding: Binding, scribes: Mapping[str, _MessageEncoder], rate_hz: float, payload: Callable[[int], bytes]
) -> list[Flow]:
    flows = []
    if binding.source.slot:
        source = scribes[binding.source.slot]
        flows = source.publishes(binding.topic, rate_hz, reliable=binding.reliable, payload=payload)
    for target in binding.targets:
        flows += scribes[target.slot].subscribes(binding.topic, rate_hz, reliable=binding.reliable, payload=payload)
    return flows


def _part_type(blueprint: Blueprint, library: Library, binding: Binding) -> PartType | None:
    slot = blueprint.slot(binding.source.slot)
    return None if slot is None else library.get(slot.part_number)


def _numbers() -> range:
    return range(0, NUMBERS, NUMBERS // WRITTEN)


def _acknacks() -> list[bytes]:
    return [
        encode_message(
            Header(SESSION_DEFAULT, STREAM_NONE, 0), [Acknack(number + 1, 0, STREAM_RELIABLE)], pad_end=False
        )
        for number in _numbers()
    ]
