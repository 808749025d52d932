"""Calls of the robot itself: a person, the page or ROS 2 asks a port that serves, and gets its reply or a sentence."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Sequence

from msbot.config import Binding, Direction, MessageType, Port, SlotPort
from msbot.operations.described_parts import free_topic_name
from msbot.operations.manual_control import check_ranges, read_message
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot, endpoint_of
from msbot.part import Message
from msbot.part.calls import OpenCalls, ReplyStatus, encode_reply
from msbot.part.messages.leaves import leaves_of
from msbot.pnp import message_words
from msbot.service_types import reply_topic, request_topic, service_type
from msbot.sim.model_part import message_class
from msbot_agent.space import Qos, Sample, Topic
from msbot_agent.text.sentence import said
from msbot_xrce.errors import CallError, ConfigError, RemoteProtocolError

MOST_OPEN = 64
"""Calls of the robot itself that wait for their replies, whoever asked for them."""
BEGINS_S = 2.0
"""How long a request waits for a part that has come, and does not serve yet."""
LOOK_S = 0.05
_SERVICE = Qos(service=True)


class ServiceCalls:
    """The calls that one running robot makes to its own parts."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._open = OpenCalls(MOST_OPEN)
        self._number = 0
        self._alarm: asyncio.TimerHandle | None = None

    async def call(self, port: str, values: Sequence[str], seconds: float, who: str) -> Outcome:  # noqa: ARG002 - every operation is told who asks
        """Send a request of these values to a port that serves; the outcome has the reply.

        Raises:
            ConfigError: no such port, it is not wired, or the values make no request.
            CallError: there is no reply; the text says why.
        """
        self._check_is_port(port)
        end = endpoint_of(self._running, port)
        declared = self._port(end)
        assert declared.message is not None
        reply, words = await self.exchange(port, read_message(str(end), declared.message, values), seconds)
        return Outcome(words, answer={"reply": leaves_of(reply)})

    async def exchange(self, port: str, request: Message, seconds: float) -> tuple[Message, str]:
        """Send a request to a port that serves; its reply, and that in words.

        Raises:
            ConfigError: no such port, it is not wired, or a value is outside of the port's range.
            CallError: there is no reply; the text says why.
        """
        end = endpoint_of(self._running, port)
        declared = self._port(end)
        binding = self._binding(end, declared)
        assert declared.reply is not None
        check_ranges(str(end), declared, request)
        reply = await self.ask(binding, end, request.encode(), declared.reply, seconds)
        return reply, said("{port}: {shown}", port=str(end), shown=message_words(reply, declared.reply.units))

    async def ask(
        self, binding: Binding, end: SlotPort, request: bytes, reply_type: MessageType, seconds: float
    ) -> Message:
        """Send an encoded request to the part at that end of a service; returns its reply.

        Raises:
            CallError: there is none; the text says why.
        """
        octets = await self._exchange(binding, end, request, seconds)
        cls = message_class(reply_type)
        try:
            return cls.decode(octets)
        except RemoteProtocolError as error:
            raise CallError(f"call of {end}: the reply cannot be read as {reply_type.name}: {error}") from None

    async def _exchange(self, binding: Binding, end: SlotPort, request: bytes, seconds: float) -> bytes:
        kind = service_type(binding.type_name)
        assert kind is not None
        self._check_holder(end)
        self._open.check_room(str(end))
        loop = self._running.loop
        outcome: asyncio.Future[bytes | CallError] = loop.create_future()
        self._number += 1
        number = self._number
        space, guid = self._running.master.space, secrets.token_bytes(16)

        def take(sample: Sample) -> bool:
            if sample.related is not None and sample.related[0] == guid:
                self._open.replied(number, sample.payload)
            return True

        def done(found: bytes | CallError) -> None:
            if not outcome.done():
                outcome.set_result(found)

        reader = space.reader(Topic(reply_topic(binding.topic), kind.reply), _SERVICE, take)
        writer = space.writer(Topic(request_topic(binding.topic), kind.request), _SERVICE, guid)
        try:
            self._open.open(number, str(end), seconds, loop.time(), done)
            self._set_alarm()
            for _ in range(int(min(seconds, BEGINS_S) / LOOK_S)):
                if writer.readers != 0:
                    break
                await asyncio.sleep(LOOK_S)  # its part has come just now
            if self._running.master.stop.stopped:  # the part may not have heard of it yet
                self._open.replied(number, encode_reply(ReplyStatus.STOPPED))
            else:
                writer.write(request)
            found = await outcome
        finally:
            self._open.forget(number)
            self._set_alarm()
            writer.close()
            reader.close()
        if isinstance(found, CallError):
            raise self._explained(found, end)
        return found

    def _explained(self, error: CallError, end: SlotPort) -> CallError:
        """The error, with the way to its cause if program and library mean different messages."""
        inventory = self._running.master.inventory
        keys = [info.client_key for info in inventory.view(self._running.now()) if info.slot == end.slot]
        if not any(one.port == end.port for key in keys for one in inventory.type_differences(key)):
            return error
        return CallError(said("{error}: msbot why {slot} says what to do", error=str(error), slot=end.slot))

    def _check_is_port(self, word: str) -> None:
        """Name the port that is meant by the name of a service.

        Whoever asks is checked by the slot of the port, so the name alone calls nothing.
        """
        for binding in self._running.blueprint.bindings:
            if binding.topic == word.lstrip("/") and "." not in word:
                raise ConfigError(
                    said(
                        "{word} is the name of a wire: call the port that serves it: msbot call {port} VALUE...",
                        word=word,
                        port=str(binding.source),
                    )
                    if service_type(binding.type_name) is not None and binding.source.slot
                    else said("{word} is no service of a part: msbot topic info {word} shows what it is", word=word)
                )

    def _check_holder(self, end: SlotPort) -> None:
        if why := self._running.master.inventory.why_unserved(end.slot):
            raise CallError(said("nobody serves {port} now: {why}", port=str(end), why=why))

    def _port(self, end: SlotPort) -> Port:
        slot = self._running.blueprint.slot(end.slot)
        library = self._running.library
        part_type = None if slot is None or library is None else library.find(slot.part_number)
        if part_type is None:
            raise ConfigError(
                said(
                    "the library does not know the part type of slot {slot}: nobody can say what it serves",
                    slot=end.slot,
                )
            )
        declared = part_type.port(end.port)
        serving = [f"{end.slot}.{one.name}" for one in part_type.ports if one.direction is Direction.SERVE]
        if declared is not None and declared.direction is Direction.CALL:
            bound = (str(one.source) for one in self._running.blueprint.bindings if end in one.targets)
            raise ConfigError(
                said(
                    "{port} is a port that calls; name the port that it calls: {source}",
                    port=str(end),
                    source=next(bound, "") or said("none is wired to it"),
                )
            )
        if declared is None or declared.direction is not Direction.SERVE or declared.message is None:
            raise ConfigError(
                said(
                    "{port} is not a port that serves; those of {number}: {known}",
                    port=str(end),
                    number=part_type.number,
                    known=", ".join(serving) or said("none"),
                )
            )
        return declared

    def _binding(self, end: SlotPort, declared: Port) -> Binding:
        for binding in self._running.blueprint.bindings:
            if binding.source == end and service_type(binding.type_name) is not None:
                return binding
        raise ConfigError(
            said(
                "no wire leads to {port}: make one, for example msbot bind {name} --type '{type}' --from {port}",
                port=str(end),
                name=free_topic_name(self._running.blueprint, end),
                type=declared.type_name,
            )
        )

    def _set_alarm(self) -> None:
        at = self._open.timer()
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = None if at is None else self._running.loop.call_at(at, self._ring)

    def _ring(self) -> None:
        self._open.handle_timer(self._running.now())
        self._set_alarm()
