"""What a part tells its robot about its messages: the hash of each port's type, and on request the fields.

The hash goes with the first configuration of a port, or with the first message of a port that is not declared.
It goes again when the port stands elsewhere in a new configuration, or after the session was lost. The robot answers
only if its library has another type (`TYPE_DIFFERS`): first it asks for the fields, then it says which one differs.
"""

from __future__ import annotations

from msbot.part.join.membership import Membership
from msbot.part.join.pnp_messages import MOST_BINDINGS, MOST_DESCRIPTION, OF_REPLY, Notice, PortBinding
from msbot.part.messages.message import Message
from msbot.part.messages.type_hash import Fields, described_types, fields_text, hash_words, type_hash
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
            if exchange.type_name == binding.topic_type:
                self._say(place, exchange.request, membership)
                self._say(place | OF_REPLY, exchange.reply, membership)

    def tell_port(self, port: str, message_class: type[Message], ports: Ports, membership: Membership) -> None:
        """Tell of the messages at one port."""
        place, binding = ports.place_of(port), ports.binding(port)
        if place is None or binding is None:
            return
        self.told[port] = place, binding
        if message_class.type_name != binding.topic_type:
            return  # a mistake that is told in other words
        self._say(place, message_class, membership)

    def _say(self, place: int, message_class: type[Message], membership: Membership) -> None:
        types = described_types(message_class)
        if types is not None and place & ~OF_REPLY < MOST_BINDINGS:
            self._fields |= types
            membership.say_type(place, self._hash(message_class.type_name))

    def _hash(self, type_name: str) -> bytes:
        return type_hash(type_name, self._fields.get(type_name, ()), self._fields.get)

    def differs(self, notice: Notice, ports: Ports, membership: Membership) -> tuple[str, str] | None:
        """The library's type of a port differs: the port and what to tell people; None: the robot asks for the fields,
        and gets them."""
        port = ports.port_at(notice.binding & ~OF_REPLY)
        binding = None if port is None else ports.binding(port)
        if port is None or binding is None:
            return None
        if not notice.detail:
            membership.say_fields(fields_text(self._fields)[:MOST_DESCRIPTION])
            return None
        service, place = service_type(binding.topic_type), notice.detail
        name = binding.topic_type if service is None else service[bool(notice.binding & OF_REPLY)]
        fields = self._fields.get(name, ())
        where = ""
        if place <= len(fields):
            field, kind = fields[place - 1]
            where = f": the first field that differs is number {place}, here {kind} {field}"
        elif place != NOT_KNOWN:
            where = f": the first field that differs is number {place}, which is missing here"
        mine = hash_words(self._hash(name))
        return port, f"{name} of this program ({mine}) is not that of the robot's library{where}"
