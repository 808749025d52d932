"""The topics of a running robot as people look at them: list, messages as they come, a message by hand.

A topic is listened to while somebody asks for its messages. A request names the number of the message after which it
wants more, and waits a while for the next one; the master keeps nothing about who asks. So any number of people look at
a topic for the price of one, and whoever reads too slowly learns how many messages are gone. A topic that nobody has
asked for in `IDLE_S` is no longer listened to.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Final

from msbot.config import Binding
from msbot.operations.manual_control import check_ranges, read_message
from msbot.operations.message_classes import MessageClasses
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.part import Message
from msbot.part.messages.message import fields_of
from msbot.part.messages.type_hash import described_types
from msbot.pnp import message_words
from msbot.registry import EditKind
from msbot.service_types import request_topic, service_type
from msbot_agent.agent import client_key_of
from msbot_agent.space import Guid, Qos, Reader, Sample, Topic, Writer
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import did_you_mean, instead_of, nearest
from msbot_xrce.errors import ConfigError, NotThere, RemoteProtocolError
from msbot_xrce.lazy import dataclass

MOST_KEPT: Final = 2000
"""Messages kept of one topic, of which somebody who reads slowly may still get each."""
MOST_OCTETS_KEPT: Final = 2_000_000
"""Their octets."""
MOST_WATCHED: Final = 64
"""Topics that are listened to at once; the one that nobody has asked for the longest makes room."""
MOST_WAITING: Final = 64
"""Requests that wait for a message at once; one more is answered at once."""
MOST_TOLD: Final = 200
"""Messages in one answer."""
MOST_OCTETS_TOLD: Final = 60_000
"""Their octets, unless one alone is larger."""
IDLE_S: Final = 10.0
WRITER_S: Final = 5.0
"""A writer for messages by hand stays this long, so that peers need not find it anew for each message."""
MATCHING_S: Final = 0.5
"""How long a new writer waits for the readers of other programs to find it."""

_GUID: Final = bytes.fromhex("4d73424f5400000000000000746f7063")
"""The writer's identity in the data space: `MsBOT`, `topc`."""


class _WatchedTopic:
    """The newest messages of one topic, numbered from 1."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.kept: deque[tuple[float, Guid, bytes]] = deque()
        self.total = 0
        self.asked_at = clock()
        self.reader: Reader | None = None
        self.news = asyncio.Event()
        self._octets = 0
        self._clock = clock

    def deliver(self, sample: Sample) -> bool:
        """Take a sample; what the data space calls."""
        self.kept.append((self._clock(), sample.writer, sample.payload))
        self._octets += len(sample.payload)
        self.total += 1
        while len(self.kept) > MOST_KEPT or (self._octets > MOST_OCTETS_KEPT and len(self.kept) > 1):
            self._octets -= len(self.kept.popleft()[2])
        self.news.set()
        return True

    def after(self, number: int) -> tuple[int, list[tuple[float, Guid, bytes]]]:
        """How many messages after that number are gone already, and the next that are there."""
        number = min(number, self.total)
        oldest = self.total - len(self.kept)
        missed = max(oldest - number, 0)
        found: list[tuple[float, Guid, bytes]] = []
        octets = 0
        for place in range(max(number - oldest, 0), len(self.kept)):
            octets += len(self.kept[place][2])
            if found and (len(found) == MOST_TOLD or octets > MOST_OCTETS_TOLD):
                break
            found.append(self.kept[place])
        return missed, found

    def close(self) -> None:
        """Listen no more; whoever waits is answered."""
        if self.reader is not None:
            self.reader.close()
        self.news.set()


@dataclass(slots=True)
class _HandWriter:
    writer: Writer
    timer: asyncio.TimerHandle | None = None


class TopicInspection:
    """The operations on topics of one running robot."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._class_of = MessageClasses(lambda: running.library)
        self._watched: dict[tuple[str, str], _WatchedTopic] = {}
        self._waiting = 0
        self._sweeping: asyncio.TimerHandle | None = None
        self._writers: dict[tuple[str, str], _HandWriter] = {}

    # What there is

    def topics(self) -> Outcome:
        """Every topic: its type with its fields, who publishes and who subscribes, how many messages it has carried."""
        counts = {name: (published, delivered) for name, published, delivered in self._running.master.agent.topics()}
        blueprint = self._running.blueprint
        free = [name for name in blueprint.options.free_topics if name not in blueprint.topics()]
        known = [self._described(binding, counts) for binding in blueprint.bindings]
        return Outcome(answer={"topics": [*known, *(_free(name, counts) for name in free)]})

    def _described(self, binding: Binding, counts: dict[str, tuple[int, int]]) -> dict[str, object]:
        service = service_type(binding.type_name)
        counted = binding.topic if service is None else request_topic(binding.topic)
        published, delivered = counts.get(counted, (0, 0))
        library = self._running.library
        message = None if library is None else library.messages.get(binding.type_name)
        types = self._types((binding.type_name,) if service is None else service)
        declared = {} if library is None else library.messages
        return {
            "topic": binding.topic,
            "type": binding.type_name,
            "service": service is not None,
            "free": False,
            "reliable": binding.reliable,
            "fields": types.get(binding.type_name, []),
            "types": types,
            "units": {} if message is None else dict(message.units),
            "type_units": {name: dict(declared[name].units) for name in types if name in declared},
            "publishers": [self._end(end.slot, end.port) for end in (binding.source,) if end.slot],
            "subscribers": [self._end(end.slot, end.port) for end in binding.targets],
            "published": published,
            "delivered": delivered,
        }

    def _types(self, names: Sequence[str]) -> dict[str, list[list[str]]]:
        """The fields of these types and of those inside, by type; of an enum its names and their numbers."""
        found: dict[str, list[list[str]]] = {}
        for cls in filter(None, map(self._class_of, names)):
            described = described_types(cls)
            if described is None:  # lists of lists have no word in a library
                described = {cls.type_name: [(field.name, field.codec.word) for field in fields_of(cls)]}
            found |= {name: [[*field] for field in fields] for name, fields in described.items()}
        return found

    def _end(self, slot: str, port: str) -> dict[str, str]:
        holder = self._running.holder(slot)
        return {"slot": slot, "port": port, "part": "" if holder is None else holder.part_number}

    # Messages as they come

    async def topic_samples(
        self, topic: str, type_name: str | None, after: int | None, wait: float, *, values: bool
    ) -> Outcome:
        """The messages of a topic after the one with that number; without a number, only which is the newest now.

        The answer has `next`, the number to ask for next time, and `missed`, how many were gone before they were asked
        for. `at` of a message is in seconds since 1970.
        """
        meant = self._meant(topic, type_name)
        watched = self._watch(meant)
        if after is None:
            return Outcome(answer={"type": meant[1], "next": watched.total, "missed": 0, "samples": []})
        if after >= watched.total and self._waiting < MOST_WAITING:
            await self._wait(watched, wait)
        after = min(after, watched.total)  # the master has begun anew, or the topic was not listened to for a while
        missed, found = watched.after(after)
        since_1970 = time.time() - self._running.now()
        samples = [self._told(meant[1], one, since_1970, values=values) for one in found]
        return Outcome(
            answer={"type": meant[1], "next": after + missed + len(found), "missed": missed, "samples": samples}
        )

    async def _wait(self, watched: _WatchedTopic, wait: float) -> None:
        watched.news.clear()
        self._waiting += 1
        try:
            async with asyncio.timeout(wait):
                await watched.news.wait()
        except TimeoutError:
            pass  # the answer has no message: that is one, too
        finally:
            self._waiting -= 1
            watched.asked_at = self._running.now()

    def _told(
        self, type_name: str, sample: tuple[float, Guid, bytes], since_1970: float, *, values: bool
    ) -> dict[str, object]:
        at, writer, payload = sample
        told: dict[str, object] = {"at": round(at + since_1970, 6), "octets": len(payload)}
        if values:
            held = self._running.inventory.configuration_of(client_key_of(writer))
            told |= {"slot": "" if held is None else held.slot, "fields": self._fields(type_name, payload)}
        return told

    def _fields(self, type_name: str, payload: bytes) -> object:
        cls = self._class_of(type_name)
        try:
            return {"octets": payload.hex(" ")} if cls is None else plain_fields(cls.decode(payload))
        except RemoteProtocolError as error:
            return {"octets": payload.hex(" "), "unreadable": str(error)}

    def _meant(self, topic: str, type_name: str | None) -> tuple[str, str]:
        """The topic that a person means, with its type.

        Raises:
            ConfigError: there is none, or it has another type or none that is known.
        """
        blueprint = self._running.blueprint
        known = blueprint.topics()
        for name in (topic, topic.lstrip("/")):
            if name in known:
                if type_name not in (None, "", known[name]):
                    raise ConfigError(
                        said(
                            "{topic} carries {type}, not {other}",
                            topic=name,
                            type=known[name],
                            other=type_name,
                        )
                    )
                return name, known[name]
            if name in blueprint.options.free_topics:
                if not type_name:
                    raise ConfigError(said("{topic} is a free topic, of any type: say which type is meant", topic=name))
                return name, type_name
        hint = instead_of(topic, (*known, *blueprint.options.free_topics))
        raise NotThere(said("this robot has no topic {topic!r}; {hint}", topic=topic, hint=hint))

    def _watch(self, meant: tuple[str, str]) -> _WatchedTopic:
        watched = self._watched.get(meant)
        if watched is None:
            while len(self._watched) >= MOST_WATCHED:
                self._close(min(self._watched, key=lambda one: self._watched[one].asked_at))
            watched = self._watched[meant] = _WatchedTopic(self._running.now)
            watched.reader = self._running.master.space.reader(
                Topic(*meant), Qos(reliable=False, depth=1), watched.deliver
            )
        watched.asked_at = self._running.now()
        if self._sweeping is None:
            self._sweeping = self._running.loop.call_later(IDLE_S, self._sweep)
        return watched

    def _sweep(self) -> None:
        for meant, watched in list(self._watched.items()):
            if self._running.now() - watched.asked_at >= IDLE_S:
                self._close(meant)
        self._sweeping = self._running.loop.call_later(IDLE_S, self._sweep) if self._watched else None

    def _close(self, meant: tuple[str, str]) -> None:
        self._watched.pop(meant).close()

    # A message by hand

    async def publish_topic(self, topic: str, values: Sequence[str], type_name: str | None, who: str) -> Outcome:
        """Publish one message on a topic, besides what parts publish there."""
        name, kind = meant = self._meant(topic, type_name)
        if self._running.master.stop.stopped:
            raise ConfigError(said("STOP is in force: nothing is published on {topic} until GO", topic=name))
        library = self._running.library
        declared = None if library is None else library.messages.get(kind)
        if declared is None:
            near = nearest(kind, library.messages if library is not None else ())
            if near:
                hint = did_you_mean(near)
                raise ConfigError(said("the library does not know {type}; {hint}", type=kind, hint=hint))
            raise ConfigError(said("the library does not know {type}: nobody can say what it takes", type=kind))
        message = read_message(name, declared, values)
        self._check_ranges(name, message)
        octets = message.encode()
        writer = self._writers.get(meant)
        if writer is None:
            binding = next((one for one in self._running.blueprint.bindings if one.topic == name), None)
            qos = Qos(reliable=binding is None or binding.reliable)
            space = self._running.master.space
            writer = self._writers[meant] = _HandWriter(space.writer(Topic(*meant), qos, _GUID))
            self._running.note(EditKind.HAND, said("{who} publishes on {topic} by hand", who=who, topic=name), who)
            if space.words is not None:
                self._keep(meant, writer)
                await asyncio.sleep(MATCHING_S)
                if self._running.master.stop.stopped:
                    raise ConfigError(said("STOP is in force: nothing is published on {topic} until GO", topic=name))
        self._keep(meant, writer)
        writer.writer.write(octets)
        return Outcome(said("{topic}: {shown}", topic=name, shown=message_words(message, declared.units)))

    def _check_ranges(self, topic: str, message: Message) -> None:
        """Refuse a value that makes no sense at a port that the topic leads to, or comes from.

        Raises:
            ConfigError: there is one; the text names the port and its range.
        """
        library, blueprint = self._running.library, self._running.blueprint
        for end in (end for one in blueprint.bindings if one.topic == topic for end in one.ends):
            slot = blueprint.slot(end.slot)
            part_type = None if slot is None or library is None else library.find(slot.part_number)
            port = None if part_type is None else part_type.port(end.port)
            if port is not None:
                check_ranges(str(end), port, message)

    def _keep(self, meant: tuple[str, str], writer: _HandWriter) -> None:
        if writer.timer is not None:
            writer.timer.cancel()
        writer.timer = self._running.loop.call_later(WRITER_S, self._end_writer, meant)

    def _end_writer(self, meant: tuple[str, str]) -> None:
        self._writers.pop(meant).writer.close()

    def slots_that_hear(self, topic: str) -> tuple[str, ...]:
        """The slots with a port that subscribes to a topic."""
        names = (topic, topic.lstrip("/"))
        bindings = (one for one in self._running.blueprint.bindings if one.topic in names)
        return tuple(dict.fromkeys(end.slot for one in bindings for end in one.targets))


def _free(name: str, counts: dict[str, tuple[int, int]]) -> dict[str, object]:
    published, delivered = counts.get(name, (0, 0))
    return {
        "topic": name,
        "type": "",
        "service": False,
        "free": True,
        "reliable": True,
        "fields": [],
        "types": {},
        "units": {},
        "type_units": {},
        "publishers": [],
        "subscribers": [],
        "published": published,
        "delivered": delivered,
    }


def plain_fields(value: object) -> object:
    """A message as JSON has it: objects, lists, numbers, texts; octets in hexadecimal, numbers that JSON has not as
    texts."""
    if isinstance(value, Message):
        return {field.name: plain_fields(getattr(value, field.name)) for field in fields_of(type(value))}
    if isinstance(value, list | tuple):
        return [plain_fields(one) for one in value]
    if isinstance(value, bytes):
        return value.hex(" ")
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, bool | int | float | str) else str(value)
