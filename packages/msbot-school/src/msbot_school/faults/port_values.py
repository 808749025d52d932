"""The newest numbers at the ports of a robot, for the conditions of faults."""

from __future__ import annotations

from msbot.config import FieldKind
from msbot.operations.running_robot import RunningRobot
from msbot.part import Message
from msbot.sim import message_class
from msbot_agent.space import Qos, Reader, Sample, Topic
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

MOST_WATCHED = 32


@dataclass(slots=True)
class _Watch:
    topic: str
    message: type[Message]
    field: str
    reader: Reader | None = None
    payload: bytes = b""

    def deliver(self, sample: Sample) -> bool:
        self.payload = sample.payload
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
        topic = Topic(found.topic, found.message.type_name)
        # Best effort hears reliable writers as well; the other way round nothing would come.
        found.reader = self._running.master.space.reader(topic, Qos(reliable=False, depth=1), found.deliver)
        self._watches[source] = found

    def newest(self, source: str) -> float | None:
        """The newest number; None: nothing has come, or nothing that can be read."""
        watch = self._watches.get(source)
        if watch is None or not watch.payload:
            return None
        try:
            value = getattr(watch.message.decode(watch.payload), watch.field)
        except RemoteProtocolError:
            return None
        return float(value)

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
