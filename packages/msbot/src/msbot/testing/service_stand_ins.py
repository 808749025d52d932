"""The services around a part under test.

The partner asks what the part serves, and stands in for what it calls.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final

from msbot.config import Direction, Library
from msbot.part import Message, Part
from msbot.part.part_services import CallIgnored
from msbot.part.program import Exchange
from msbot.pnp import SlotBinding
from msbot.sim.model_part import message_class
from msbot.testing.own_messages import as_message
from msbot_xrce.errors import CallError, ConfigError
from msbot_xrce.lazy import dataclass

Answer = Message | CallError | Callable[[Any], Message] | None
"""A reply, a refusal, a function that gives or raises one, or None: never a reply."""
MOST_KEPT: Final = 10_000
"""Requests kept of each port, the newest."""


@dataclass(frozen=True, slots=True)
class ServicePort:
    """A port of the part under test that serves or calls."""

    exchange: Exchange
    serves: bool


class ServiceStandIns:
    """What the partner of one part does for its services.

    Args:
        part: the part under test.
        library: its part types; ports that serve are known from there, too.
    """

    def __init__(self, part: Part, library: Library) -> None:
        self.ports = _service_ports(part, library)
        self.asked: dict[str, deque[Message]] = {
            name: deque(maxlen=MOST_KEPT) for name, port in self.ports.items() if not port.serves
        }
        """What the part has asked at each port that calls."""
        self._answers: dict[str, Answer] = dict.fromkeys(self.asked)

    def bindings(self) -> Iterator[SlotBinding]:
        """The part's wires to these services."""
        for name, port in self.ports.items():
            yield SlotBinding(name, name, port.exchange.type_name, port.serves)

    def declare(self, partner: Part) -> None:
        """Give the partner the other end of each."""
        for name, port in self.ports.items():
            if port.serves:
                partner.calls(name, port.exchange.request, port.exchange.reply)
            else:
                serve = self._server(name, port.exchange)
                partner.serves(name, port.exchange.request, port.exchange.reply)(serve)

    def answer(self, port: str, answer: Answer) -> None:
        """From now on requests at a port that calls get this answer.

        Raises:
            ConfigError: no such port, or the reply is none of its messages.
        """
        exchange = self.port(port, serves=False).exchange
        self._answers[port] = (
            as_message(f"port {port!r} gets", answer, exchange.reply) if isinstance(answer, Message) else answer
        )

    def port(self, name: str, *, serves: bool) -> ServicePort:
        """A port of the part.

        Raises:
            ConfigError: it is none that serves (or calls); the text lists those.
        """
        found = self.ports.get(name)
        if found is None or found.serves is not serves:
            verb = "serves" if serves else "calls"
            known = ", ".join(one for one, it in self.ports.items() if it.serves is serves) or "none"
            raise ConfigError(f"the part {verb} at no port {name!r}; it {verb} at {known}")
        return found

    def _server(self, name: str, exchange: Exchange) -> Callable[[Message], Message]:
        def serve(request: Message) -> Message:
            self.asked[name].append(request)
            answer = self._answers[name]
            if answer is None:
                raise CallIgnored
            if isinstance(answer, CallError):
                raise answer
            reply = answer if isinstance(answer, Message) else answer(request)
            return as_message(f"answer({name!r}, ...): the reply must be", reply, exchange.reply)

        return serve


def _service_ports(part: Part, library: Library) -> dict[str, ServicePort]:
    program = part.program
    ports = {name: ServicePort(server.exchange, serves=True) for name, server in program.servers.items()}
    ports |= {name: ServicePort(exchange, serves=False) for name, exchange in program.calls.items()}
    part_type = library.find(part.part_number)
    for declared in () if part_type is None else part_type.ports:
        if declared.message is None or declared.reply is None:
            continue
        serves = declared.direction is Direction.SERVE
        mine = ports.get(declared.name)
        if mine is not None and (mine.serves is not serves or mine.exchange.type_name != declared.type_name):
            raise ConfigError(
                f"port {declared.name!r}: the library says that {part.part_number} {'serves' if serves else 'calls'} "
                f"{declared.type_name} there, the program {'serves' if mine.serves else 'calls'} "
                f"{mine.exchange.type_name}"
            )
        if mine is None and serves:
            exchange = Exchange(message_class(declared.message), message_class(declared.reply))
            ports[declared.name] = ServicePort(exchange, serves=True)
    return ports
