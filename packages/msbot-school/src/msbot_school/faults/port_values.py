"""The newest numbers at the ports of a robot, for the conditions of faults."""

from __future__ import annotations

from collections import deque
from typing import Final

from msbot.config import FieldKind
from msbot.operations.running_robot import RunningRobot
from msbot.part import Message
from msbot.sim import message_class
from msbot_agent.space import Qos, Reader, Sample, Topic
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, RemoteProtocolError

MOST_WATCHED: Final = 32
MOST_KEPT: Final = 256
"""Messages that are kept for who looks now and then."""


class _Watch:
    """The newest messages of a topic, and what their number is."""

    def __init__(self, topic: str, message: type[Message], field: str) -> None:
        self.topic = topic
        self.reader: Reader | None = None
        self.payloads: deque[bytes] = deque(maxlen=MOST_KEPT)
        self.count = 0
        self._message = message
        self._field = field

    def listen(self, running: RunningRobot) -> None:
        # Best effort hears reliable writers as well; the other way round nothing would come.
        topic = Topic(self.topic, self._message.type_name)
        self.reader = running.master.space.reader(topic, Qos(reliable=False, depth=1), self._deliver)

    def number(self, payload: bytes) -> float | None:
        try:
            return float(getattr(self._message.decode(payload), self._field))
        except RemoteProtocolError:
            return None

    def _deliver(self, sample: Sample) -> bool:
        self.payloads.append(sample.payload)
        self.count += 1
        return True


class LatestPortValues:
    """Listens to the topics of ports that somebody asks about.

    Args:
        running: the robot.
    """

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._watches: dict[str, _Watch] = {}

    def check(self, source: str) -> None:
        """Make sure that there is such a number.

        Raises:
            ConfigError: no part has that port now, or its messages have no such number.
        """
        self._find(source)

    def watch(self, source: str) -> None:
        """Listen to `SLOT.PORT` or `SLOT.PORT.FIELD` from now on."""
        found = self._find(source)
        known = self._watches.get(source)
        if known is not None and known.topic == found.topic:
            return
        if known is not None and known.reader is not None:
            known.reader.close()
        while len(self._watches) >= MOST_WATCHED:
            oldest = self._watches.pop(next(iter(self._watches)))
            if oldest.reader is not None:
                oldest.reader.close()
        found.listen(self._running)
        self._watches[source] = found

    def newest(self, source: str) -> float | None:
        """The newest number; None: nothing has come, or nothing that can be read."""
        watch = self._watches.get(source)
        return watch.number(watch.payloads[-1]) if watch is not None and watch.payloads else None

    def since(self, source: str, heard: int | None) -> tuple[list[float], int]:
        """The numbers that have come since a look, and what to say at the next one: how many have been heard.

        Args:
            source: what is listened to.
            heard: what the last look said; None: this is the first, which sees the newest number.
        """
        watch = self._watches.get(source)
        if watch is None:
            return [], 0
        # There may be another topic since the last look, with a count of its own.
        new = 1 if heard is None else watch.count - heard if heard <= watch.count else watch.count
        payloads = list(watch.payloads)[-new:] if new else []
        return [value for value in map(watch.number, payloads) if value is not None], watch.count

    def _find(self, source: str) -> _Watch:
        slot, _, rest = source.partition(".")
        port, _, field = rest.partition(".")
        holder = self._running.holder(slot)
        held = None if holder is None else self._running.inventory.configuration_of(holder.client_key)
        bindings = () if held is None else held.bindings
        binding = next((one for one in bindings if one.port == port), None)
        if binding is None:
            known = ", ".join(f"{slot}.{one.port}" for one in bindings) or said("none")
            raise ConfigError(
                said(
                    "the condition: no part has a wired port {source} now; there are {known}",
                    source=source,
                    known=known,
                )
            )
        library = self._running.library
        message = None if library is None else library.messages.get(binding.type_name)
        cls = None if message is None else message_class(message)
        # On and off are 1 and 0.
        fields = {} if message is None else message.fields
        numeric = [name for name, kind in fields.items() if isinstance(kind, FieldKind) and kind is not FieldKind.TEXT]
        if cls is None or (field and field not in numeric) or not numeric:
            known = ", ".join(numeric) or said("none")
            raise ConfigError(
                said("the condition: {source} is no number; its numbers: {known}", source=source, known=known)
            )
        return _Watch(binding.topic, cls, field or numeric[0])
