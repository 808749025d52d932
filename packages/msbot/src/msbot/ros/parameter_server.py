"""The parameter services of the robot's nodes, as every ROS 2 node has them (rcl_interfaces).

A request to set a parameter takes the same way as `msbot set`: who may, which values may be, one line in the journal,
one step for undo. Requests wait in a bounded queue and are answered one after the other, because each asks the
database. Events tell what has changed, whoever has changed it.
"""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from functools import partial

from msbot.config import Scalar, scalar_text
from msbot.operations.dispatch import Operations
from msbot.operations.rights import Principal, Right, role_named
from msbot.part import Message
from msbot.registry import ValueRecord
from msbot.ros.diagnostics import stamp
from msbot.ros2 import (
    DescribeParameters_Request,
    DescribeParameters_Response,
    FloatingPointRange,
    GetParameters_Request,
    GetParameters_Response,
    GetParameterTypes_Request,
    GetParameterTypes_Response,
    IntegerRange,
    ListParameters_Request,
    ListParameters_Response,
    ListParametersResult,
    Parameter,
    ParameterDescriptor,
    ParameterEvent,
    ParameterValue,
    SetParameters_Request,
    SetParameters_Response,
    SetParametersAtomically_Request,
    SetParametersAtomically_Response,
    SetParametersResult,
)
from msbot.ros2.forms import MOST_BEHIND
from msbot_agent.ros.graph import EVERYBODY
from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Guid, Owner, Qos, Reader, Sample, Space, Topic, Writer
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.counting import Tally
from msbot_xrce.errors import ConfigError, MsbotError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

# The parameters of a slot in the words of ROS 2 (rcl_interfaces), and back.


NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
ARRAYS = range(5, 10)
"""Kinds of lists, which no parameter of a slot is."""

TYPES = {"bool": BOOL, "int": INTEGER, "float": DOUBLE, "text": STRING, "part": STRING}
"""Our kind of parameter -> its type in ROS 2."""
WORDS = {NOT_SET: "nothing", BOOL: "a bool", INTEGER: "an integer", DOUBLE: "a double", STRING: "a string"}

LEAST_INTEGER, MOST_INTEGER = -(1 << 63), (1 << 63) - 1


def parameter_value(value: Scalar | None) -> ParameterValue:
    """The value as ROS 2 has it; None: the parameter does not exist."""
    is_truth = isinstance(value, bool)
    kind = NOT_SET
    if value is not None:
        kind = BOOL if is_truth else {int: INTEGER, float: DOUBLE, str: STRING}[type(value)]
    return ParameterValue(
        type=kind,
        bool_value=value if isinstance(value, bool) else False,
        integer_value=value if kind == INTEGER and isinstance(value, int) else 0,
        double_value=value if isinstance(value, float) else 0.0,
        string_value=value if isinstance(value, str) else "",
        byte_array_value=b"",
        bool_array_value=[],
        integer_array_value=[],
        double_array_value=[],
        string_array_value=[],
    )


def value_of(record: ValueRecord) -> ParameterValue:
    """The value in force of a parameter, always in the parameter's own type."""
    value = record.value
    return parameter_value(float(value) if record.kind == "float" and isinstance(value, int | float) else value)


def wanted_text(record: ValueRecord, value: ParameterValue) -> str | None:
    """What a person would type to set this value; None: take back what was set by hand (`ros2 param delete`).

    Raises:
        ConfigError: a parameter of this type cannot have it; the text is for whoever wants to set it.
    """
    if value.type == NOT_SET:
        return None
    wanted = TYPES[record.kind]
    if value.type != wanted and (value.type, wanted) != (INTEGER, DOUBLE):
        given = WORDS.get(value.type, "a list" if value.type in ARRAYS else f"of the unknown type {value.type}")
        raise ConfigError(f"{record.name} is {WORDS[wanted]}, not {given}")
    found: dict[int, Scalar] = {
        BOOL: value.bool_value,
        INTEGER: value.integer_value,
        DOUBLE: value.double_value,
        STRING: value.string_value,
    }
    return scalar_text(found[value.type])


def descriptor_of(record: ValueRecord) -> ParameterDescriptor:
    """What may be known about a parameter before setting it."""
    doubles, integers = [], []
    if record.least is not None or record.most is not None:
        least = -math.inf if record.least is None else record.least
        most = math.inf if record.most is None else record.most
        if record.kind == "float":
            doubles.append(FloatingPointRange(from_value=least, to_value=most, step=0.0))
        else:
            low = LEAST_INTEGER if record.least is None else math.ceil(record.least)
            high = MOST_INTEGER if record.most is None else math.floor(record.most)
            integers.append(IntegerRange(from_value=max(low, LEAST_INTEGER), to_value=min(high, MOST_INTEGER), step=1))
    return ParameterDescriptor(
        name=record.name,
        type=TYPES[record.kind],
        description=record.description,
        additional_constraints=f"unit: {record.unit}" if record.unit else "",
        read_only=False,
        dynamic_typing=False,
        floating_point_range=doubles,
        integer_range=integers,
    )


def no_descriptor(name: str) -> ParameterDescriptor:
    """The descriptor of a parameter that does not exist, as rclpy answers it."""
    return ParameterDescriptor(
        name=name,
        type=NOT_SET,
        description="",
        additional_constraints="",
        read_only=False,
        dynamic_typing=False,
        floating_point_range=[],
        integer_range=[],
    )


def list_parameters(names: Iterable[str], prefixes: Sequence[str], depth: int) -> ListParametersResult:
    """The names below the prefixes, not deeper than `depth` levels (0: all), and the prefixes that they have.

    Levels are separated by dots; without prefixes it is about all names.
    """
    found: list[str] = []
    above: dict[str, None] = {}
    for name in names:
        if any(_is_below(name, prefix, depth) for prefix in prefixes) or (
            not prefixes and (depth == 0 or name.count(".") < depth)
        ):
            found.append(name)
            if "." in name:
                above[name.rpartition(".")[0]] = None
    return ListParametersResult(names=found, prefixes=list(above))


def _is_below(name: str, prefix: str, depth: int) -> bool:
    if name == prefix:
        return True
    if not name.startswith(f"{prefix}."):
        return False
    return depth == 0 or name[len(prefix) + 1 :].count(".") < depth


LONGEST_QUEUE = 256
"""Requests that wait; further ones are not answered."""

SERVICE = Qos(depth=64, partitions=EVERYBODY, service=True)
EVENTS = Qos(depth=64, partitions=EVERYBODY)
EVENT_TOPIC = Topic("rt/parameter_events", ParameterEvent.type_name)

Values = Mapping[str, ValueRecord]
"""The parameters of a slot by name."""

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class _Node:
    """A slot whose parameters are offered."""

    name: NodeName
    owner: Owner
    ends: list[Reader | Writer]
    events: Writer
    known: dict[str, Scalar]
    """The values that were told last."""


@dataclass(frozen=True, slots=True)
class _Request:
    slot: str
    service: str
    sample: Sample
    reply: Callable[[bytes, tuple[Guid, int] | None], int]


def asker_from_ros(may_set: bool) -> Principal:
    """Who asks from ROS 2, where nobody says who they are: a student, or with `parameters = "read"` a viewer."""
    role = role_named("student" if may_set else "viewer")

    def require(right: Right) -> None:
        if role < right.least:
            raise ConfigError(
                'this robot lets ROS 2 only read parameters; [ros] parameters = "set" would let it set them'
            )

    return Principal("ROS 2", require, lambda right: role >= right.least)


class ParameterServer:
    """Answers for slots. Must be made on the event loop that the space lives on; `run` does the work."""

    def __init__(self, space: Space, operations: Operations, asker: Principal, epoch_ns: Callable[[], int]) -> None:
        """Serve nobody yet.

        Args:
            space: where the services are.
            operations: sets parameters.
            asker: on whose behalf.
            epoch_ns: wall clock for events.
        """
        self._space = space
        self._operations = operations
        self._asker = asker
        self._epoch_ns = epoch_ns
        self._nodes: dict[str, _Node] = {}
        self._requests: deque[_Request] = deque()
        self._changed: dict[str, None] = {}
        self._news = asyncio.Event()
        self.dropped = Tally()
        """Requests that were not answered, by reason in words."""

    def open(self, slot: str, name: NodeName) -> None:
        """Offer the parameters of a slot under that node; nothing happens if they are offered."""
        if slot in self._nodes:
            return
        owner = Owner(participant=str(name))
        node = _Node(name, owner, [], self._space.writer(EVENT_TOPIC, EVENTS, secrets.token_bytes(16), owner), {})
        self._nodes[slot] = node
        node.ends.append(node.events)
        for service, (request, reply) in _TYPES.items():
            replies = Topic(f"rr{name}/{service}Reply", reply.type_name)
            writer = self._space.writer(replies, SERVICE, secrets.token_bytes(16), owner)
            requests = Topic(f"rq{name}/{service}Request", request.type_name)
            take = partial(self._take, slot, service, writer)
            node.ends += [writer, self._space.reader(requests, SERVICE, take, owner)]
        self.changed(slot)

    def close(self, slot: str) -> None:
        """Offer the parameters of a slot no longer."""
        node = self._nodes.pop(slot, None)
        for end in () if node is None else node.ends:
            end.close()

    def changed(self, slot: str) -> None:
        """The parameters of a slot may have changed: tell what has."""
        if slot in self._nodes:
            self._changed[slot] = None
            self._news.set()

    async def run(self) -> None:
        """Answer requests until cancelled."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._changed or self._requests:
                try:
                    if self._changed:
                        await self._tell_changes(self._changed.popitem()[0])
                    else:
                        await self._answer(self._requests.popleft())
                except MsbotError as error:
                    self._drop("the parameters cannot be read", str(error))

    def _take(self, slot: str, service: str, writer: Writer, sample: Sample) -> bool:
        if len(self._requests) >= LONGEST_QUEUE:
            self._drop(f"{LONGEST_QUEUE} others wait", "they come faster than the database answers")
        else:
            self._requests.append(_Request(slot, service, sample, writer.write))
            self._news.set()
        return True

    def _drop(self, reason: str, details: str) -> None:
        if reason not in self.dropped:
            logger.warning("a request of ROS 2 about parameters is not answered: %s: %s", reason, details)
        self.dropped.count(reason)

    async def _answer(self, request: _Request) -> None:
        asked = _TYPES[request.service][0]
        try:
            message = asked.decode(request.sample.payload, most_behind=MOST_BEHIND)
        except RemoteProtocolError as error:
            self._drop(f"it makes no sense as {asked.type_name}", str(error))
            return
        reply = await _ANSWERS[request.service](self, request.slot, message)
        request.reply(reply.encode(), (request.sample.writer, request.sample.sequence_nr))

    async def _values(self, slot: str) -> Values:
        return {record.name: record for record in await self._operations.settings.read(slot)}

    async def _tell_changes(self, slot: str) -> None:
        values = await self._values(slot)
        node = self._nodes.get(slot)
        if node is None:
            return
        now = {name: record.value for name, record in values.items()}
        new = [_told(values[name]) for name in now if name not in node.known]
        changed = [_told(values[name]) for name in now if name in node.known and now[name] != node.known[name]]
        deleted = [Parameter(name=name, value=parameter_value(None)) for name in node.known if name not in now]
        node.known = now
        if new or changed or deleted:
            event = ParameterEvent(
                stamp=stamp(self._epoch_ns()),
                node=str(node.name),
                new_parameters=new,
                changed_parameters=changed,
                deleted_parameters=deleted,
            )
            node.events.write(event.encode())

    # One for each service.

    async def list_parameters(self, slot: str, asked: ListParameters_Request) -> ListParameters_Response:
        """The names of the parameters."""
        found = list_parameters(await self._values(slot), asked.prefixes, asked.depth)
        return ListParameters_Response(result=found)

    async def describe_parameters(self, slot: str, asked: DescribeParameters_Request) -> DescribeParameters_Response:
        """Types, units and bounds."""
        values = await self._values(slot)
        return DescribeParameters_Response(
            descriptors=[descriptor_of(values[name]) if name in values else no_descriptor(name) for name in asked.names]
        )

    async def get_parameters(self, slot: str, asked: GetParameters_Request) -> GetParameters_Response:
        """The values in force; NOT_SET for a parameter that does not exist."""
        values = await self._values(slot)
        return GetParameters_Response(
            values=[value_of(values[name]) if name in values else parameter_value(None) for name in asked.names]
        )

    async def get_parameter_types(self, slot: str, asked: GetParameterTypes_Request) -> GetParameterTypes_Response:
        """The types; NOT_SET for a parameter that does not exist."""
        values = await self._values(slot)
        kinds = [TYPES[values[name].kind] if name in values else NOT_SET for name in asked.names]
        return GetParameterTypes_Response(types=bytes(kinds))

    async def set_parameters(self, slot: str, asked: SetParameters_Request) -> SetParameters_Response:
        """Set each by itself, and say of each whether it is set or why not."""
        results = [await _result(partial(self._set, slot, one)) for one in asked.parameters]
        return SetParameters_Response(results=results)

    async def set_parameters_atomically(
        self, slot: str, asked: SetParametersAtomically_Request
    ) -> SetParametersAtomically_Response:
        """Set all, or none."""
        return SetParametersAtomically_Response(result=await _result(partial(self._set_all, slot, asked.parameters)))

    async def _set(self, slot: str, wanted: Parameter) -> None:
        self._asker.require(Right.SET)
        text = await self._text(slot, wanted)
        await self._operations.do("set", who=self._asker, slot=slot, name=wanted.name, value=text)

    async def _set_all(self, slot: str, wanted: list[Parameter]) -> None:
        self._asker.require(Right.SET)
        texts = {one.name: await self._text(slot, one) for one in wanted}
        if len(texts) < len(wanted):
            raise ConfigError("a parameter is named twice")
        await self._operations.set_together(slot, texts, who=self._asker)

    async def _text(self, slot: str, wanted: Parameter) -> str | None:
        values = await self._values(slot)
        record = values.get(wanted.name)
        if record is None:
            raise ConfigError(f"slot {slot} has no parameter {wanted.name!r}; {instead_of(wanted.name, values)}")
        return wanted_text(record, wanted.value)


async def _result(work: Callable[[], Awaitable[None]]) -> SetParametersResult:
    try:
        await work()
    except MsbotError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True, reason="")


def _told(record: ValueRecord) -> Parameter:
    return Parameter(name=record.name, value=value_of(record))


_TYPES: dict[str, tuple[type[Message], type[Message]]] = {
    "list_parameters": (ListParameters_Request, ListParameters_Response),
    "describe_parameters": (DescribeParameters_Request, DescribeParameters_Response),
    "get_parameters": (GetParameters_Request, GetParameters_Response),
    "get_parameter_types": (GetParameterTypes_Request, GetParameterTypes_Response),
    "set_parameters": (SetParameters_Request, SetParameters_Response),
    "set_parameters_atomically": (SetParametersAtomically_Request, SetParametersAtomically_Response),
}
"""Request and reply of each service."""

_ANSWERS: dict[str, Callable[..., Awaitable[Message]]] = {name: getattr(ParameterServer, name) for name in _TYPES}
