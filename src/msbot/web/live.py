"""The values on a robot's topics as people see them: the latest one, how often they come, and a while of history.

A listener in the data space, one per bound topic. What arrives is kept as octets; it is taken apart only when a page
asks, so a topic that nobody looks at costs a counter.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping

from msbot.errors import RemoteProtocolError
from msbot.part import Message, fields_of
from msbot.space import Qos, Reader, Sample, Space, Topic

HISTORY = 600
"""Values kept of each topic."""
HISTORY_STEP_S = 0.1
"""Of a topic that is quicker, one value in this time is kept: a minute in all."""
RATE_WINDOW_S = 3.0
LONGEST_TEXT = 200

Scalar = bool | int | float | str
ClassOf = Callable[[str], type[Message] | None]
"""The message class of a type name, or None when nobody here knows it."""


class TopicWatch:
    """What is known of one topic."""

    def __init__(self, name: str, type_name: str, clock: Callable[[], float]) -> None:
        self.name = name
        self.type_name = type_name
        self.count = 0
        """Samples since the watch began."""
        self.at: float | None = None
        """When the latest sample came, by the robot's clock."""
        self.payload = b""
        self.reader: Reader | None = None
        self._clock = clock
        self._kept: deque[tuple[float, bytes]] = deque(maxlen=HISTORY)
        self._counts: deque[tuple[float, int]] = deque(maxlen=64)

    def deliver(self, sample: Sample) -> bool:
        """Take a sample; what the data space calls."""
        now = self._clock()
        self.count += 1
        self.at, self.payload = now, sample.payload
        if not self._kept or now - self._kept[-1][0] >= HISTORY_STEP_S:
            self._kept.append((now, sample.payload))
            self._counts.append((now, self.count))
        return True

    def rate_hz(self, now: float) -> float:
        """Samples a second, over the last few seconds."""
        recent = [(at, count) for at, count in self._counts if at >= now - RATE_WINDOW_S]
        if len(recent) < 2 or recent[-1][0] <= recent[0][0]:
            return 0.0
        (first_at, first), (last_at, last) = recent[0], recent[-1]
        # Silence since the last sample lowers the rate at once, not only when the window is empty.
        return (last - first) / max(last_at - first_at, now - first_at - 1.0)

    def history(self) -> Iterator[tuple[float, bytes]]:
        """(time, octets) of kept samples, oldest first."""
        return iter(tuple(self._kept))


class Live:
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

    def watch(self, topics: Mapping[str, str]) -> None:
        """Listen to exactly these topics from now on: name -> type name."""
        for name, watch in list(self._watches.items()):
            if topics.get(name) != watch.type_name:
                self._close(name)
        for name, type_name in topics.items():
            if name not in self._watches:
                watch = TopicWatch(name, type_name, self._clock)
                watch.reader = self._space.reader(Topic(name, type_name), Qos(reliable=False, depth=1), watch.deliver)
                self._watches[name] = watch

    def close(self) -> None:
        """Listen to nothing."""
        self.watch({})

    def topic(self, name: str) -> TopicWatch | None:
        """What is known of a topic."""
        return self._watches.get(name)

    def fields(self, watch: TopicWatch, payload: bytes | None = None) -> dict[str, Scalar]:
        """A sample's fields by name; nested ones as `pose.x`, lists as `samples[0]`.

        Octets of an unknown type, or that do not fit it, are shown as hexadecimal digits under the name `octets`.
        """
        octets = watch.payload if payload is None else payload
        message_class = self._class_of(watch.type_name)
        if not octets:
            return {}
        if message_class is None:
            return {"octets": octets[: LONGEST_TEXT // 2].hex(" ")}
        try:
            message = message_class.decode(octets)
        except RemoteProtocolError:
            return {"octets": octets[: LONGEST_TEXT // 2].hex(" ")}
        return dict(_flat("", message))

    def series(self, name: str, field: str, since: float = -math.inf) -> list[tuple[float, float]]:
        """(time, value) of a numeric field, oldest first; nothing for a field that is no number."""
        watch = self._watches.get(name)
        if watch is None:
            return []
        points = []
        for at, payload in watch.history():
            if at > since:
                value = self.fields(watch, payload).get(field)
                if isinstance(value, int | float):
                    points.append((at, float(value)))
        return points

    def _close(self, name: str) -> None:
        reader = self._watches.pop(name).reader
        if reader is not None:
            reader.close()


def _flat(prefix: str, value: object) -> Iterator[tuple[str, Scalar]]:
    """The scalars in a value with the way to each."""
    if isinstance(value, Message):
        for field in fields_of(type(value)):
            yield from _flat(f"{prefix}.{field.name}" if prefix else field.name, getattr(value, field.name))
    elif isinstance(value, list):
        for number, element in enumerate(value[:32]):
            yield from _flat(f"{prefix}[{number}]", element)
    elif isinstance(value, bytes):
        yield prefix, value[: LONGEST_TEXT // 2].hex(" ")
    elif isinstance(value, str):
        yield prefix, value[:LONGEST_TEXT]
    elif isinstance(value, float) and not math.isfinite(value):
        yield prefix, str(value)  # JSON has no such numbers
    elif isinstance(value, bool | int | float):
        yield prefix, value
