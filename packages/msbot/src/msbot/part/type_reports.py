"""What a part tells its robot about its messages: the hash of each port's type, and on request the fields.

The hash goes with the first configuration of a port, or with the first message of a port that is not declared.
It goes again when the port stands elsewhere in a new configuration, or after the session was lost. The robot answers
only if its library has another type (`TYPE_DIFFERS`): first it asks for the fields, then it says which one differs.
For a port that serves and has no function in the program, `NO_FUNCTION` goes: the robot's people learn of it.
"""

from __future__ import annotations

from msbot.part.join.membership import Membership
from msbot.part.join.pnp_messages import (
    MOST_BINDINGS,
    MOST_DESCRIPTION,
    OF_REPLY,
    BindingDirection,
    Notice,
    PortBinding,
)
from msbot.part.messages.message import Message
from msbot.part.messages.type_hash import NO_FUNCTION, Fields, described_types, fields_text, hash_words, type_hash
from msbot.part.ports import Ports
from msbot.part.program import ProgramDeclarations
from msbot.service_types import service_type

NOT_KNOWN = 255
"""`Notice.detail`: which field differs is not known."""


class TypeTelling:
    """See the module's docstring; for one program."""

    def __init__(self, program: ProgramDeclarations) -> None:
        self.told: dict[str, tuple[int, PortBinding]] = {}
        """Ports of whose messages the robot has been told, with where they stood in the configuration."""
        self._program = program
        self._fields: dict[str, Fields] = {}
        """The fields of these messages and of those inside, by type."""
        self._names: dict[tuple[str, bool], str] = {}
        """The types that were told: (port, whether it is the reply's) -> name."""

    def tell(self, ports: Ports, membership: Membership) -> None:
        """Tell of the declared messages at ports that the robot has bound, or bound elsewhere than before."""
        for port, told in list(self.told.items()):
            if told != (ports.place_of(port), ports.binding(port)):
                del self.told[port]
        heard = {port: listener.message_class for port, listener in self._program.listeners.items()}
        for port, message_class in (self._program.publications | heard).items():
            if port not in self.told:
                self.tell_port(port, message_class, ports, membership)
        exchanges = {port: server.exchange for port, server in self._program.servers.items()} | self._program.calls
        for port, exchange in exchanges.items():
            place, binding = ports.place_of(port), ports.binding(port)
            if port in self.told or place is None or binding is None:
                continue
            self.told[port] = place, binding
            if service_type(binding.topic_type) is not None:
                self._say(port, place, exchange.request, membership)
                self._say(port, place | OF_REPLY, exchange.reply, membership)
        for place, port in ports.bound_to(BindingDirection.SERVE):
            binding = ports.binding(port)
            if port not in self._program.servers and port not in self.told and binding is not None:
                self.told[port] = place, binding
                membership.say_type(place, NO_FUNCTION)

    def tell_port(self, port: str, message_class: type[Message], ports: Ports, membership: Membership) -> None:
        """Tell of the messages at one port."""
        place, binding = ports.place_of(port), ports.binding(port)
        if place is None or binding is None:
            return
        self.told[port] = place, binding
        self._say(port, place, message_class, membership)

    def _say(self, port: str, place: int, message_class: type[Message], membership: Membership) -> None:
        types = described_types(message_class)
        if types is not None and place & ~OF_REPLY < MOST_BINDINGS:
            self._fields |= types
            self._names[port, bool(place & OF_REPLY)] = message_class.type_name
            membership.say_type(place, self._hash(message_class.type_name))

    def _hash(self, type_name: str) -> bytes:
        return type_hash(type_name, self._fields.get(type_name, ()), self._fields.get)

    def differs(self, notice: Notice, ports: Ports, membership: Membership) -> tuple[str, str] | None:
        """The library's type of a port differs: the port and what to tell people; None: the robot asks for the fields,
        and gets them, or the types have different names, which `Ports` tells."""
        port = ports.port_at(notice.binding & ~OF_REPLY)
        binding = None if port is None else ports.binding(port)
        if port is None or binding is None:
            return None
        if not notice.detail:
            membership.say_fields(fields_text(self._fields)[:MOST_DESCRIPTION])
            return None
        service, place = service_type(binding.topic_type), notice.detail
        of_reply = bool(notice.binding & OF_REPLY)
        name = binding.topic_type if service is None else service[of_reply]
        if self._names.get((port, of_reply)) != name:
            return None
        fields = self._fields.get(name, ())
        where = ""
        if place <= len(fields):
            field, kind = fields[place - 1]
            where = f": the first field that differs is number {place}, here {kind} {field}"
        elif place != NOT_KNOWN:
            where = f": the first field that differs is number {place}, which is missing here"
        mine = hash_words(self._hash(name))
        return port, f"{name} of this program ({mine}) is not that of the robot's library{where}"
