"""The values on a robot's topics as people see them: the latest one, how often they come, and a while of history.

A listener in the data space, one per bound topic. What arrives is kept as octets and decoded only when a page asks, so
a topic that nobody looks at costs only a counter.
"""

from __future__ import annotations

import json
import math
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from itertools import takewhile

from msbot.part import Message
from msbot.part.messages.message import fields_of
from msbot.service_types import request_topic, service_type
from msbot_agent.space import Qos, Reader, Sample, Space, Topic
from msbot_xrce.errors import RemoteProtocolError

HISTORY_S = 300.0
"""Values are kept for this long, every one of them."""
MOST_KEPT = 30_000
"""Values kept of one topic: five minutes at 100 a second; of a quicker one, the newest."""
MOST_KEPT_IN_ALL = 200_000
"""Shared by all topics: some 5 MB."""
IN_BLOCK = 64
"""Samples that are kept together, and forgotten together."""
COUNT_STEP_S = 0.1
"""The rate is worked out from a count in this time at most."""
SPARK_S, SPARK_POINTS = 60.0, 40
"""The small curve on a card: the last minute."""
TAKEN_APART = 4000
"""Values that are taken apart for a curve in one look; the rest follows with the next."""
RATE_WINDOW_S = 3.0
LONGEST_TEXT = 200
MOST_ELEMENTS = 4096
"""Of a list; no type of a library has more."""
MOST_CURVES = 64
"""Elements of a list that can be drawn as curves."""

Scalar = bool | int | float | str
ClassOf = Callable[[str], type[Message] | None]
"""The message class of a type name, or None when nobody here knows it."""


class _Block:
    """A few samples one behind the other: an object for each would take six times the memory."""

    __slots__ = ("ends", "octets", "times")

    def __init__(self) -> None:
        self.times = array("d")
        self.ends = array("I")
        """Where each ends in `octets`."""
        self.octets = bytearray()

    def since(self, first: int) -> Iterator[tuple[float, bytes]]:
        """(time, octets) from that one on."""
        begin = self.ends[first - 1] if first else 0
        for at, end in zip(self.times[first:], self.ends[first:], strict=True):
            yield at, bytes(self.octets[begin:end])
            begin = end


class _SampleHistory:
    """The newest samples, and how many there were in all.

    Args:
        most: how many are kept.
    """

    def __init__(self, most: int) -> None:
        self.total = 0
        self._most = most
        self._kept = 0
        self._blocks = deque([_Block()])

    def add(self, at: float, octets: bytes) -> None:
        """Take one more."""
        self.total += 1
        self._kept += 1
        block = self._blocks[-1]
        if len(block.times) == IN_BLOCK:
            block = _Block()
            self._blocks.append(block)
            self.keep_at_most(self._most)
        block.times.append(at)
        block.octets += octets
        block.ends.append(len(block.octets))

    def keep_at_most(self, most: int) -> None:
        """Keep this many from now on."""
        self._most = most
        while self._kept - IN_BLOCK >= most:
            self._forget()

    def forget_until(self, at: float) -> None:
        """Forget what came before that time, as far as whole blocks did."""
        while len(self._blocks) > 1 and self._blocks[0].times[-1] < at:
            self._forget()

    def _forget(self) -> None:
        self._kept -= len(self._blocks.popleft().times)

    def after(self, number: int) -> list[tuple[float, bytes]]:
        """Those that came after the one with that number, oldest first, as far as they are kept."""
        wanted, parts = min(self.total - number, self._kept, self._most), list[list[tuple[float, bytes]]]()
        for block in reversed(self._blocks):
            if wanted <= 0:
                break
            parts.append(list(block.since(max(0, len(block.times) - wanted))))
            wanted -= len(block.times)
        return [one for part in reversed(parts) for one in part]


class TopicWatch:
    """What is known about one topic."""

    def __init__(self, name: str, type_name: str, clock: Callable[[], float]) -> None:
        self.name = name
        self.type_name = type_name
        service = service_type(type_name)
        self.message_type = type_name if service is None else service.request
        """The type of its samples; of a service these are the requests."""
        self.count = 0
        """Samples since the watch began."""
        self.at: float | None = None
        """When the latest sample came, by the robot's clock."""
        self.payload = b""
        self.shown: tuple[int, type[Message] | None, Mapping[str, Scalar]] | None = None
        """The fields of the latest sample, taken apart once for all who show them: its number, its class, and they."""
        self.reader: Reader | None = None
        self._clock = clock
        self.period_s = 0.0
        """Smoothed time between samples; 0 = not known yet."""
        self.kept = _SampleHistory(MOST_KEPT)
        self.sparks = _SampleHistory(SPARK_POINTS)
        """The same for the small curve on a card: one in `SPARK_S / SPARK_POINTS`."""
        self._sparked_at = -math.inf
        self._counts: deque[tuple[float, int]] = deque(maxlen=64)

    def deliver(self, sample: Sample) -> bool:
        """Take a sample; what the data space calls."""
        now = self._clock()
        self.count += 1
        if self.at is not None:
            step_s = now - self.at
            self.period_s = step_s if not self.period_s else self.period_s + (step_s - self.period_s) / 8
        self.at, self.payload = now, sample.payload
        self.kept.add(now, sample.payload)
        self.kept.forget_until(now - HISTORY_S)
        if now - self._sparked_at >= SPARK_S / SPARK_POINTS:
            self._sparked_at = now
            self.sparks.add(now, sample.payload)
        if not self._counts or now - self._counts[-1][0] >= COUNT_STEP_S:
            self._counts.append((now, self.count))
        return True

    def keep_at_most(self, most: int) -> None:
        """Keep this many values from now on."""
        self.kept.keep_at_most(most)

    def rate_hz(self, now: float) -> float:
        """Samples a second, over the last few seconds."""
        counts = self._counts
        while counts and counts[0][0] < now - RATE_WINDOW_S:
            counts.popleft()
        if len(counts) < 2:
            return 0.0
        (first_at, first), (last_at, last) = counts[0], counts[-1]
        # Silence since the last sample lowers the rate at once, not only when the window is empty.
        return (last - first) / max(last_at - first_at, now - first_at - 1.0)


class _Curve:
    """A field's numbers over time, taken apart as they come."""

    def __init__(self) -> None:
        self.points: deque[tuple[float, float]] = deque(maxlen=MOST_KEPT)
        self.taken = 0
        """Number of the newest sample that was taken apart."""
        self.asked_at = 0.0


def _heard(name: str, type_name: str) -> tuple[Topic, Qos]:
    """What is listened to: the samples of a topic, the requests of a service."""
    service = service_type(type_name)
    if service is None:
        return Topic(name, type_name), Qos(reliable=False, depth=1)
    return Topic(request_topic(name), service.request), Qos(reliable=False, depth=1, service=True)


class LiveValues:
    """Listens to topics.

    Args:
        space: where the robot's topics are.
        class_of: finds message classes.
        clock: the robot's clock, seconds.
    """

    def __init__(self, space: Space, class_of: ClassOf, clock: Callable[[], float]) -> None:
        self._space = space
        self._class_of = class_of
        self._clock = clock
        self._watches: dict[str, TopicWatch] = {}
        self._curves: dict[tuple[str, str], _Curve] = {}
        self._sparks: dict[tuple[str, str], _Curve] = {}

    def watch(self, topics: Mapping[str, str]) -> None:
        """Listen to exactly these topics from now on: name -> type name."""
        for name, watch in list(self._watches.items()):
            if topics.get(name) != watch.type_name:
                self._close(name)
        most = max(min(MOST_KEPT, MOST_KEPT_IN_ALL // max(len(topics), 1)), SPARK_POINTS)
        for name, type_name in topics.items():
            if name in self._watches:
                self._watches[name].keep_at_most(most)
            else:
                watch = TopicWatch(name, type_name, self._clock)
                watch.reader = self._space.reader(*_heard(name, type_name), watch.deliver)
                watch.keep_at_most(most)
                self._watches[name] = watch

    def close(self) -> None:
        """Listen to nothing."""
        self.watch({})

    def topic(self, name: str) -> TopicWatch | None:
        """What is known of a topic."""
        return self._watches.get(name)

    def fields(self, watch: TopicWatch, payload: bytes | None = None) -> dict[str, Scalar]:
        """A sample's fields by name; nested ones as `pose.x`, a list as a JSON text, a value of an enum as its name.

        Octets of an unknown type, or that do not fit it, are shown as hexadecimal digits under the name `octets`.
        """
        return dict(self.shown(watch)) if payload is None else self._take_apart(watch, payload)

    def shown(self, watch: TopicWatch) -> Mapping[str, Scalar]:
        """`fields` of the latest sample, for who changes nothing in it."""
        if not watch.payload:
            return {}
        message_class, known = self._class_of(watch.message_type), watch.shown
        if known is None or known[0] != watch.count or known[1] is not message_class:
            known = watch.shown = (watch.count, message_class, self._take_apart(watch, watch.payload))
        return known[2]

    def _take_apart(self, watch: TopicWatch, octets: bytes) -> dict[str, Scalar]:
        if not octets:
            return {}
        message = self._message(watch, octets)
        found: dict[str, Scalar] = {}
        found.update([("octets", octets[: LONGEST_TEXT // 2].hex(" "))] if message is None else _leaves("", message))
        return found

    def numbers(self, watch: TopicWatch, payload: bytes | None = None) -> dict[str, bool | int | float]:
        """A sample's numbers by name; those in lists as `samples[0]`, the first of them."""
        octets = watch.payload if payload is None else payload
        message = self._message(watch, octets) if octets else None
        return {} if message is None else dict(_numbers("", message))

    def _message(self, watch: TopicWatch, octets: bytes) -> Message | None:
        message_class = self._class_of(watch.message_type)
        try:
            return None if message_class is None else message_class.decode(octets)
        except RemoteProtocolError:
            return None

    def series(self, name: str, field: str) -> list[tuple[float, float]]:
        """(time, value) of a numeric field, oldest first, every value of the last minutes; empty if it is not a number.

        Values not decoded yet are decoded in batches: if no page has asked for long, it takes a few calls until all are
        there.
        """
        curve = self._curve(name, field)
        return [] if curve is None else list(curve.points)

    def points_after(self, name: str, field: str, after: float) -> list[tuple[float, float]]:
        """As `series`, of what came after a time of the robot's clock only."""
        curve = self._curve(name, field)
        found = [] if curve is None else list(takewhile(lambda point: point[0] > after, reversed(curve.points)))
        found.reverse()
        return found

    def _curve(self, name: str, field: str) -> _Curve | None:
        watch = self._watches.get(name)
        if watch is None:
            return None
        curve = self._curves.setdefault((name, field), _Curve())
        self._follow(curve, watch, field, watch.kept)
        now = curve.asked_at
        while curve.points and now - curve.points[0][0] > HISTORY_S:
            curve.points.popleft()
        for key in [key for key, one in self._curves.items() if now - one.asked_at > HISTORY_S]:
            del self._curves[key]
        return curve

    def sparkline(self, watch: TopicWatch, field: str) -> list[float]:
        """A few values of the last minute, oldest first: for the small curve on a card."""
        curve = self._sparks.setdefault((watch.name, field), _Curve())
        self._follow(curve, watch, field, watch.sparks)
        while curve.points and curve.asked_at - curve.points[0][0] > SPARK_S:
            curve.points.popleft()
        return [value for _, value in curve.points]

    def _follow(self, curve: _Curve, watch: TopicWatch, field: str, kept: _SampleHistory) -> None:
        """Take apart what came since the last look, at most this many at once."""
        curve.asked_at = self._clock()
        newer = kept.after(curve.taken)
        curve.taken = kept.total - len(newer)
        for at, payload in newer[:TAKEN_APART]:
            curve.taken += 1
            value = self.numbers(watch, payload).get(field)
            if value is not None:
                curve.points.append((at, float(value)))

    def _close(self, name: str) -> None:
        self._curves = {key: curve for key, curve in self._curves.items() if key[0] != name}
        self._sparks = {key: curve for key, curve in self._sparks.items() if key[0] != name}
        reader = self._watches.pop(name).reader
        if reader is not None:
            reader.close()


def _leaves(way: str, message: Message) -> Iterator[tuple[str, Scalar]]:
    """The values of a message with the way to each."""
    for field in fields_of(type(message)):
        name, value = f"{way}{field.name}", getattr(message, field.name)
        if isinstance(value, Message):
            yield from _leaves(f"{name}.", value)
        elif isinstance(value, list | bytes):
            yield name, json.dumps(_short(value))
        elif isinstance(value, IntEnum):
            yield name, value.name.lower()
        elif isinstance(value, str):
            yield name, value[:LONGEST_TEXT]
        elif isinstance(value, float) and not math.isfinite(value):
            yield name, str(value)  # JSON has no such numbers
        elif isinstance(value, bool | int | float):
            yield name, value


def _short(value: object) -> object:
    """A value in a list as JSON has it: numbers with seven digits, as many as 32 bits hold."""
    if isinstance(value, list | bytes):
        return [_short(one) for one in value[:MOST_ELEMENTS]]
    if isinstance(value, Message):
        return [_short(getattr(value, field.name)) for field in fields_of(type(value))]
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, float):
        return float(f"{value:.7g}") if math.isfinite(value) else None
    return value[:LONGEST_TEXT] if isinstance(value, str) else value


def _numbers(way: str, value: object) -> Iterator[tuple[str, bool | int | float]]:
    """The numbers in a value with the way to each."""
    if isinstance(value, Message):
        for field in fields_of(type(value)):
            yield from _numbers(f"{way}.{field.name}" if way else field.name, getattr(value, field.name))
    elif isinstance(value, list | bytes):
        for place, element in enumerate(value[:MOST_CURVES]):
            yield from _numbers(f"{way}[{place}]", element)
    elif isinstance(value, bool | int | float) and math.isfinite(value):
        yield way, value
