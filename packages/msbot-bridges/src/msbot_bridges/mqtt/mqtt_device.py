"""One device of a broker in a robot.

STOP sends each port's safe value and waits until the device itself reports it; that the broker has taken the order does
not count. Many devices report only what changes: one whose newest report is its safe value, and that was ordered
nothing else since, is stopped. A device that reports nothing is told again more and more rarely, since each order costs
the battery of a wireless device.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from msbot.part import Message
from msbot_bridges.bridge import DeviceOutput, ForeignDevice, Input, Report, Value
from msbot_bridges.mqtt.device_model import CommandPort, DeviceModel, Order

AGAIN_S = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Times between the orders of one STOP, as long as it is not confirmed; the last one holds."""


class MqttDevice(ForeignDevice):
    """A device.

    Args:
        model: what it has declared.
        send: sends an order; True: it is STOP.
        news: called when something has become known about STOP.
        now: the time, in seconds.
    """

    def __init__(
        self,
        model: DeviceModel,
        *,
        send: Callable[[Order, bool], None],
        news: Callable[[ForeignDevice], None],
        now: Callable[[], float],
    ) -> None:
        self.model = model
        self.identity = model.identity
        outputs = {one.port: one.message for one in model.readings}  # several topics may fill one port
        self.outputs = tuple(DeviceOutput(port, message) for port, message in outputs.items())
        self.inputs = tuple(Input(one.port, one.message, one.safe, one.ranges) for one in model.commands)
        self._values = dict[str, Value]()
        """What it has reported of its settings."""
        self._set = dict[str, Value]()
        """What it was told of them, and has not reported yet."""
        self._send, self._news, self._now = send, news, now
        self._commands = {one.port: one for one in model.commands}
        self._newest: dict[str, Message] = {}
        self._report: Report | None = None
        self._unconfirmed = dict[str, CommandPort]()
        self._reported_safe = set[str]()
        """Ports whose newest report is their safe value."""
        self._unanswered = set[str]()
        """Ports that were ordered something else, which the device has not reported yet."""
        self._is_stopping = False
        self._times_told = 0
        self._told_at = 0.0

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report = report
        for port, message in self._newest.items():
            report(port, message)  # most devices report only what changes

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report = None
        self.go()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        command = self._commands[port]
        self._is_stopping = False
        if message != command.safe:
            self._unanswered.add(port)
        for order in command.orders(message):
            self._send(order, False)

    @property
    def unknown_settings(self) -> list[str]:
        """Those whose value it has not reported; without that nobody knows what adopting it would change."""
        return [one.setting.name for one in self.model.settings if one.setting.name not in self._values]

    def describe_settings(self) -> None:
        """It is found: what it has now are the defaults of its settings."""
        known = [one.setting for one in self.model.settings if one.setting.name in self._values]
        self.settings = tuple(replace(one, default=self._values[one.name]) for one in known)

    def set(self, name: str, value: Value) -> None:
        """See `ForeignDevice`; what it has already is not written: the memory of many devices wears out."""
        one = next(one for one in self.model.settings if one.setting.name == name)
        if self._set.get(name, self._values.get(name)) == value:
            return
        self._set[name] = value
        for order in one.orders(value):
            self._send(order, False)

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` sends it, and waits for it."""
        if message != self._commands[port].safe:
            own = next(one for one in self.model.commands if one.port == port)
            self._commands[port] = own if message == own.safe else own.stopping_at(message, self.model.readings)
            self._reported_safe.discard(port)

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.safe_is(port, message)
        self.act(port, message)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        self._stop(list(self._commands.values()))

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, but a cover without a robot moves to its end."""
        self._stop([one for one in self._commands.values() if one.safe is not None])

    def _stop(self, commands: Sequence[CommandPort]) -> None:
        if not self._is_stopping:
            self._is_stopping, self._times_told = True, 0
            stopped = self._reported_safe - self._unanswered
            self._unconfirmed = {one.port: one for one in commands if one.safe_words and one.port not in stopped}
        elif self._now() - self._told_at < AGAIN_S[min(self._times_told, len(AGAIN_S) - 1)]:
            return
        self._times_told += 1
        self._told_at = self._now()
        for command in list(self._unconfirmed.values()) if self._times_told > 1 else commands:
            for order in command.stop:
                self._send(order, True)

    def rest(self) -> None:
        """See `ForeignDevice`: the safe values have come; a cover whose robot is gone moves to its end."""

    def go(self) -> None:
        """See `ForeignDevice`."""
        self._is_stopping = False
        self._unconfirmed.clear()

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self._unconfirmed:
            return ""
        where = self.identity.where
        never = [port for port, one in self._unconfirmed.items() if not one.state_topic]
        if never:
            return f"{where} has no state topic for {', '.join(never)}: whether it has stopped cannot be confirmed"
        port, command = next(iter(self._unconfirmed.items()))
        return f"{where} has not reported for {port} {command.safe_words}"

    def was_lost(self) -> None:
        """It is not there: what it reported last says nothing about what it does when it comes back."""
        self._reported_safe.clear()
        self._unanswered.clear()

    def heard(self, topic: str, payload: str, *, is_old: bool) -> None:
        """It has reported something.

        Args:
            topic: where.
            payload: what.
            is_old: the broker had kept it.
        """
        for reading in self.model.readings:
            if reading.topic == topic and (message := reading.read(payload)) is not None:
                self._newest[reading.port] = message
                if self._report is not None:
                    self._report(reading.port, message)
        for one in self.model.settings:
            if one.topic == topic and (value := one.read(payload)) is not None:
                self._values[one.setting.name] = value
                if self._set.get(one.setting.name) == value or not is_old:
                    self._set.pop(one.setting.name, None)
        was_waiting = bool(self._unconfirmed)
        for command in self._commands.values():
            if command.state_topic == topic and (is_safe := command.is_safe(payload)) is not None:
                self._judge(command, is_safe=is_safe, is_old=is_old)
        if was_waiting and not self._unconfirmed:
            self._news(self)

    def _judge(self, command: CommandPort, *, is_safe: bool, is_old: bool) -> None:
        port = command.port
        if not is_safe:
            self._reported_safe.discard(port)
            self._unanswered.discard(port)
            if self._is_stopping and not is_old and port not in self._unconfirmed and command.safe_words:
                # Somebody else has ordered it something after it had stopped.
                self._unconfirmed[port] = command
                for order in command.stop:
                    self._send(order, True)
            return
        self._reported_safe.add(port)
        if self._is_stopping and not is_old:
            self._unanswered.discard(port)
            self._unconfirmed.pop(port, None)
