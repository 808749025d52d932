"""A part's ports: bound to topics by the configuration, and bound again when it changes while the part runs.

The student's code names ports only; which topic a port means is the robot's business (context independence and
location transparency, thesis 2.2.7.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from msbot.part.client.client import Client, ServiceNames
from msbot.part.client.entities import Entity
from msbot.part.join.pnp_messages import BindingDirection, PortBinding
from msbot.part.messages.message import Message
from msbot.service_types import service_type
from msbot_xrce.errors import ConfigError, LinkFull, LocalProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot_xrce.objects import EndpointQos

_NAMES = {one.value: one.name.lower() for one in BindingDirection}
_WORDS: dict[int, tuple[str, str]] = {
    BindingDirection.PUBLISH: ("publishes", "part.publish"),
    BindingDirection.SUBSCRIBE: ("subscribes", "@part.on"),
    BindingDirection.SERVE: ("serves", "@part.serves"),
    BindingDirection.CALL: ("calls", "part.call"),
}
"""Direction -> what a port does, and what a program writes for it."""

NOT_TO_PUBLISH_ON = "to publish on"
"""Words of the mistake of a program that publishes at a port that its robot does not bind."""
LARGEST_MESSAGE = 262_000
"""Most octets of a message: an agent reassembles no more (`AgentSettings.max_message`) and drops the message unseen."""


@dataclass(slots=True)
class BoundPort:
    """One port with its objects at the agent."""

    binding: PortBinding
    topic: Entity | None
    """None for a service, which has no topic of its own."""
    endpoint: Entity
    """Data writer, data reader, requester or replier."""

    @property
    def publishes(self) -> bool:
        """Whether samples go from the part to the robot."""
        return self.binding.direction == BindingDirection.PUBLISH

    @property
    def stream_id(self) -> int:
        """The stream that its samples take."""
        return STREAM_RELIABLE if self.binding.reliable else STREAM_BEST_EFFORT


class Ports:
    """The bound ports of one part over one client."""

    def __init__(
        self,
        client: Client,
        participant: Entity,
        subscriber: Entity,
        seal: Callable[[int, bytes], bytes] = lambda _, sample: sample,
    ) -> None:
        self._client = client
        self._seal = seal
        self._participant = participant
        self._subscriber = subscriber
        self._publisher: Entity | None = None
        self._bound: dict[str, BoundPort] = {}
        self._order: list[str] = []
        self._by_reader: dict[int, BoundPort] = {}

    def __contains__(self, port: object) -> bool:
        return port in self._bound

    def bind(self, bindings: Iterable[PortBinding]) -> None:
        """Bind the ports as the configuration says; ports that stay the same lose no samples."""
        bindings = list(bindings)
        self._order = [binding.port for binding in bindings]
        wanted = {binding.port: binding for binding in bindings}
        for port, bound in list(self._bound.items()):
            if wanted.get(port) != bound.binding:
                self._unbind(port)
        for port, binding in wanted.items():
            if port not in self._bound:
                self._bind(binding)

    def unbind_all(self) -> None:
        """Unbind all ports."""
        self._order = []
        for port in list(self._bound):
            self._unbind(port)
        if self._publisher is not None:
            self._client.delete(self._publisher)
            self._publisher = None

    def port_of(self, object_id: int) -> BoundPort | None:
        """The subscribed port whose data reader has that object id."""
        return self._by_reader.get(object_id)

    def port_at(self, place: int) -> str | None:
        """The port of the configuration's binding with that number (from 0), or None."""
        return self._order[place] if 0 <= place < len(self._order) else None

    def bound_to(self, direction: BindingDirection) -> list[tuple[int, str]]:
        """The ports with that direction, each with the number of its binding (from 0)."""
        return [
            (place, port)
            for place, port in enumerate(self._order)
            if (binding := self.binding(port)) is not None and binding.direction == direction
        ]

    def place_of(self, port: str) -> int | None:
        """The number of a port's binding in the configuration (from 0), or None."""
        return self._order.index(port) if port in self._bound else None

    def binding(self, port: str) -> PortBinding | None:
        """The binding of a port, or None."""
        bound = self._bound.get(port)
        return bound.binding if bound is not None else None

    def fault_of(self, port: str, type_name: str, *, optional: bool) -> str:
        """Why a port that has a function will receive nothing useful, in words; "" = all is well."""
        binding = self.binding(port)
        if binding is None:
            return "" if optional else f"nothing will come in; {self.describe}"
        if binding.direction == BindingDirection.PUBLISH:
            return f"publishes, so nothing comes in there: use part.publish({port!r}, ...), or another port"
        if binding.direction in (BindingDirection.SERVE, BindingDirection.CALL):
            return f"is for requests: use {_words(binding)[1]}"
        if binding.topic_type != type_name:
            return f"carries {binding.topic_type}, but its function expects {type_name}"
        return ""

    def uncalled(self, port: str, slot: str, type_name: str) -> str:
        """What is missing at a port that serves and has no wire in the part's slot, in words; "" = it has one."""
        if port in self._bound:
            return ""
        command = f"msbot bind {port} --type '{type_name}' --from {slot}.{port}"
        return f"nobody can call it before `{command}`; {self.describe}"

    def service_fault(self, port: str, type_name: str, direction: BindingDirection) -> str:
        """Why a port that serves or calls will do neither, in words; "" = all is well, or it has no wire."""
        binding = self.binding(port)
        if binding is None:
            return ""
        if binding.direction != direction:
            verb, use = _words(binding)
            return f"{verb} in this robot's library: use {use}, or another port"
        if binding.topic_type != type_name:
            return f"carries {binding.topic_type}, but the program says {type_name}"
        return ""

    def send_request(self, port: str, request: Message) -> int | None:
        """Send a request out of a port that calls; returns its number, None when there is no room for it.

        Raises:
            LocalProtocolError: there is no session, or the message is larger than any agent accepts.
        """
        bound = self._bound[port]
        try:
            octets = self._seal(bound.endpoint.object_id, _bounded(request.encode(), request.type_name))
            return self._client.write(bound.endpoint, octets, stream_id=STREAM_RELIABLE)
        except LinkFull:
            return None

    def send_reply(self, bound: BoundPort, identity: bytes, reply: bytes) -> bool:
        """Answer a request; False when there was no room, or nobody to say it to."""
        try:
            octets = self._seal(bound.endpoint.object_id, identity + _bounded(reply, "reply"))
            self._client.write(bound.endpoint, octets, stream_id=STREAM_RELIABLE)
        except (LinkFull, LocalProtocolError):
            return False
        return True

    def publish(self, port: str, message: Message) -> bool:
        """Send a message; False when the port's stream or the link had no room.

        Raises:
            ConfigError: there is no such port to publish on, or it carries another type.
            LocalProtocolError: there is no session, or the message is larger than any agent accepts.
        """
        bound = self._publishing(port)
        if not isinstance(message, Message):
            if isinstance(message, type):
                name = message.__name__
                raise ConfigError(f"port {port!r} publishes messages, not the type {name}: write {name}(...)")
            raise ConfigError(f"port {port!r} publishes messages, not {type(message).__name__}")
        _check_type(bound, message.type_name)
        return self._write(bound, message.encode(), message.type_name)

    def publish_octets(self, port: str, type_name: str, octets: bytes) -> bool:
        """The same with a message of that type that is encoded already, without encapsulation header."""
        bound = self._publishing(port)
        _check_type(bound, type_name)
        return self._write(bound, octets, type_name)

    def _publishing(self, port: str) -> BoundPort:
        bound = self._bound.get(port)
        if bound is None or not bound.publishes:
            raise ConfigError(f"there is no port {port!r} {NOT_TO_PUBLISH_ON}; {self.describe}")
        return bound

    def _write(self, bound: BoundPort, octets: bytes, type_name: str) -> bool:
        try:
            sample = self._seal(bound.endpoint.object_id, _bounded(octets, type_name))
            self._client.write(bound.endpoint, sample, stream_id=bound.stream_id)
        except LinkFull:
            return False
        return True

    @property
    def describe(self) -> str:
        """The bound ports, for messages to a person."""
        if not self._bound:
            return "this robot binds no port of the part"
        listed = (
            f"{port} ({_NAMES.get(bound.binding.direction, 'subscribe')} {bound.binding.topic_type})"
            for port, bound in self._bound.items()
        )
        return f"bound in this robot: {', '.join(listed)}"

    def _bind(self, binding: PortBinding) -> None:
        client = self._client
        if binding.direction in (BindingDirection.SERVE, BindingDirection.CALL):
            self._bind_service(binding)
            return
        topic = client.create_topic(self._participant, binding.topic, binding.topic_type)
        qos = EndpointQos(reliable=bool(binding.reliable))
        if binding.direction == BindingDirection.PUBLISH:
            if self._publisher is None:
                self._publisher = client.create_publisher(self._participant)
            bound = BoundPort(binding, topic, client.create_writer(self._publisher, topic, qos))
        else:
            bound = BoundPort(binding, topic, client.create_reader(self._subscriber, topic, qos))
            client.read(bound.endpoint, stream_id=bound.stream_id)
            self._by_reader[bound.endpoint.object_id] = bound
        self._bound[binding.port] = bound

    def _bind_service(self, binding: PortBinding) -> None:
        kind = service_type(binding.topic_type)
        if kind is None:
            return  # of a master that this version does not understand: `service_fault` says so
        names = ServiceNames(binding.topic, kind.request, kind.reply)
        serves = binding.direction == BindingDirection.SERVE
        make = self._client.create_replier if serves else self._client.create_requester
        bound = BoundPort(binding, None, make(self._participant, names))
        self._client.read(bound.endpoint)
        self._by_reader[bound.endpoint.object_id] = bound
        self._bound[binding.port] = bound

    def _unbind(self, port: str) -> None:
        bound = self._bound.pop(port)
        self._by_reader.pop(bound.endpoint.object_id, None)
        self._client.delete(bound.endpoint)
        if bound.topic is not None:
            self._client.delete(bound.topic)


def _words(binding: PortBinding) -> tuple[str, str]:
    return _WORDS.get(binding.direction, ("does what only a newer MsBOT knows", "another port"))


def _check_type(bound: BoundPort, type_name: str) -> None:
    if type_name != bound.binding.topic_type:
        raise ConfigError(f"port {bound.binding.port!r} carries {bound.binding.topic_type}, not {type_name}")


def _bounded(octets: bytes, type_name: str) -> bytes:
    """The octets of a message; a text that has grown too long is reported here, where its line is known."""
    if len(octets) > LARGEST_MESSAGE:
        raise LocalProtocolError(
            f"this {type_name} has {len(octets):,} bytes, and one message may have {LARGEST_MESSAGE:,}: "
            "does a text or list in it grow without end? Begin it anew, or send it in pieces"
        )
    return octets
